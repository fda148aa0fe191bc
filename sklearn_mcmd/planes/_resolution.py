"""The step to which a file rounded its coordinates, and the least scales that rounding allows."""

from functools import reduce
from typing import NamedTuple

import numpy as np

from sklearn_mcmd.planes._whole import Steps, whole_cloud


class RoundingLimits(NamedTuple):
    """What rounding does to planes, and how a lattice of rounded coordinates is recognized."""

    # The least scale of a plane, in steps to which coordinates were rounded: at the usual cutoffs
    # a distance of one step is then no outlier.
    least_steps: float = 0.5
    # The same in steps of a depth, of which three are one step. Rounding itself is .29 of it.
    least_depths: float = 1 / 3
    errors: float = 8.0  # the same in rounding errors of the coordinates' type
    tolerance: float = 0.02  # part of a step by which a gap may differ from whole steps
    # Gaps of more steps are not used: the error of the step, times 100, is no longer small.
    longest: int = 100
    fewest_gaps: int = 3  # with fewer an axis has no step of its own
    shared: int = 3  # depths of a camera lie on levels, each of more points than this
    fewest_levels: int = 10  # with fewer no steps are seen to grow
    grows: float = 1.1  # the farthest third of the steps is so many times the nearest, at least
    alike: float = 0.05  # and mean steps are those of the fit within this share
    shorter: float = 0.02  # largest share of gaps shorter than the step, of points not rounded
    on_lattice: float = 0.95  # least share of gaps that are whole steps
    rare: float = 0.1  # a value that occurs less often, of what is typical, was not rounded
    least_level: float = 0.02  # of an axis with few values, those of fewer points are not used
    raster: float = 0.5  # of the nodes of a lattice have points, beside an axis of one value
    apart: float = 20.0  # times the least step: another axis with more is that of a raster
    # float32 is too coarse if it rounds by a larger share of a typical neighborhood's radius.
    coarse: float = 0.01


class CoarseCoordinatesWarning(UserWarning):
    """float32 rounds coordinates by a visible share of a typical neighborhood.

    It has the coordinate of a typical point, the step of float32 there, and the radius of a
    typical neighborhood.
    """

    def __init__(self, largest, rounding, radius):
        self.largest, self.rounding, self.radius = largest, rounding, radius
        super().__init__(largest, rounding, radius)
        self.fact = (
            f"single precision (float32) rounds coordinates as large as {largest:,.7g} to steps of "
            f"{rounding:.2g}, too coarse for neighborhoods of radius {radius:.2g}"
        )

    def __str__(self):
        remedy = "Pass X as float64, or subtract an offset before converting it to float32."
        return f"{self.fact}. {remedy}"


def least_scales(points, precision, steps):
    """Least standard deviation of a plane at each of the points (n, d): what rounding amounts to.

    `precision` is the relative rounding error of the coordinates, eps of their dtype.
    """
    largest, limits = reduce(np.maximum, np.abs(points).T), RoundingLimits()
    least = np.maximum(limits.least_steps * steps.lattice, limits.least_depths * steps.at(points))
    return np.maximum(limits.errors * float(precision) * largest, least)


def with_depths(planes, steps):
    """Planes with the errors of normals that levels of depth may tilt: on one level, or two, a
    surface shows no tilt, and more points would not show it either."""
    if not steps.growth:
        return planes
    least, across = planes.eigenvalues[:, 0], planes.eigenvalues[:, 1]
    facing = np.square(planes.normals[:, steps.axis])
    step = np.maximum(steps.at(planes.centroids), np.finfo(float).tiny)
    deviations = np.sqrt(facing * least + (1 - facing) * across) / step
    off = step * rounding_in_common(deviations[:, None], np.sqrt(facing)[:, None], np.ones(1))
    tilts = np.degrees(np.arctan2(off, np.sqrt(across)))
    errors = np.hypot(planes.normal_error, tilts)
    return planes._replace(normal_error=np.minimum(errors, 90.0))


def rounding_in_common(deviations, direction, steps):
    """Standard deviation of what rounding to steps (d,) does to all points of a plane alike, along
    a direction (..., d); the points have these standard deviations (..., d) in each coordinate.

    Points at one height are all rounded by the same, at most half a step, which no mean removes.
    Noise, or a slope, of s steps leaves ``exp(-2 pi^2 s^2)`` of it (B. Widrow, I. Kollar,
    "Quantization noise", 2008, 4.3); half a step of noise leaves a hundredth.
    """
    rounded = steps > 0
    steps, deviations = steps[rounded], deviations[..., rounded]
    variances = (deviations / steps) ** 2
    # Rounding itself is 1/12 of them (Sheppard's correction).
    alike = np.exp(-2 * np.pi**2 * (variances - 1 / 12)) / np.sqrt(12)
    # On two levels, all within p (1 - p): without noise the plane is at their middle, and the mean
    # of the points off by 1/2 - p, at most.
    alike = np.where(variances < 1 / 4, np.sqrt(np.maximum(1 / 4 - variances, 0.0) / 3), alike)
    return np.linalg.norm(steps * alike * direction[..., rounded], axis=-1)


