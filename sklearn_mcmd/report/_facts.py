"""What a cloud is like, measured: bounds, spacing, copies, steps; and what is wrong with it."""

from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from sklearn_mcmd._errors import counted, fixed
from sklearn_mcmd.io._las import coordinate_system
from sklearn_mcmd.planes._indexed_cloud import LEAF, distinct_rows, location_hashes
from sklearn_mcmd.planes._resolution import coordinate_steps
from sklearn_mcmd.planes._whole import Steps
from sklearn_mcmd.report._contents import note_if, percent

SPACING_SAMPLE = 300_000  # points: of more, the median spacing is taken from about so many
RADIUS_SAMPLE = 20_000  # and radii of neighborhoods: their median is then known to 1 %
LARGE = 0.95  # quantile of radii that stands for the largest neighborhoods

CHECKS_OF_ALL = "duplicates, coordinates that are rounded, and points far from all others"
CHECKS = "too few points, sparse parts, noise that hides surfaces, " + CHECKS_OF_ALL
FEW = 10  # neighborhoods; the detector judges clouds of fewer by other shares (`SurfaceLimits`)
COPIES = 0.01  # share of copies, which count once, below which they change no picture
STEP = 0.505  # steps of coordinates; half a step is the least scale, and sets the usual one then
SPARSE = 5.0  # times the usual radius: there is a twenty-fifth of the usual density


