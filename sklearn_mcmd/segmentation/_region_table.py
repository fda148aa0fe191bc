"""Regions as a table: kinds, planes, cylinders, outlines."""

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from sklearn_mcmd.planes._around import ratio
from sklearn_mcmd.planes._orientation import point_up
from sklearn_mcmd.planes._plane import RANK_TOLERANCE
from sklearn_mcmd.segmentation._cylinder import N_PARAMETERS, fit_cylinder
from sklearn_mcmd.segmentation._cylinder_parts import LEAST_SIZE
from sklearn_mcmd.segmentation._graph import by_place
from sklearn_mcmd.segmentation._merge_coplanar import MOST_NOISE, own_noise
from sklearn_mcmd.segmentation._region_sums import median_by_region, rows_of

__all__ = ["region_table"]

FIELDS = [
    ("kind", "U8"), ("points", np.int64), ("area", float), ("centroid", float, 3),
    ("normal", float, 3), ("dip", float), ("dip_direction", float), ("rms", float),
    ("height_error", float), ("normal_error", float), ("axis_point", float, 3),
    ("axis", float, 3), ("radius", float), ("outline", object),
]  # fmt: skip


def region_table(points, labels, around, moments):
    """The `regions_` of a `RegionGrowing` in 3D.

    `around` are the planes of the points; `moments` are sizes, centroids, covariances, eigenvalues
    and axes, as of `region_planes`.
    """
    sizes, centroids, covariances, values, axes = moments
    table = np.zeros(len(sizes), FIELDS)
    table["points"], table["centroid"], table["rms"] = sizes, centroids, np.sqrt(values[:, 0])
    table["normal"] = normals = point_up(axes[..., 0].copy())
    table["dip"] = np.degrees(np.arccos(np.clip(normals[:, 2], 0.0, 1.0)))
    table["dip_direction"] = np.degrees(np.arctan2(normals[:, 0], normals[:, 1])) % 360.0
    noise = np.sqrt(values[:, 0] * sizes / np.maximum(sizes - 3, 1))
    table["height_error"] = noise / np.sqrt(sizes)
    # Anderson's, as of `normal_errors`, along the narrower axis; 90 where that is none.
    gap = values[:, 1] - values[:, 0]
    known = gap > RANK_TOLERANCE * values[:, 2]
    tilt = ratio(np.sqrt(values[:, 1]) * table["height_error"], np.where(known, gap, np.inf))
    table["normal_error"] = np.where(known, np.degrees(np.minimum(tilt, np.pi / 2)), 90.0)
    for name in ("axis_point", "axis", "radius"):
        table[name] = np.nan
    if len(sizes) == 0:
        return table
    usual = median_by_region(around.scale, labels, len(sizes))
    # What eigenvalues round is no bend, and no cylinder about a line.
    flat, thin = (values[:, i] <= RANK_TOLERANCE * values[:, 2] for i in (0, 1))
    flat |= table["rms"] <= MOST_NOISE * usual
    flat |= own_noise(covariances, median_by_region(around.radius, labels, len(sizes))) > 0
    rows = by_place(points, rows_of(labels, np.append(np.ones(len(sizes), bool), False)))
    rows = rows[np.argsort(labels[rows], kind="stable")]
    groups = np.split(rows, np.flatnonzero(np.diff(labels[rows])) + 1)
    for region, (own, group) in enumerate(zip(table, groups, strict=True)):
        own["kind"] = "plane" if flat[region] else "curved"
        own["area"], own["outline"] = _outline(points[group], own["centroid"], own["normal"])
        if len(group) >= LEAST_SIZE and not thin[region]:
            total, cylinder = fit_cylinder(points[group], around.normals[group])
            left = np.sqrt(total / (len(group) - N_PARAMETERS))
            if left <= MOST_NOISE * usual[region] and noise[region] > MOST_NOISE * left:
                own["kind"], own["radius"], own["rms"] = "cylinder", cylinder.radius, left
                axis = point_up(cylinder.axis[None].copy())[0]
                own["axis"] = axis
                # The point of the axis that is nearest to the centroid.
                gap = own["centroid"] - cylinder.point
                own["axis_point"] = cylinder.point + (gap @ axis) * axis
    return table


def _outline(points, centroid, normal):
    """Area and convex outline, as WKT, of points that are projected on their plane."""
    u = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
    u /= np.linalg.norm(u)
    frame = np.stack([u, np.cross(normal, u)])
    flat = (points - centroid) @ frame.T
    try:
        hull = ConvexHull(flat)
    except (QhullError, ValueError):  # points of a line, or too few
        return 0.0, "POLYGON Z EMPTY"
    corners = centroid + flat[hull.vertices] @ frame
    corners = np.roll(corners, -np.lexsort(corners.T)[0], axis=0)
    ring = ", ".join(
        " ".join(f"{value:.12g}" for value in corner) for corner in [*corners, corners[0]]
    )
    return hull.volume, f"POLYGON Z (({ring}))"
