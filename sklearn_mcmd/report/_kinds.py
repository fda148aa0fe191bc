"""Kinds of outliers: single points, groups, and what lies on no surface."""

import numpy as np

from sklearn_mcmd.outliers._detector import judged_cloud

KINDS = ("isolated", "in groups", "off surfaces")


def plane_scales(detector):
    """Standard deviations of the planes of a fitted detector; None where each point is judged by
    its own plane alone."""
    cloud = judged_cloud(detector)
    return None if cloud.own_planes_only else cloud.planes.scale


def kinds_of_outliers(detector):
    """Why each fitted point is an outlier: its place in `KINDS`, and -1 of all others.

    Isolated points are farther from their neighbors than the cutoff, in usual spacings. Those in
    groups are not, but their group stands off by more than the cutoff. The others lie on no
    surface, and ``strictness="surfaces"`` flags them for that alone, as does the paper's form.
    """
    is_outlier, cutoff = detector.scores_ < detector.offset_, -detector.offset_
    if detector.isolation_ is None:
        return np.where(is_outlier, np.int8(2), np.int8(-1))
    apart = detector.isolation_ > cutoff, detector.separation_ > cutoff
    return np.select([~is_outlier, *apart], [np.int8(-1), np.int8(0), np.int8(1)], np.int8(2))


def reasons_of(detector, rows):
    """Why each of these rows is an outlier, in words with numbers: a list of str."""
    cloud, kinds = judged_cloud(detector), kinds_of_outliers(detector)
    groups = detector.group_index_
    at = np.searchsorted(cloud.off_surface.rest.rows, cloud.model.index.places)
    sizes, far = np.bincount(groups + 1), detector.separation_ > -detector.offset_
    reasons = []
    for row in rows:
        kind, n, score = kinds[row], sizes[groups[row] + 1], -detector.scores_[row]
        away = (detector.separation_ if kind == 1 else detector.isolation_)[row]
        who = f"group of {n:,}" if kind == 1 else f"one of {n:,} together"
        who = who if n > 1 and groups[row] >= 0 else "single point"
        if kind == 2 or score < away:
            away, unit = score, "standard deviations off a surface"
        elif kind == 1 and n > 1:
            unit = "of its sizes away"
        else:
            unit = f"usual spacings from {'anything' if far[row] else 'its neighbors'}"
        words = f"{who}, {float(f'{away:.2g}'):,g} {unit}"
        if kind == 2 and groups[row] >= 0:
            words = "off every surface"
        elif kind == 0 and cloud.rays is not None and cloud.rays.rest.by_sheet[at[row]]:
            words = "on a sheet of rays"
        reasons.append(words)
    return reasons
