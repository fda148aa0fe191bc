"""Histograms: bars beyond the cutoff are marked, and long tails have logarithmic axes."""

import re

import numpy as np
import pytest

from sklearn_mcmd.report._histogram import BEYOND, WITHIN, histogram

pytest.importorskip("matplotlib")
LOGARITHMIC = "10^{"  # in the words of an axis


def bars(markup):
    """Whether each bar that has a height is beyond the cutoff, and the heights."""
    path = rf'd="M \S+ (\S+)\s+L \S+ \S+\s+L \S+ (\S+)[^"]*"[^>]*fill: ({WITHIN}|{BEYOND})'
    found = [(float(low) - float(top), color) for low, top, color in re.findall(path, markup)]
    return [color == BEYOND for height, color in found if height], [h for h, _ in found if h]


def test_bars_are_as_high_as_there_are_values_and_those_beyond_the_cutoff_are_marked():
    values = np.repeat(np.linspace(0.05, 9.95, 64), np.arange(1, 65))
    marked, heights = bars(histogram(values, cutoff=5.0))
    assert len(heights) == 64
    counts = np.histogram(values, np.linspace(0.05, 9.95, 65))[0]
    np.testing.assert_allclose(np.array(heights) / max(heights), counts / 64, atol=1e-4)
    assert marked == [False] * 32 + [True] * 32
    below, _ = bars(histogram(values, cutoff=5.0, above=False))
    assert below == marked[::-1]


def test_a_long_tail_has_a_logarithmic_axis_and_others_have_not():
    values = np.random.default_rng(0).exponential(size=5000)
    assert LOGARITHMIC not in histogram(values, name="x")
    values[:50] = 1e6
    assert LOGARITHMIC in histogram(values, name="x", cutoff=3.0)


@pytest.mark.parametrize(
    "values",
    [
        np.zeros(5),
        np.full(5, 7.0),
        np.array([1e6]),
        np.array([1.0, np.nan, np.inf]),
        -np.ones(3),
        np.r_[np.zeros(99), 1e300],
    ],
)
def test_odd_values_are_drawn(values):
    for options in ({}, {"cutoff": 3.0}, {"cutoff": 3.0, "least": 0.01}):
        assert bars(histogram(values, name="x", **options))[1], options


def test_values_that_are_not_finite_are_counted_and_nothing_is_no_error():
    assert "2 without a finite value" in histogram(np.array([1.0, 2.0, np.nan, np.inf]))
    assert "no values" in histogram(np.array([np.nan]))
