"""What is usual among the neighbors: quantiles of their values, and quotients that stay finite."""

import numpy as np

__all__ = ["quantile", "quantile_around", "ratio", "valid_members"]


def quantile_around(values, indices, sizes, q, compiled):
    """The q-quantile (from above) of the neighbors' values, for each row of indices (m, k)."""
    if compiled:
        from sklearn_mcmd.planes._around_numba import quantile_of_neighbors

        out = np.empty(len(indices))
        quantile_of_neighbors(values, indices, sizes, q, out)
        return out
    return quantile(values[indices], valid_members(indices, sizes), q)


def ratio(numerator, denominator):
    """Quotients, 0 / 0 being 0, limited to finite numbers."""
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


def valid_members(indices, sizes):
    """Which members of neighborhoods (m, k) are no padding: bool (m, k)."""
    return np.arange(indices.shape[1]) < sizes[:, None]
