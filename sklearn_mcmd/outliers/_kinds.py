"""Kinds of outliers: single points, groups, and what lies on no surface."""

import numpy as np

__all__ = ["KINDS", "kinds_of_outliers", "plane_scales"]

KINDS = ("isolated", "in groups", "off surfaces")


def plane_scales(detector):
    """Standard deviations of the planes of a fitted detector; None where each point is judged by
    its own plane alone."""
    cloud = detector._cloud
    return None if cloud.own_planes_only else cloud.planes.scale


def kinds_of_outliers(detector):
    """Why each fitted point is an outlier: its place in `KINDS`, and -1 of all others.

    Isolated points are farther from their neighbors than the cutoff, in usual spacings. Those in
    groups are not, but their group stands off by more than the cutoff. The others lie on no
    surface, and ``strictness="surfaces"`` flags them for that alone, as does the paper's form.
    """
    cloud, is_outlier = detector._cloud, detector.scores_ < detector.offset_
    kinds = np.where(is_outlier, np.int8(2), np.int8(-1))
    if cloud.own_planes_only:
        return kinds
    index, off_surface = cloud.model.index, cloud.off_surface
    of_places = np.full(len(index.points), 2, np.int8)
    cutoff = -detector.offset_
    of_places[off_surface.rows[off_surface.separation > cutoff]] = 1
    of_places[off_surface.rows[off_surface.isolation > cutoff]] = 0
    return np.where(is_outlier, of_places[index.places], kinds)
