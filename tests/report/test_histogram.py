"""Histograms: bars beyond the cutoff are marked, and long tails have logarithmic axes."""

import re

import numpy as np
import pytest

from sklearn_mcmd.report._histogram import histogram


def bars(markup):
    return re.findall(r'class="(in|out)"', markup)


def test_bars_beyond_the_cutoff_are_marked():
    values = np.linspace(0, 10, 1001)
    kinds = bars(histogram(values, cutoff=5.0))
    assert kinds == sorted(kinds)  # "in" before "out"
    assert kinds.count("out") == pytest.approx(len(kinds) / 2, abs=6)
    below = bars(histogram(values, cutoff=5.0, above=False))
    assert below == sorted(below, reverse=True)


def test_a_long_tail_has_a_logarithmic_axis_and_others_have_not():
    values = np.random.default_rng(0).exponential(size=5000)
    assert "(logarithmic)" not in histogram(values, name="x")
    values[:50] = 1e6
    assert "(logarithmic)" in histogram(values, name="x", cutoff=3.0)


def test_the_line_is_at_the_cutoff():
    markup = histogram(np.linspace(0, 10, 1001), cutoff=6.0, cutoff_name="limit")
    assert "limit 6" in markup
    assert float(re.search(r"cut \w+\" style=\"left:([\d.]+)%", markup)[1]) == pytest.approx(
        60, abs=1
    )


@pytest.mark.parametrize(
    "values",
    [np.zeros(5), np.full(5, 7.0), np.array([1e6]), np.array([1.0, np.nan, np.inf]), -np.ones(3),
     np.r_[np.zeros(99), 1e300]],
)  # fmt: skip
def test_odd_values_are_drawn(values):
    for options in ({}, {"cutoff": 3.0}, {"cutoff": 3.0, "least": 0.01}):
        assert bars(histogram(values, name="x", **options))


def test_values_that_are_not_finite_are_counted_and_nothing_is_no_error():
    assert "2 without a finite value" in histogram(np.array([1.0, 2.0, np.nan, np.inf]))
    assert "no values" in histogram(np.array([np.nan]))
