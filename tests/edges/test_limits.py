"""Limits of edges are those of NumPy, and depend on neither parts nor order."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sklearn_mcmd.edges._limits import least_of_edge

VALUES = np.exp(np.random.default_rng(0).normal(0, 5, 2_001))


@pytest.mark.parametrize(
    ("threshold", "n_std", "expected"),
    [
        (0.25, None, 0.25),
        ("mean", None, VALUES.mean() + VALUES.std(ddof=1)),
        ("mean", 2.0, VALUES.mean() + 2 * VALUES.std(ddof=1)),
        (
            None,
            None,
            np.median(VALUES) + 3 * 1.4826 * np.median(np.abs(VALUES - np.median(VALUES))),
        ),
    ],
)
def test_limits_are_those_of_numpy_whatever_the_order(threshold, n_std, expected):
    limit = least_of_edge(lambda: [VALUES], threshold, n_std)
    assert_allclose(limit, expected, rtol=1e-4 if threshold is None else 1e-13)
    shuffled = np.random.default_rng(1).permutation(VALUES)
    for parts in (np.array_split(shuffled, 5), [VALUES[::-1]], np.array_split(VALUES, 2_001)):
        assert least_of_edge(lambda parts=parts: parts, threshold, n_std) == limit
