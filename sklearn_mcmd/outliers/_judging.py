"""A point's verdict from the planes around it: distance, ruler, borrowed plane, density."""

from typing import NamedTuple

import numpy as np

from sklearn_mcmd.planes._around import quantile, ratio
from sklearn_mcmd.planes._explaining import Credibility, ExplainLimits, credible_planes, explain

__all__ = ["COMMON", "HALF", "LOCAL", "OWN", "Judge", "Judged", "judge"]

OWN, LOCAL, COMMON = 0, 1, 2  # rulers
# Share of credible planes among the neighbors that makes a surface.
SURFACE = 0.5
QUARTER = 0.25
HALF = 0.5
NEAREST = ExplainLimits(likely=False)


class Judge(NamedTuple):
    """By what points are measured."""

    ruler: int  # OWN, LOCAL or COMMON
    noise: float  # of COMMON
    cutoff: float
    borrow: bool
    credible: Credibility
    surface: float = SURFACE
    quarter: float = QUARTER
    half: float = HALF


class Judged(NamedTuple):
    """Verdicts of queries (m,).

    scores : distance to the own or a borrowed plane in standard deviations
    owners : row whose plane it is, -1 for the own
    usual_spacing : median spacing of the neighbors
    """

    scores: np.ndarray
    owners: np.ndarray
    usual_spacing: np.ndarray


def judge(options, queries, own, distance, least, neighborhoods, fitted, credible, compiled):
    """Measure queries (m, d) by their own planes and those of their neighbors.

    Parameters
    ----------
    options : Judge
    queries : ndarray of float64 of shape (m, d)
    own : Planes
        Of the queries.
    distance : ndarray of shape (m,)
        Robust distances of the queries to their own planes.
    least : ndarray of shape (m,)
        Least standard deviation of a query: what rounding of its coordinates amounts to.
    neighborhoods : Neighborhoods
        Rows of `fitted`.
    fitted : Planes
    credible : ndarray of bool of shape (n,)
        Which of these may explain other points.
    compiled : bool

    Returns
    -------
    Judged
    """
    m = len(queries)
    if compiled:
        from sklearn_mcmd.outliers._judging_numba import rule_neighborhoods

        ruler, usual = np.empty(m), np.empty(m)
        rule_neighborhoods(options, own, neighborhoods, fitted, credible, ruler, usual)
    else:
        valid = neighborhoods.valid
        ruler = _ruler(options, own, neighborhoods.indices, valid, fitted, credible)
        usual = quantile(fitted.spacing[neighborhoods.indices], valid, HALF)
    scores, owners = distance, np.full(m, -1)
    if options.ruler != OWN:
        height = np.einsum("md,md->m", queries - own.centroids, own.normals)
        scores = ratio(np.abs(height), np.hypot(ruler, least))
    if options.borrow:
        scores = scores.copy()
        far = np.flatnonzero(scores > options.cutoff)
        lenders = fitted
        if options.ruler == COMMON:
            lenders = fitted._replace(scale=np.full(len(fitted.scale), options.noise))
        owner, borrowed = explain(
            queries[far], neighborhoods.take(far), lenders, NEAREST, credible,
            least[far], np.full(len(far), np.inf), compiled,
        )  # fmt: skip
        nearer = borrowed < scores[far]
        scores[far[nearer]], owners[far[nearer]] = borrowed[nearer], owner[nearer]
    return Judged(scores, owners, usual)


def _ruler(options, own, indices, valid, fitted, credible):
    """Standard deviation by which the distance to the own plane is measured."""
    if options.ruler == OWN:
        return own.scale
    if options.ruler == COMMON:
        return np.full(len(own.scale), options.noise)
    # A credible plane is its own ruler: it knows its curvature. Among credible planes any
    # other would excuse by its roughness what they don't; where there are none, as in
    # foliage, roughness is what is usual.
    scale = own.scale
    usual = quantile(fitted.scale[indices], valid, HALF)
    is_credible = credible_planes(
        own, quantile(fitted.radius[indices], valid, HALF), options.credible
    )
    n_credible = (credible[indices] & valid).sum(axis=1)
    on_surface = n_credible >= SURFACE * valid.sum(axis=1)
    other = np.where(on_surface, np.minimum(scale, usual), np.maximum(scale, usual))
    least = quantile(fitted.scale[indices], valid, QUARTER)
    return np.where(is_credible & on_surface, np.maximum(scale, least), other)
