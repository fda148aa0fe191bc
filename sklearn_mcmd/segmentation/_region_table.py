"""Regions as a table: kinds, planes, cylinders, outlines."""

from typing import NamedTuple

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from sklearn_mcmd.planes._form import form_of
from sklearn_mcmd.planes._orientation import point_up
from sklearn_mcmd.planes._principal_planes import RANK_TOLERANCE, student_factors, tilt_variances
from sklearn_mcmd.planes._resolution import rounding_in_common
from sklearn_mcmd.segmentation._cylinder_parts import N_PARAMETERS, CylinderLimits, fit_cylinder
from sklearn_mcmd.segmentation._graph import by_place
from sklearn_mcmd.segmentation._merge_coplanar import JoinLimits, flat_noise
from sklearn_mcmd.segmentation._region_sums import Groups, median_by_region, region_sizes

N_PLANE = 3  # parameters of a plane
ROOT_12 = np.sqrt(12.0)  # a step over it is the standard deviation of what rounding adds
NAMES = "kind points area centroid normal dip dip_direction rms"
ERRORS = ("height_error", "normal_error", "dip_error", "dip_direction_error")
TYPES = {"kind": "U8", "points": np.int64, "outline": object}  # of columns; others are numbers
TYPES |= dict.fromkeys(("centroid", "normal", "axis_point", "axis"), "3f8")
FIELDS = [
    (name, TYPES.get(name, "f8"))
    for name in [*NAMES.split(), *ERRORS, "axis_point", "axis", "radius", "outline"]
]


def region_table(points, labels, around, region_planes, step=0.0):
    """The `regions_` of a `RegionGrowing` in 3D, by the planes `around` points and the
    `RegionPlanes`; coordinates were rounded to a step."""
    n, values = len(region_planes.sizes), region_planes.eigenvalues
    distinct = region_sizes(labels, n)  # copies tell nothing more
    table, noise = flat_table(region_planes, distinct, step)
    if n == 0:
        return table
    most_noise, least_size = JoinLimits().most_noise, CylinderLimits().least_size
    usual = median_by_region(around.scale, labels, n)
    reach = median_by_region(around.radius, labels, n)
    # What eigenvalues round is no cylinder about a line.
    thin = values[:, 1] <= RANK_TOLERANCE * values[:, 2]
    flat = are_flat(region_planes, usual, reach)
    groups = Groups.of(labels).split()
    for region, (row, group) in enumerate(zip(table, groups, strict=True)):
        group = by_place(points, group)
        row["kind"] = "plane" if flat[region] else "curved"
        local = points[group]
        local -= row["centroid"]
        places = local @ frame_of(row["normal"]).T
        row["area"], row["outline"] = outline_of(places, row["centroid"], row["normal"])
        rounded = Rounded(step, region_planes.covariances[region])
        enlarge_errors(row, local, region_planes.axes[region], noise[region], rounded)
        del local, places  # of the largest region these take the most memory
        if len(group) >= least_size and not thin[region]:
            total, cylinder = fit_cylinder(points[group], around.normals[group])
            left = np.sqrt(total / (len(group) - N_PARAMETERS))
            if left <= most_noise * usual[region] and noise[region] > most_noise * left:
                row["kind"], row["radius"], row["rms"] = "cylinder", cylinder.radius, left
                row["axis"] = axis = point_up(cylinder.axis[None].copy())[0]
                # The point of the axis that is nearest to the centroid.
                gap = row["centroid"] - cylinder.point
                row["axis_point"] = cylinder.point + (gap @ axis) * axis
    return table


