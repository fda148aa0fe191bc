"""What a cloud is like, measured: bounds, spacing, copies, steps of its coordinates."""

from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from sklearn_mcmd.io._las import coordinate_system
from sklearn_mcmd.planes._resolution import coordinate_step

SPACING_SAMPLE = 200_000  # largest number of points that the median spacing is taken from
RADIUS_SAMPLE = 20_000  # and radii of neighborhoods: their median is then known to 1 %
SPARSE = 0.95  # quantile of radii that stands for the largest neighborhoods


class Facts(NamedTuple):
    """Measurements of a cloud of n points."""

    n_points: int
    n_distinct: int
    low: np.ndarray
    high: np.ndarray
    near: np.ndarray  # bool (n,), points that are not far from all others
    n_neighbors: int  # of a neighborhood, as far as there are so many points
    spacing: float  # median distance of a point to the nearest other place
    radius: float  # of neighborhoods: the median,
    sparse_radius: float  # and what 5 % of the points exceed
    step: float  # to which coordinates are rounded; 0 if none was found
    noise: float  # median standard deviation about the planes; NaN if these are not known

    @classmethod
    def of(cls, xyz, n_neighbors=0, scales=None):
        """Measure a cloud whose planes have these standard deviations; 0: without neighborhoods."""
        distinct = distinct_points(xyz)
        n_members = min(n_neighbors, len(distinct))
        radius = sparse = spacing = np.nan
        if len(distinct) > 1:
            tree = cKDTree(distinct, balanced_tree=False)
            some = tree.data[:: -(-tree.n // SPACING_SAMPLE)]
            spacing = float(np.median(tree.query(some, k=[2])[0]))
            if n_members:
                sample = distinct[:: -(-len(distinct) // RADIUS_SAMPLE)]
                radii = tree.query(sample, k=[n_members])[0][:, 0]
                radius, sparse = np.quantile(radii, [0.5, SPARSE]).tolist()
        noise = np.nan
        if scales is not None:
            known = scales[np.isfinite(scales)]
            noise = float(np.median(known)) if known.size else np.nan
        return cls(
            n_points=len(xyz),
            n_distinct=len(distinct),
            low=xyz.min(axis=0),
            high=xyz.max(axis=0),
            near=usual_rows(xyz),
            n_neighbors=n_members,
            spacing=spacing,
            radius=radius,
            sparse_radius=sparse,
            step=float(coordinate_step(xyz)),
            noise=noise,
        )

    def rows(self, cloud):
        """Names and values of a table about the cloud, as it was read."""
        rows = [("points", f"{self.n_points:,}")]
        if cloud.n_dropped:
            rows.append(("left out", f"{cloud.n_dropped:,} without coordinates"))
        rows += bounds_rows(self.low, self.high).items()
        header = cloud.metadata.get("las_header")
        if header is not None:
            rows.append(("CRS", coordinate_system(header) or "not stated"))
        rows.append(("attributes", ", ".join(cloud.attributes) or "none"))
        if np.isfinite(self.spacing):
            rows.append(("spacing", f"{self.spacing:.4g} (median distance to the nearest)"))
        if np.isfinite(self.radius):
            sizes = f"radius {self.radius:.3g} (median); 5 % are larger than "
            sizes += f"{self.sparse_radius:.3g}"
            rows.append((f"neighborhoods of {self.n_neighbors}", sizes))
        if np.isfinite(self.noise):
            rows.append(("noise about planes", f"{self.noise:.2g} (median standard deviation)"))
        if self.step:
            rows.append(("coordinates", f"rounded to steps of {self.step:.3g}"))
        n_copies = self.n_points - self.n_distinct
        rows.append(("duplicates", f"{n_copies:,} ({100 * n_copies / self.n_points:.2f} %)"))
        return rows


@np.errstate(over="ignore")
def bounds_rows(low, high):
    """Ranges of the axes, to six digits of the largest extent; one location has all its digits."""
    extent = min(float((high - low).max()), np.finfo(float).max)
    if extent == 0.0:
        return {axis: f"{value!r}" for axis, value in zip("xyz", low.tolist(), strict=True)}
    digits = max(0, 5 - int(np.floor(np.log10(extent))))
    # For large coordinates float64 holds fewer digits than that.
    most = max(0, 15 - int(np.floor(np.log10(max(np.abs([low, high]).max(), 1.0)))))
    digits = min(digits, most)
    return {
        axis: f"{least:.{digits}f} to {most:.{digits}f} (extent {most - least:.{digits}f})"
        for axis, least, most in zip("xyz", low, high, strict=True)
    }


def distinct_points(xyz):
    """Each place once, in the order of coordinates."""
    order = np.lexsort(xyz.T)
    first = np.r_[True, (np.diff(xyz[order], axis=0) != 0).any(axis=1)]
    return xyz[order[first]]


def usual_rows(xyz):
    """Points that are not farther from the middle 98 % than these reach, along each axis."""
    low, high = np.quantile(xyz, [0.01, 0.99], axis=0)
    reach = (high - low).max()
    return ((xyz >= low - reach) & (xyz <= high + reach)).all(axis=1)
