"""What is usual among the neighbors: quantiles, extents, and quotients that stay finite."""

import numpy as np

from sklearn_mcmd.planes._compiling import compiled_function

__all__ = ["extents", "quantile", "quantile_around", "ratio"]


def quantile_around(values, neighborhoods, q, compiled):
    """The q-quantile (from above) of the neighbors' values of each neighborhood: (m,)."""
    quantile_of_neighbors = _compiled("quantile_of_neighbors") if compiled else None
    if quantile_of_neighbors is not None:
        out = np.empty(len(neighborhoods.sizes))
        quantile_of_neighbors(values, neighborhoods, q, out)
        return out
    return quantile(values[neighborhoods.indices], neighborhoods.valid, q)


def extents(points, queries, neighborhoods, compiled):
    """Mean distance (m,) of the neighbors from queries (m, d), and distance of the last one."""
    extents_of_neighborhoods = _compiled("extents_of_neighborhoods") if compiled else None
    if extents_of_neighborhoods is not None:
        spacing, radius = np.empty(len(queries)), np.empty(len(queries))
        extents_of_neighborhoods(points, queries, neighborhoods, spacing, radius)
        return spacing, radius
    gaps = points[neighborhoods.indices] - queries[:, None]
    distances = np.sqrt(np.einsum("mkd,mkd->mk", gaps, gaps))
    distances[~neighborhoods.valid] = 0.0
    return distances.sum(axis=1) / neighborhoods.sizes, distances.max(axis=1)


def ratio(numerator, denominator):
    """Quotients, limited to finite numbers; 0 / 0 is 0."""
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        quotient = numerator / denominator
    return np.nan_to_num(quotient, nan=0.0, posinf=np.finfo(float).max)


def quantile(values, valid, q):
    """The q-quantile (from above) of the valid values of each row of (m, k)."""
    if valid.all():
        position = int(q * values.shape[1])
        return np.partition(values, position, axis=1)[:, position]
    ordered = np.sort(np.where(valid, values, np.inf), axis=1)
    return ordered[np.arange(len(values)), (q * valid.sum(axis=1)).astype(int)]


def _compiled(name):
    return compiled_function("planes._around_numba", name)
