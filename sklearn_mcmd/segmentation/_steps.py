"""The steps of `RegionGrowing` that follow growth, of points in memory or on disk."""

import numpy as np

from sklearn_mcmd.runtime._progress import progress_part
from sklearn_mcmd.segmentation._assign_points import Claims
from sklearn_mcmd.segmentation._creases import divide_at_creases
from sklearn_mcmd.segmentation._cylinder_parts import CylinderParts
from sklearn_mcmd.segmentation._graph import GrowthRules
from sklearn_mcmd.segmentation._merge_coplanar import join_coplanar
from sklearn_mcmd.segmentation._narrow_faces import RestFaces
from sklearn_mcmd.segmentation._region_sums import region_sizes, relabeled

__all__ = ["finish_regions", "rules_of"]


def rules_of(growing):
    """The `GrowthRules` of a `RegionGrowing`."""
    cosine = np.cos(np.radians(growing.max_angle))
    return GrowthRules(cosine, growing.max_distance, growing.max_gap, growing.mutual)


def finish_regions(labels, index, planes, floor, copies, growing, n_jobs=None):
    """The regions of a `RegionGrowing` from those that have grown; the largest is 0, -1 is none.

    The planes are of ``index.points``; what tells of their faces may be changed. `floor` is as by
    `least_scales`, `copies` (n,) are the points at each place, and `growing` has the parameters.
    """
    rules, in_space = rules_of(growing), index.points.shape[1] == 3
    labels = _renumber(labels, copies, growing.min_region_size)
    if growing.find_narrow_faces:
        with progress_part(0.0, 0.45, "narrow faces"):
            labels, planes = RestFaces(index, floor, rules, n_jobs).grow(labels, planes)
            labels = _renumber(labels, copies, growing.min_region_size)
    claims = Claims(index, planes, rules, n_jobs)
    with progress_part(0.45, 0.65, "joining regions"):
        if growing.divide_at_creases and in_space:
            labels = divide_at_creases(labels, index, planes, rules, n_jobs)
            labels = _renumber(labels, copies, growing.min_region_size)
        if growing.assign_unlabeled:
            labels = _renumber(claims.absorb_fragments(labels), copies)
        if growing.join_coplanar:
            labels = join_coplanar(index.points, labels, planes, n_jobs)
    curved = growing.join_curved and in_space
    cylinders = CylinderParts(index, planes, floor, growing.max_gap, n_jobs)
    with progress_part(0.65, 1.0, "cylinders and the rest"):
        if growing.assign_unlabeled:
            labels = cylinders.grow(labels) if curved else labels
            labels = claims.assign_unlabeled(labels, cylinders.curved)
        if curved:  # once gaps between parts are filled
            labels = cylinders.join(labels)
    return _renumber(labels, copies)


def _renumber(labels, copies, min_size=1):
    """Labels in order of size, 0 for the largest region; -1 for regions below `min_size`."""
    sizes = region_sizes(labels, int(labels.max(initial=-1)) + 1, copies)
    order = np.argsort(-sizes, kind="stable")
    order = order[sizes[order] >= max(min_size, 1)]
    number = np.full(len(sizes) + 1, -1, dtype=labels.dtype)  # -1 is the last
    number[order] = np.arange(len(order))
    return relabeled(labels, number)
