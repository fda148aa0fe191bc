"""Whose plane explains a point? Every stage searches its neighbors' planes here."""

from typing import NamedTuple

import numpy as np

from sklearn_mcmd.planes._compiling import compiled_function

__all__ = ["ExplainLimits", "explain"]


class ExplainLimits(NamedTuple):
    """Conditions under which a plane explains a point.

    likely : bool
        Whether the owner is the most likely plane, by Bayes' rule. If a point lies on a flat and on
        a rough plane, the flat one wins. The prior probability of a plane is the share of its
        neighborhood that it keeps. Otherwise the owner is the nearest plane, in standard
        deviations.
    explained : float
        Number of its standard deviations within which a plane explains points. Planes that explain
        the point come first, others only where there is none.
    tie : float
        Costs that differ by no more than this share of one plus the cost are equal. The nearest
        of equal planes is the owner: points that were lent one plane differ by rounding.
    """

    likely: bool
    explained: float = np.inf
    tie: float = 1e-9


def explain(queries, candidates, planes, limits, usable, least, most, compiled):
    """The plane of its neighbors that explains each query best.

    A plane reaches as far from its centroid as its neighborhood does from its point.

    Parameters
    ----------
    queries : ndarray of float64 of shape (m, d)
    candidates : Neighborhoods
        Rows of `planes`.
    planes : Planes
    limits : ExplainLimits
    usable : ndarray of bool
        Which of the planes may explain points.
    least : ndarray of shape (m,)
        Standard deviation that is added to each plane's, for each query.
    most : ndarray of shape (m,)
        Planes with a larger standard deviation come last.
    compiled : bool
        Whether to use compiled code, if Numba is there; the owners are the same.

    Returns
    -------
    owners : ndarray of int of shape (m,)
        Rows of `planes`, -1 where none reaches the query.
    distances : ndarray of shape (m,)
        From the owner's plane in standard deviations; inf where there is none.
    """
    explain_queries = _compiled("explain_queries") if compiled else None
    if explain_queries is not None:
        owners, distances = np.empty(len(queries), dtype=np.int64), np.empty(len(queries))
        explain_queries(
            queries, candidates, planes, limits, usable, (least, most), owners, distances
        )
        return owners, distances
    indices = candidates.indices
    deviations = queries[:, None] - planes.centroids[indices]
    heights = np.einsum("mkd,mkd->mk", deviations, planes.normals[indices])
    reach = np.sqrt(np.einsum("mkd,mkd->mk", deviations, deviations))
    variance = np.square(planes.scale[indices]) + np.square(least)[:, None]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        distances = np.abs(heights) / np.sqrt(variance)
        cost = distances
        if limits.likely:
            cost = 0.5 * (np.log(variance) + np.square(distances))
            cost = cost - np.log(planes.kept[indices])
    reached = candidates.valid & usable[indices] & (reach <= planes.radius[indices])
    if limits.likely:
        reached &= planes.scale[indices] > 0
    cost = np.where(reached, np.nan_to_num(cost, nan=np.inf, posinf=np.inf), np.inf)
    first = (variance <= np.square(most)[:, None]) & (distances <= limits.explained)
    cost_of_first = np.where(first, cost, np.inf)
    some = np.isfinite(cost_of_first).any(axis=1)
    cost[some] = cost_of_first[some]
    best, each = np.zeros(len(queries), dtype=int), np.arange(len(queries))
    for j in range(1, cost.shape[1]):
        with np.errstate(invalid="ignore"):
            less = cost[:, j] < cost[each, best] - limits.tie * (1.0 + np.abs(cost[:, j]))
        best[less] = j
    found = np.isfinite(cost[each, best])
    owners = np.where(found, indices[each, best], -1)
    return owners, np.where(found, distances[each, best], np.inf)


def _compiled(name):
    return compiled_function("planes._explaining_numba", name)
