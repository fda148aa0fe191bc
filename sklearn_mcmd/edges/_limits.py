"""The value of a criterion above which there is an edge, of numbers that may be on disk."""

from itertools import chain
from math import fsum, sqrt
from numbers import Real
from typing import NamedTuple

import numpy as np

from sklearn_mcmd.planes._rules import MAD_TO_SD


class EdgeLimits(NamedTuple):
    """Which points belong to an edge, where no parameter says it."""

    width: float = 2.0  # spacings from a crease
    robust_std: float = 3.0  # robust standard deviations above the median
    paper_std: float = 1.0  # standard deviations above the mean (Eq. 25)


def column_of_criterion(criterion):
    """The column of ``RobustNormalEstimator.transform`` that holds a criterion."""
    return "eigenvalue_0" if criterion == "eigenvalue" else criterion


def least_of_edge(parts, threshold, n_std):
    """The limit that a threshold means; it depends on neither the parts nor their order.

    ``parts()`` iterates over arrays, the values of a cloud.
    """
    if isinstance(threshold, Real):
        return float(threshold)
    if threshold == "mean":  # Eq. 25
        n = sum(len(values) for values in parts())
        mean = _sum(parts()) / n
        variance = _sum(np.square(values - mean) for values in parts()) / (n - 1)
        return mean + (EdgeLimits().paper_std if n_std is None else n_std) * sqrt(variance)
    usual = _median(parts())
    deviation = _median(np.abs(values - usual) for values in parts())
    n_std = EdgeLimits().robust_std if n_std is None else n_std
    return float(usual + n_std * MAD_TO_SD * deviation)


def _sum(parts):
    """The sum as if it were exact, and rounded once."""
    return fsum(chain.from_iterable(values.tolist() for values in parts))


def _median(parts):
    return np.median(np.concatenate(list(parts)))