def axis_steps(X):
    """To what each coordinate (d,) of the points of one plane was rounded, 0 where it was not.

    An axis of few levels, as of a level floor, has the step between these. One of one level shares
    that of the others, of which its value is a multiple. Places of a raster are exact: of two axes
    on a lattice beside others that are not, of a lattice with points at half of its nodes, and
    steps that are twenty times the least.
    """
    limits, steps, constant, n_nodes = RoundingLimits(), np.zeros(X.shape[1]), [], 1
    for axis, (values, counts) in enumerate(levels_of(X)):
        gaps, rounding = _used_gaps(values, counts)
        n_nodes *= len(values)
        if gaps.size >= limits.fewest_gaps:
            steps[axis] = _lattice_step(gaps, rounding)
            continue
        used = values[counts >= limits.least_level * len(X)]
        if len(used) > 1 and _typical(counts) > limits.fewest_gaps:
            steps[axis] = np.diff(used).min()
        elif len(used) == 1:
            constant.append(axis)
    n_lattices, n_axes = np.count_nonzero(steps), X.shape[1] - len(constant)
    if 1 < n_lattices < n_axes or n_lattices == 0:
        return np.zeros(X.shape[1])
    least = steps[steps > 0].min()
    steps[steps > limits.apart * least] = 0.0
    if n_lattices == n_axes and len(X) <= limits.raster * n_nodes:
        for axis in constant:
            multiple = X[0, axis] / least
            steps[axis] = least * (abs(multiple - np.rint(multiple)) <= limits.tolerance)
    return steps


def _used_gaps(values, counts):
    """Gaps between the levels of an axis, and the rounding error of one."""
    # Values that occur rarely were not rounded, and gaps of rounding errors are none.
    gaps = np.diff(values[counts >= RoundingLimits().rare * _typical(counts)])
    rounding = 8 * np.finfo(values.dtype).eps * max(abs(values[0]), abs(values[-1]))
    return gaps[gaps > rounding], rounding


def coordinate_steps(X):
    """The `Steps` of coordinates X (n, d).

    Files hold coordinates rounded to, for example, a centimeter. If that is coarser than the
    noise, most of a flat neighborhood lies on exactly one level. The robust scale is then zero,
    and all points on other levels would be outliers.

    Depths of a camera that measures disparity have steps that grow, see `_growth`.

    The step of the lattice is the smallest among the axes; zero unless every axis is on a lattice.
    A raster of heights is no rounded cloud. A rounded cloud that was rotated is not found. A few
    points that were not rounded do no harm. A part of a cloud has the steps of the whole.
    """
    whole = whole_cloud()
    return steps_of_levels(list(levels_of(X))) if whole is None else whole.steps


def steps_of_levels(levels):
    """The same from what `levels_of` gives, as a list."""
    depths = [(*_growth(values, counts), axis) for axis, (values, counts) in enumerate(levels)]
    return Steps(step_of_levels(levels), *max(depths))


def _growth(values, counts):
    """The step 1 from where a camera sees from, and this place, of levels at depths whose steps
    grow with the square of the distance from it; 0 of others.

    A camera finds depth z from a disparity in whole steps, to which 1 / z is in proportion, so the
    root of a step is. It is so in all but one of five parts: a file may round the nearest depths
    more coarsely.
    """
    limits, used = RoundingLimits(), counts > RoundingLimits().shared
    levels = values[used].astype(float)
    if len(levels) < limits.fewest_levels:
        return 0.0, 0.0
    extent, third = levels[-1] - levels[0], (len(levels) - 1) // 3
    places, gaps = (levels[1:] + levels[:-1]) / 2 - levels[0], np.diff(levels)
    places, roots = places / extent, np.sqrt(gaps / extent)
    first, last = np.median(roots[:third]), np.median(roots[-third:])
    grows = max(first, last) ** 2 >= limits.grows * min(first, last) ** 2
    if not grows or counts[used].sum() < (1 - limits.shorter) * counts.sum():
        return 0.0, 0.0
    slope = (last - first) / (np.median(places[-third:]) - np.median(places[:third]))
    start = np.median(roots - slope * places)
    for _ in range(3):
        fitted = np.maximum(slope * places + start, 0.0)
        # At levels without a point a step is two or more.
        near = (roots**2 < 2 * fitted**2) & (fitted**2 < 2 * roots**2)
        if near.mean() < limits.on_lattice:
            return 0.0, 0.0
        slope, start = np.polyfit(places[near], roots[near], 1)
    parts = np.array_split(np.square([roots, slope * places + start])[:, near], 5, axis=1)
    off = np.sort([abs(told / fit - 1) for told, fit in (part.mean(axis=1) for part in parts)])
    if off[-2] > limits.alike:
        return 0.0, 0.0
    return float(slope**2 / extent), float(levels[0] - start / slope * extent)


