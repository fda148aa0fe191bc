"""What is usual among the neighbors: quantiles, radii, noise; quotients that stay finite."""

from typing import NamedTuple

import numpy as np

from sklearn_mcmd.runtime._compiling import compiled_function

MODULE = "planes._moments_numba"
LARGEST = 1e300  # of a quotient: the mean of two is finite, as is a small multiple
LOWER_BITS = 36  # of a number's 64, which do not count when values are sorted into bins


class NoiseLimits(NamedTuple):
    """When a plane is noisier than others."""

    n_errors: float = 3.0  # standard errors by which it may be noisier than is usual around


def quantile_around(values, neighborhoods, q):
    """The q-quantile (from above) of the neighbors' values of each neighborhood: (m,)."""
    out, work = np.empty(len(neighborhoods.sizes)), np.empty(neighborhoods.indices.shape[1])
    fill = compiled_function(MODULE, "quantile_of_neighbors")
    fill(values, neighborhoods, q, work, work.view(np.int64), out)
    return out


def quantile_of(parts, q):
    """What `numpy.quantile` returns of all values, float64, of the arrays of ``parts()``."""
    n = sum(map(len, parts()))
    low = int((n - 1) * q)
    return np.quantile(_at_ranks(parts, [low, min(low + 1, n - 1)]), (n - 1) * q - low)


def _at_ranks(parts, ranks):
    """Values at ranks among all of the arrays, float64 (n,), that ``parts()`` iterates over, in
    ascending order. NaN if one is.

    They are counted in bins, so that only those of the bins of these ranks are in memory.
    """
    keys, counts = np.empty(0, np.int64), np.empty(0, np.int64)
    for values in parts():
        if np.isnan(values).any():
            return np.nan
        new = np.unique(_bins(values), return_counts=True)
        keys, places = np.unique(np.concatenate([keys, new[0]]), return_inverse=True)
        counts = np.bincount(places, np.concatenate([counts, new[1]])).astype(np.int64)
    # Second pass: only the bins of the wanted ranks are sorted.
    of = np.searchsorted(np.cumsum(counts), ranks, side="right")
    chosen = np.zeros(len(keys), bool)
    chosen[of] = True
    left_out = np.cumsum(np.where(chosen, 0, counts))
    in_bins = np.concatenate([v[chosen[np.searchsorted(keys, _bins(v))]] for v in parts()])
    return np.sort(in_bins)[ranks - left_out[of]]


def _bins(values):
    """Numbers of 28 bits that ascend as the values do."""
    bits = (values + 0.0).view(np.int64)  # -0.0 and 0.0 are equal
    return (bits ^ (bits >> 63 & np.iinfo(np.int64).max)) >> LOWER_BITS


def radii(points, queries, neighborhoods):
    """Distance (m,) of the last neighbor from queries (m, d)."""
    radius = np.empty(len(queries))
    measure = compiled_function(MODULE, "farthest_of_neighborhoods")
    measure(points, queries, neighborhoods, radius)
    return radius


def ratio(numerator, denominator):
    """Quotients, limited to `LARGEST`; 0 / 0 is 0."""
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        quotient = numerator / denominator
    return np.nan_to_num(quotient, nan=0.0, posinf=LARGEST, neginf=-LARGEST)


def values_at(values, rows, missing):
    """The values of these rows, and another of rows that are missing: the number of all."""
    if not len(values):
        return np.full(rows.shape, missing)
    at_rows = values[np.minimum(rows, len(values) - 1)]
    at_rows[rows == len(values)] = missing
    return at_rows


def most_noise_around(noise, around, sizes, quiet, bend=0.0):
    """The largest standard deviation of planes (m,) that are as flat as those around them.

    `noise` (n,) are standard deviations, and `around` has rows of it. `sizes` are the members that
    each is from, and `bend` is what curvature adds to noise, each a number or (m,).

    `quiet` is the share of the neighbors whose noise is usual at most. Next to an edge less than
    half of them have planes of their own face; among many outliers fewer have planes without any.
    """
    usual = np.hypot(quantile_around(noise, around, quiet), bend)
    # A standard deviation of n members has a relative standard error of 1 / sqrt(2 n).
    return (1 + NoiseLimits().n_errors / np.sqrt(2 * sizes)) * usual


def are_flat(planes, most):
    """Whether the noise of planes is at most this share of the radius of their neighborhoods.

    So are planes of surfaces, and not those through foliage, which are as noisy as those around. A
    filled ball has 0.45.
    """
    return (planes.scale > 0) & (planes.scale <= most * planes.radius)
