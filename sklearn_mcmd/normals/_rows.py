"""Neighborhoods that are one row of a scan: normals that noise decides, and their errors."""

from numbers import Integral
from typing import NamedTuple

import numpy as np

from sklearn_mcmd._errors import warn
from sklearn_mcmd.normals._adaptive_k import SizeLimits, across_rows, angles
from sklearn_mcmd.planes._neighborhoods import Neighborhoods
from sklearn_mcmd.planes._principal_planes import are_rows
from sklearn_mcmd.planes._quadrics import whole_planes
from sklearn_mcmd.runtime._chunks import each_slice, slices
from sklearn_mcmd.runtime._progress import progress_part

AT_ONCE = 128  # points whose many neighbors are searched for at once


class RowDoubtLimits(NamedTuple):
    """When neighborhoods of one row count, and what shows that they are of a surface."""

    wider: int = 4  # times as many neighbors, of which a row of a surface is none
    share: float = 0.02  # of the points; thin strips and poles are fewer
    sample: int = 1_000  # points that tell the share


def doubted(planes, points, index, n_jobs):
    """The planes of points (n, 3) with errors that hold how far normals may be off because
    neighborhoods are rows: by the angle to the plane of four times as many neighbors, or by all if
    these are a row as well."""
    errors = planes.normal_error.copy()
    asked = np.flatnonzero(are_rows(planes.eigenvalues))
    k = min(RowDoubtLimits().wider * index.n_neighbors, len(index.points))

    def task(part):
        rows = asked[part]
        normals, rowlike = _whole_normals(index, points[rows], k)
        tilt = np.where(rowlike, 90.0, angles(normals, planes.normals[rows]))
        errors[rows] = np.maximum(errors[rows], tilt)

    with progress_part(1.0, 1.0):
        each_slice(len(asked), index.chunk, task, n_jobs)
    return planes._replace(normal_error=errors)


def may_be_rows(estimator):
    """Whether a neighborhood of an estimator in 3D may be one row of a scan: "auto" takes more, of
    few points many are rows by chance, and hundreds see several rows."""
    k, limits = estimator.n_neighbors, SizeLimits()
    if not isinstance(k, Integral) or estimator.radius is not None:
        return False
    return limits.least <= int(k) <= limits.most


def warn_of_rows(index):
    """Warn if the neighborhoods of many points are one row of a surface each."""
    limits, n, k = RowDoubtLimits(), len(index.points), index.n_neighbors
    sample = index.points[:: -(-n // limits.sample)]
    is_row = _whole_normals(index, sample, k)[1]
    # A row of a pole or a wire stays one.
    is_row &= ~_whole_normals(index, sample, min(limits.wider * k, n))[1]
    if np.mean(is_row) < limits.share:
        return
    share, sample, size = np.mean(is_row), sample[is_row], k
    while 2 * size < n and np.mean(_whole_normals(index, sample, 2 * size)[1]) > limits.share:
        size *= 2
    warn(
        f"the $n_neighbors={k} nearest of {100 * share:.0f} % of the points lie in one "
        "row of the scan, which any normal across it fits; normal_error_ says where. Take "
        f"$n_neighbors='auto', or {across_rows(size):.0f}."
    )


def _whole_normals(index, points, k):
    """Normals (m, d) of the planes of the k nearest of places, and whether these are rows."""
    normals, rowlike = np.empty(points.shape), np.empty(len(points), bool)
    for rows in slices(len(points), AT_ONCE):
        nearest = index.cloud.nearest(points[rows], k)[1]
        around = Neighborhoods(nearest, np.full(len(nearest), k))
        planes, *_ = whole_planes(index.points, around)
        normals[rows], rowlike[rows] = planes.normals, are_rows(planes.eigenvalues)
    return normals, rowlike
