"""What is usual among the neighbors: quantiles, extents, and quotients that stay finite."""

import numpy as np

from sklearn_mcmd.runtime._compiling import compiled_function

__all__ = ["extents", "quantile_around", "ratio"]

MODULE = "planes._around_numba"
LARGEST = 1e300  # of a quotient: the mean of two is finite, as is a small multiple


def quantile_around(values, neighborhoods, q):
    """The q-quantile (from above) of the neighbors' values of each neighborhood: (m,)."""
    out = np.empty(len(neighborhoods.sizes))
    compiled_function(MODULE, "quantile_of_neighbors")(values, neighborhoods, q, out)
    return out


def extents(points, queries, neighborhoods):
    """Mean distance (m,) of the neighbors from queries (m, d), and distance of the last one."""
    spacing, radius = np.empty((2, len(queries)))
    measure = compiled_function(MODULE, "extents_of_neighborhoods")
    measure(points, queries, neighborhoods, spacing, radius)
    return spacing, radius


def ratio(numerator, denominator):
    """Quotients, limited to `LARGEST`; 0 / 0 is 0."""
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        quotient = numerator / denominator
    return np.nan_to_num(quotient, nan=0.0, posinf=LARGEST, neginf=-LARGEST)
