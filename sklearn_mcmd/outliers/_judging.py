"""A point's verdict from the planes around it: distance, ruler, borrowed plane, density.

The NumPy form, for any dimension and small clouds; ``_judging_numba`` repeats it compiled.
"""

from dataclasses import dataclass

import numpy as np

from sklearn_mcmd.planes._around import quantile, ratio, valid_members
from sklearn_mcmd.planes._explaining import credible_planes, nearest_credible_planes

__all__ = ["OWN", "Judge", "Judged", "Surroundings", "judge"]

OWN, LOCAL, COMMON = 0, 1, 2  # rulers
# Share of credible planes among the neighbors that makes a surface.
SURFACE = 0.5
QUARTER = 0.25
HALF = 0.5


@dataclass
class Judge:
    """By what points are measured."""

    ruler: int  # OWN, LOCAL or COMMON
    noise: float  # of COMMON
    cutoff: float
    borrow: bool
    most_rough: float  # largest ratio of scale to radius of a surface


@dataclass
class Surroundings:
    """What is known of the fitted points, by row.

    planes : LocalPlanes
    spacing : mean distance of the neighbors
    radius : distance of the last neighbor
    credible : whether the plane may explain other points
    """

    planes: object
    spacing: np.ndarray
    radius: np.ndarray
    credible: np.ndarray


@dataclass
class Judged:
    """Verdicts of queries (m,).

    scores : distance to the own or a borrowed plane in standard deviations
    owners : row whose plane it is, -1 for the own
    usual_spacing : median spacing of the neighbors
    """

    scores: np.ndarray
    owners: np.ndarray
    usual_spacing: np.ndarray


def judge(options, queries, planes, radius, least, indices, sizes, fitted, compiled):
    """Measure queries (m, d) by their own planes and those of their neighbors.

    Parameters
    ----------
    options : Judge
    queries : ndarray of float64 of shape (m, d)
    planes : LocalPlanes of the queries
    radius : ndarray of shape (m,)
    least : ndarray of shape (m,)
        Least standard deviation of a query: what rounding of its coordinates amounts to.
    indices : ndarray of int of shape (m, k)
        Rows of `fitted`.
    sizes : ndarray of int of shape (m,)
    fitted : Surroundings
    compiled : bool

    Returns
    -------
    Judged
    """
    if not compiled:
        return _judge_numpy(options, queries, planes, radius, least, indices, sizes, fitted)
    from sklearn_mcmd.outliers._judging_numba import judge_neighborhoods

    m = len(queries)
    judged = Judged(np.empty(m), np.empty(m, dtype=np.int64), np.empty(m))
    judge_neighborhoods(
        queries,
        planes.distance,
        planes.scale,
        planes.centroids,
        planes.normals,
        planes.removed_fraction,
        radius,
        least,
        indices,
        sizes,
        fitted.planes.centroids,
        fitted.planes.normals,
        fitted.planes.scale,
        fitted.spacing,
        fitted.radius,
        fitted.credible,
        options.ruler,
        options.noise,
        options.cutoff,
        options.borrow,
        options.most_rough,
        judged.scores,
        judged.owners,
        judged.usual_spacing,
    )
    return judged


def _judge_numpy(options, queries, planes, radius, least, indices, sizes, fitted):
    valid = valid_members(indices, sizes)
    own = np.abs(np.einsum("md,md->m", queries - planes.centroids, planes.normals))
    ruler = np.maximum(_ruler(options, planes, radius, indices, valid, fitted), least)
    scores = planes.distance.copy() if options.ruler == OWN else ratio(own, ruler)
    owners = np.full(len(queries), -1)
    if options.borrow:
        far = np.flatnonzero(scores > options.cutoff)
        others = fitted.planes.scale[indices[far]]
        if options.ruler == COMMON:
            others = np.full_like(others, options.noise)
        others = np.maximum(others, least[far, None])
        borrowed, owner = nearest_credible_planes(
            queries[far], indices[far], valid[far], fitted, others
        )
        nearer = borrowed < scores[far]
        scores[far[nearer]] = borrowed[nearer]
        owners[far[nearer]] = owner[nearer]
    return Judged(scores, owners, quantile(fitted.spacing[indices], valid, HALF))


def _ruler(options, planes, radius, indices, valid, fitted):
    """Standard deviation by which the distance to the own plane is measured."""
    if options.ruler == OWN:
        return planes.scale
    if options.ruler == COMMON:
        return np.full(len(radius), options.noise)
    # A credible plane is its own ruler: it knows its curvature. Among credible planes any
    # other would excuse by its roughness what they don't; where there are none, as in
    # foliage, roughness is what is usual.
    scale = planes.scale
    around = quantile(fitted.radius[indices], valid, HALF)
    usual = quantile(fitted.planes.scale[indices], valid, HALF)
    credible = credible_planes(scale, planes.removed_fraction, radius, around, options.most_rough)
    n_credible = (fitted.credible[indices] & valid).sum(axis=1)
    on_surface = n_credible >= SURFACE * valid.sum(axis=1)
    other = np.where(on_surface, np.minimum(scale, usual), np.maximum(scale, usual))
    least = quantile(fitted.planes.scale[indices], valid, QUARTER)
    return np.where(credible & on_surface, np.maximum(scale, least), other)
