"""The steps of `RegionGrowing` that follow growth, of points in memory or on disk."""

from typing import NamedTuple

import numpy as np

from sklearn_mcmd.runtime._progress import progress_part
from sklearn_mcmd.segmentation._assign_points import Claims
from sklearn_mcmd.segmentation._cylinder_parts import NO_SHAPES, CylinderParts
from sklearn_mcmd.segmentation._graph import GrowthRules
from sklearn_mcmd.segmentation._merge_coplanar import join_coplanar
from sklearn_mcmd.segmentation._narrow_faces import NarrowFaces
from sklearn_mcmd.segmentation._region_division import divide_at_creases
from sklearn_mcmd.segmentation._region_sums import region_sizes, relabeled


class GrowthSteps(NamedTuple):
    """What refines the paper's growth; the ablation switches single steps off."""

    mutual: bool = True  # planes explain each other
    find_narrow_faces: bool = True
    divide_at_creases: bool = True
    join_coplanar: bool = True
    join_curved: bool = True
    assign_unlabeled: bool = True


def steps_of(growing):
    """The `GrowthSteps` of a `RegionGrowing`: all of them, or none."""
    return GrowthSteps() if growing.refine else GrowthSteps(*[False] * len(GrowthSteps._fields))


def rules_of(growing):
    """The `GrowthRules` of a `RegionGrowing`."""
    cosine = np.cos(np.radians(growing.max_angle))
    return GrowthRules(cosine, growing.max_distance, growing.max_gap, steps_of(growing).mutual)


def finish_regions(labels, index, planes, floor, copies, growing, n_jobs=None):
    """The regions of a `RegionGrowing` from those that have grown; the largest is 0, -1 is none.

    The planes are of ``index.points``; what tells of their faces may be changed. `floor` is as by
    `least_scales`, `copies` (n,) are the points at each place, and `growing` has the parameters.
    """
    rules, steps = rules_of(growing), steps_of(growing)
    in_space = index.points.shape[1] == 3
    labels = _renumber(labels, copies, growing.min_region_size)
    if steps.find_narrow_faces:
        with progress_part(0.0, 0.45, "narrow faces"):
            faces = NarrowFaces(index=index, planes=planes, floor=floor, rules=rules, n_jobs=n_jobs)
            labels = faces.grow(labels)
            labels = _renumber(labels, copies, growing.min_region_size)
    claims = Claims(index, planes, rules, n_jobs)
    with progress_part(0.45, 0.65, "joining regions"):
        if steps.divide_at_creases and in_space:
            labels = divide_at_creases(labels, index, planes, rules, n_jobs)
            labels = _renumber(labels, copies, growing.min_region_size)
        if steps.assign_unlabeled:
            labels = _renumber(claims.absorb_fragments(labels), copies)
        if steps.join_coplanar:
            labels = join_coplanar(index.points, labels, planes, n_jobs)
    curved = steps.join_curved and in_space
    cylinders = CylinderParts(
        index=index, planes=planes, floor=floor, max_gap=growing.max_gap or np.inf, n_jobs=n_jobs
    )
    shapes = NO_SHAPES
    with progress_part(0.65, 1.0, "cylinders and the rest"):
        if steps.assign_unlabeled:
            labels, shapes = cylinders.grow(labels) if curved else (labels, shapes)
            labels = claims.assign_unlabeled(labels, shapes.curved)
        if curved:  # once gaps between parts are filled
            labels = cylinders.join(labels, shapes)
    return _renumber(labels, copies)


def _renumber(labels, copies, min_size=1):
    """Labels in order of size, 0 for the largest region; -1 for regions below `min_size`."""
    sizes = region_sizes(labels, int(labels.max(initial=-1)) + 1, copies)
    order = np.argsort(-sizes, kind="stable")
    order = order[sizes[order] >= max(min_size, 1)]
    number = np.full(len(sizes) + 1, -1, dtype=labels.dtype)  # -1 is the last
    number[order] = np.arange(len(order))
    return relabeled(labels, number)