class Facts(NamedTuple):
    """Measurements of a cloud of n points."""

    n_points: int
    n_distinct: int
    low: np.ndarray
    high: np.ndarray
    n_neighbors: int  # of a neighborhood, as far as there are so many points
    spacing: float  # median distance of a point to the nearest other place
    radius: float  # of neighborhoods: the median,
    sparse_radius: float  # and what 5 % of the points exceed
    steps: Steps  # to which coordinates are rounded
    depths: np.ndarray  # (2,), what 5 and 95 % of the steps of a depth are at most
    noise: float  # median standard deviation about the planes; NaN if these are not known

    @classmethod
    def of(cls, xyz, n_neighbors=0, scales=None):
        """Measure a cloud whose planes have these standard deviations; 0: without neighborhoods."""
        xyz = np.asfortranarray(xyz)  # passes along columns are ten times as fast
        distinct = xyz[distinct_rows(xyz)[0]]
        n_members = min(n_neighbors, len(distinct))
        radius = sparse = spacing = np.nan
        if len(distinct) > 1:
            tree = cKDTree(distinct, leafsize=LEAF, balanced_tree=False, compact_nodes=False)
            spacing = float(np.median(tree.query(sample_of(tree, SPACING_SAMPLE), k=[2])[0]))
            if n_members:
                radii = tree.query(sample_of(tree, RADIUS_SAMPLE), k=[n_members])[0][:, 0]
                radius, sparse = np.quantile(radii, [0.5, LARGE]).tolist()
        noise = np.nan
        if scales is not None:
            finite = scales[np.isfinite(scales)]
            noise = float(np.median(finite)) if finite.size else np.nan
        steps = coordinate_steps(xyz)
        return cls(
            n_points=len(xyz),
            n_distinct=len(distinct),
            low=xyz.min(axis=0),
            high=xyz.max(axis=0),
            n_neighbors=n_members,
            spacing=spacing,
            radius=radius,
            sparse_radius=sparse,
            steps=steps,
            depths=np.quantile(steps.at(xyz), [1 - LARGE, LARGE]),
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
        if self.steps.lattice:
            rows.append(("coordinates", f"rounded to steps of {self.steps.lattice:.2g}"))
        if self.steps.growth:
            least, most = self.depths
            rows.append(("depths", f"in steps of {least:.2g} to {most:.2g}, as of a camera"))
        n_copies = self.n_points - self.n_distinct
        rows.append(("duplicates", f"{n_copies:,} ({100 * n_copies / self.n_points:.2f} %)"))
        return rows


@np.errstate(over="ignore")
def bounds_rows(low, high):
    """Ranges of the axes, to six digits of the largest extent; one location has all its digits."""
    extent = min(float((high - low).max()), np.finfo(float).max)
    if extent == 0.0:
        return {axis: f"{value!r}" for axis, value in zip("xyz", low.tolist(), strict=True)}
    digits = max(0, 5 - int(np.floor(np.log10(extent))))  # behind the point: six in all
    # For large coordinates float64 holds fewer digits than that.
    most = max(0, 15 - int(np.floor(np.log10(max(np.abs([low, high]).max(), 1.0)))))
    form = f".{min(digits, most)}f"
    return {
        axis: f"{fixed(least, form)} to {fixed(most, form)} (extent {fixed(most - least, form)})"
        for axis, least, most in zip("xyz", low, high, strict=True)
    }


def sample_of(tree, most):
    """All points or about `most`, whatever their order, as leaves have them: near in memory."""
    chosen = location_hashes(tree.data) % np.uint64(-(-tree.n // most)) == 0
    return tree.data[tree.indices[chosen[tree.indices]]]


def usual_rows(xyz):
    """Points that are not farther from the middle 98 % than these reach, along each axis."""
    low, high = np.quantile(xyz, [0.01, 0.99], axis=0)
    reach = (high - low).max()
    return ((xyz >= low - reach) & (xyz <= high + reach)).all(axis=1)


def cloud_notes(facts, n_far):
    """What is the matter with the cloud itself, of which so many points are far from the rest."""
    n_copies = facts.n_points - facts.n_distinct
    spans = " x ".join(f"{value:.4g}" for value in facts.high - facts.low)
    notes = note_if(
        n_copies > COPIES * facts.n_points,
        "Duplicates.",
        f"{counted(n_copies, 'point', 'lie')} exactly where another one does "
        f"({percent(n_copies, facts.n_points)}). Copies count once, and say nothing about noise.",
        "Look for a strip that was merged twice, or thin the cloud to distinct points first.",
    )
    notes += note_if(
        facts.steps.lattice and facts.noise <= STEP * facts.steps.lattice,
        "Rounded coordinates.",
        f"Coordinates are multiples of {facts.steps.lattice:.3g}, which is coarser than the noise. "
        "Distances from surfaces are known in steps and no longer in noise; what is off by less "
        "than a step and a half is not seen.",
        "Export the scan with more decimals, if it has them.",
    )
    notes += note_if(
        n_far > 0,
        "Points far from all others.",
        f"{counted(n_far, 'point', 'lie')} farther from the rest than this is wide "
        f"({percent(n_far, facts.n_points)}): the file spans {spans}. Maps leave out what is far.",
        "Check what is there, and cut it off if it is no part of the scan.",
    )
    return notes + _neighborhood_notes(facts) if facts.n_neighbors else notes


def _neighborhood_notes(facts):
    # It imports scikit-learn, which takes longer than all that `mcmd info` needs.
    from sklearn_mcmd.outliers._surfaces import SurfaceLimits

    notes = note_if(
        facts.n_distinct < FEW * facts.n_neighbors or facts.n_distinct <= facts.n_neighbors,
        "Few points.",
        f"The cloud has {counted(facts.n_distinct, 'distinct point')}, and a neighborhood takes "
        f"{facts.n_neighbors:,} of them. What is a surface and what is usual is then a guess.",
        "Give a larger part of the scan, or a smaller --n-neighbors.",
    )
    notes += note_if(
        facts.sparse_radius > SPARSE * facts.radius,
        "Sparse parts.",
        f"A neighborhood of {facts.n_neighbors} points usually has a radius of {facts.radius:.2g}. "
        f"For 5 % of the points it is more than {facts.sparse_radius:.2g}: smaller things are not "
        "seen there, and normals are averages over that width.",
        "Trust these parts less, cut them off, or give a smaller --n-neighbors.",
    )
    flat = SurfaceLimits().flat  # which 50 neighbors have at noise of 0.6 spacings
    return notes + note_if(
        facts.noise > flat * facts.radius,
        "Noise hides the surfaces.",
        f"Points scatter by {facts.noise:.2g} about their planes, and neighborhoods have a radius "
        f"of {facts.radius:.2g}. From {flat:g} of the radius on (0.6 spacings with 50 neighbors) "
        "nothing counts as a surface. The cloud is noise, or foliage.",
        "Give more neighbors, such as --n-neighbors 200, or a cloud of surfaces.",
    )
