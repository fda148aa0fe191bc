"""Whose plane explains a point? Every stage searches its neighbors' planes here."""

from typing import NamedTuple

import numpy as np

from sklearn_mcmd.runtime._compiling import compiled_function

__all__ = ["ExplainLimits", "explain"]

# Costs that differ by no more than this share of one plus the cost are equal, and the nearest of
# equal planes is the owner: points that were lent one plane differ by rounding.
TIE = 1e-9


class ExplainLimits(NamedTuple):
    """When a plane explains a point. All stages read it here."""

    explained: float = 3.0  # standard deviations of the plane within which it explains points


def explain(queries, candidates, planes, usable, least, likely=False):
    """The plane of its neighbors that explains each query best, however far it is.

    This is the nearest plane, in standard deviations, or the most `likely` one, by Bayes' rule. If
    a point lies on a flat and on a rough plane, the flat one then wins. The prior probability of a
    plane is the share of its neighborhood that it keeps.

    A plane reaches as far from its centroid as its neighborhood does from its point. Queries (m, d)
    are float64, and candidates are rows of `planes`, of which those that are `usable` (bool) may
    explain points. `least` (m,) is a standard deviation that is added to each plane's, for each
    query.

    Returns the owners (m,), rows of `planes`, -1 where none reaches the query, and the distances
    (m,) from the owner's plane in standard deviations, inf where there is none.
    """
    owners, distances = np.empty(len(queries), dtype=np.int64), np.empty(len(queries))
    find = compiled_function("planes._explaining_numba", "explain_queries")
    find(queries, candidates, planes, usable, least, likely, TIE, owners, distances)
    return owners, distances
