"""Quantiles and extents of neighborhoods, compiled; any dimension."""

import numpy as np

from sklearn_mcmd.planes._moments_numba import kth_smallest
from sklearn_mcmd.runtime._kernels import kernel


def quantile_of_neighbors(all_values, neighborhoods, q, out):
    """Fill `out` with the q-quantile of the neighbors' values."""
    values = np.empty(neighborhoods.indices.shape[1])
    # Python makes the arrays, since Numba takes long to compile what makes them.
    _quantile_of_neighbors(all_values, neighborhoods, q, values, values.view(np.int64), out)


@kernel(cache=True)
def _quantile_of_neighbors(all_values, neighborhoods, q, values, keys, out):
    indices, sizes = neighborhoods.indices, neighborhoods.sizes
    for i in range(len(out)):
        out[i] = _quantile(all_values, indices[i], sizes[i], q, values, keys)


@kernel(cache=True)
def extents_of_neighborhoods(points, queries, neighborhoods, spacing, radius):
    """Fill the mean distance of the neighbors and the distance of the last one."""
    indices, sizes = neighborhoods.indices, neighborhoods.sizes
    for i in range(len(queries)):
        total = last = 0.0
        for j in range(sizes[i]):
            square = 0.0
            for axis in range(queries.shape[1]):
                gap = points[indices[i, j], axis] - queries[i, axis]
                square += gap * gap
            total += np.sqrt(square)
            last = max(last, square)
        spacing[i], radius[i] = total / sizes[i], np.sqrt(last)


@kernel
def _quantile(all_values, neighbors, size, q, values, keys):
    """The value at the rank int(q * size), from 0, of numbers that are not negative.

    `keys` are the bits of `values` as integers. These sort like the numbers.
    """
    for j in range(size):
        values[j] = all_values[neighbors[j]]
    keys[0] = kth_smallest(keys, size, np.int64(q * size) + 1)
    return values[0]