def flat_table(region_planes, distinct, step):
    """The table of regions that are taken for planes, without area and outline, and their noise, by
    `RegionPlanes`, and the `distinct` points of each, whose coordinates were rounded to a step."""
    sizes, centroids, _, values, axes = region_planes
    table = np.zeros(len(sizes), FIELDS)
    table["points"], table["centroid"], table["rms"] = sizes, centroids, np.sqrt(values[:, 0])
    table["normal"] = normals = point_up(axes[..., 0].copy())
    table["dip"] = np.degrees(np.arccos(np.clip(normals[:, 2], 0.0, 1.0)))
    table["dip_direction"] = np.degrees(np.arctan2(normals[:, 0], normals[:, 1])) % 360.0
    # The plane has taken three of the degrees of freedom.
    noise = np.sqrt(values[:, 0] * distinct / np.maximum(distinct - N_PLANE, 1))
    table["height_error"] = np.maximum(noise, step / ROOT_12) / np.sqrt(np.maximum(distinct, 1))
    # Toward the narrower axis and the longer one; 90 degrees where points are on a line.
    gaps = values[:, 1:] - values[:, :1]
    determined = gaps[:, 0] > RANK_TOLERANCE * values[:, 2]
    gaps[~determined] = np.inf
    variances = tilt_variances(values[:, 1:], gaps, table["height_error"][:, None] ** 2)
    variances[~determined] = np.inf
    # The normal goes along `fall` where the dip grows, and along `level` where its direction turns.
    sine = np.linalg.norm(normals[:, :2], axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        x, y = normals[:, :2].T / sine
    fall = np.column_stack([x * normals[:, 2], y * normals[:, 2], -sine])
    level = np.column_stack([y, -x, np.zeros(len(sine))])
    errors = {"normal_error": np.sqrt(variances[:, 0])}
    for name, direction in ("dip_error", fall), ("dip_direction_error", level):
        shares = np.einsum("nij,ni->nj", axes[:, :, 1:], direction) ** 2
        errors[name] = np.sqrt(np.einsum("nj,nj->n", shares, variances))
    with np.errstate(divide="ignore", invalid="ignore"):
        errors["dip_direction_error"] /= sine
    errors["dip_error"] = np.where(sine > 0, errors["dip_error"], errors["normal_error"])
    for name, error in errors.items():
        table[name] = _at_most(np.degrees(error), name)
    for name in ("axis_point", "axis", "radius"):
        table[name] = np.nan
    return table, noise


def are_flat(region_planes, usual, reach):
    """Which regions are planes, by `RegionPlanes`, and medians of scales and radii of their points'
    planes."""
    values = region_planes.eigenvalues
    flat = values[:, 0] <= RANK_TOLERANCE * values[:, 2]  # what eigenvalues round is no bend
    flat |= np.sqrt(values[:, 0]) <= JoinLimits().most_noise * usual
    return flat | (flat_noise(region_planes.covariances, reach) > 0)


class Rounded(NamedTuple):
    """To what the coordinates of a region were rounded, and their covariance, copies counted."""

    step: float
    covariance: np.ndarray

    def in_common(self, normal):
        deviations = np.sqrt(np.diag(self.covariance))
        return rounding_in_common(deviations, normal, np.full(len(normal), self.step))


def enlarge_errors(row, local, axes, noise, rounded, each=1.0):
    """Enlarge the errors of a row by as much more as bows or strips are than even noise, where they
    show that noise is alike nearby, or a step rounds all points alike. Points are `local` to the
    centroid, of principal axes, the normal first; each stands for so many, with this noise."""
    form = form_of(local @ axes[:, 1:], local @ row["normal"], rises=axes[2, 1:])
    noise = max(noise, rounded.step / ROOT_12)
    if rounded.step:
        form = form.at_least(rounded.in_common(row["normal"]) * np.sqrt(len(local)))
    if noise > 0 and form.is_alike(noise / np.sqrt(each)):
        # Errors of which 1.96 hold 95 %, though few bows or strips tell them.
        known = np.isinf(form.alike_dof)
        student = 1.0 if known else student_factors(np.array([form.alike_dof]), 2)[0]
        effect = student * np.sqrt(each) * form.alike_deviation / noise
        for name in ERRORS:
            row[name] = _at_most(effect * row[name], name)


def _at_most(errors, name):
    """No error of an angle is more than where nothing is known, as of nan."""
    most = {"height_error": np.inf, "dip_direction_error": 180.0}.get(name, 90.0)
    return np.nan_to_num(np.minimum(errors, most), nan=most, posinf=most)


def frame_of(normal):
    """Two unit vectors (2, 3) of a plane."""
    u = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
    u /= np.linalg.norm(u)
    return np.stack([u, np.cross(normal, u)])


def outline_of(places, centroid, normal):
    """Area and convex outline, as WKT, of points (n, 2) in their plane."""
    try:
        hull = ConvexHull(places)
    except (QhullError, ValueError):  # points of a line, or too few
        return 0.0, "POLYGON Z EMPTY"
    corners = centroid + places[hull.vertices] @ frame_of(normal)
    corners = np.roll(corners, -np.lexsort(corners.T)[0], axis=0)
    ring = ", ".join(
        " ".join(f"{value:.12g}" for value in corner) for corner in [*corners, corners[0]]
    )
    return hull.volume, f"POLYGON Z (({ring}))"