def levels_of(X):
    """The values (m,) of each axis, ascending, and how often each occurs (m,)."""
    return (np.unique(axis, return_counts=True) for axis in X.T)


def step_of_levels(levels):
    """Step of the lattice of coordinates, from what `levels_of` gives; 0 if there is none."""
    steps, flat, limits = [], [], RoundingLimits()
    for values, counts in levels:
        gaps, rounding = _used_gaps(values, counts)
        if gaps.size < limits.fewest_gaps:
            flat.append(np.diff(values[counts >= limits.least_level * counts.sum()]))
            continue
        step = _lattice_step(gaps, rounding)
        if step == 0.0:
            return 0.0
        steps.append(step)
    if not steps:
        return 0.0
    step = min(steps)
    # An axis with few levels, as on a level floor, shares the step of the others or has none.
    if any(gaps.size == 0 or not _whole(gaps / step).all() for gaps in flat):
        return 0.0
    return step


def in_own_precision(X):
    """X as float32 if that rounded it: many files hold such numbers in columns of float64."""
    with np.errstate(over="ignore"):
        single = X.astype(np.float32)
    return single if np.array_equal(single, X) and is_single(levels_of(X)) else X


def is_single(levels):
    """Whether float32 rounded coordinates that it holds exactly, from what `levels_of` gives.

    Float32 holds whole meters, too, and rasters, whose own steps are longer than its steps. Of
    the axes on which its steps matter and values differ, the one decides on which it is finest.
    """
    axes, limits = [], RoundingLimits()
    for values, counts in levels:
        usual = values[np.searchsorted(np.cumsum(counts), counts.sum() / 2)]
        step = float(np.spacing(np.float32(abs(usual))))
        # Numbers that differ by 1 have a radius of which a finer step is too small to matter.
        if step > limits.coarse and counts.max() < limits.on_lattice * counts.sum():
            axes.append((step, values.astype(float, copy=False), counts))
    if not axes:
        return True
    step, *finest = min(axes, key=lambda axis: axis[0])
    return step_of_levels([finest]) < 2 * step


def _typical(counts):
    """How often the value of the median point occurs."""
    counts = np.sort(counts)
    return counts[np.searchsorted(np.cumsum(counts), counts.sum() / 2)]


def _lattice_step(gaps, rounding):
    gaps, limits = np.sort(gaps), RoundingLimits()
    # If a lattice has at least about as many points as values, its short gaps are one step.
    step = gaps[int(limits.shorter * gaps.size)]
    near = gaps[(gaps >= 0.5 * step) & (gaps <= limits.longest * step)] / step
    # Of continuous coordinates few gaps are this short, and one in 25 is a whole number of steps.
    if near.size < max(limits.fewest_gaps, 0.5 * gaps.size):
        return 0.0
    # The step was guessed from short gaps; those of one step tell it better.
    whole = _whole(near, rounding / step)
    if whole.mean() < limits.on_lattice:
        return 0.0
    return float(np.median(near[whole & (np.rint(near) == 1)]) * step)


def _whole(multiples, error=0.0):
    tolerance = RoundingLimits().tolerance + error
    return (np.abs(multiples - np.rint(multiples)) <= tolerance) & (multiples > 0.5)


def coarse_warning(index):
    """The warning that float32 coordinates behind this `NeighborIndex` are too coarse, or None."""
    points = index.points
    step = max(1, len(points) // 1000)
    sample = points[::step]
    if index.n_neighbors is None:
        radius = np.linalg.norm(sample - points[0], axis=1)
    else:
        rows = (slice(row, row + 1) for row in range(0, len(points), step))
        around = (index.query_own(row, keep=False) for row in rows)
        last = points[[one.indices[0, one.sizes[0] - 1] for one in around]]
        radius = np.linalg.norm(last - sample, axis=1)
    # Medians, which a few far points do not move.
    radius, largest = float(np.median(radius)), float(np.median(np.abs(sample).max(axis=1)))
    rounding = float(np.spacing(np.float32(largest)))
    if radius > 0 and rounding > RoundingLimits().coarse * radius:
        return CoarseCoordinatesWarning(largest, rounding, radius)
    return None
