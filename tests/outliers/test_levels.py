"""Levels of strictness: each means something, and the next one more."""

from itertools import pairwise

import numpy as np
import pytest

from sklearn_mcmd import MCMDOutlierDetector
from sklearn_mcmd._choices import Strictness, choices_of
from sklearn_mcmd.outliers._levels import LEVELS


def wall_with_errors():
    """A wall; single points, a small group and a bush in front of it."""
    rng = np.random.default_rng(0)
    wall = rng.uniform(0, 2, (1500, 3)) * [1, 0, 1] + 0.002 * rng.normal(size=(1500, 3))
    single = rng.uniform([0, -1.5, 0], [2, -1, 2], (6, 3))
    group = [1, -0.7, 1] + 0.02 * rng.normal(size=(15, 3))
    bush = [0.5, -0.1, 0.5] + 0.06 * rng.normal(size=(150, 3))
    return np.vstack([wall, single, group, bush])


def test_each_level_flags_all_that_the_one_before_flags_and_more():
    X = wall_with_errors()
    detectors = [MCMDOutlierDetector(30, strictness=level, random_state=0) for level in LEVELS]
    flagged = [set(np.flatnonzero(detector.fit_predict(X) == -1)) for detector in detectors]
    assert flagged[0]
    for fewer, more in pairwise(flagged):
        assert fewer < more


def test_the_levels_that_parameters_take_are_those_that_are_judged_by():
    assert choices_of(Strictness) == LEVELS.keys()


@pytest.mark.parametrize("level", ["absent", "Groups"])
def test_a_level_that_no_rule_knows_is_an_error_and_not_the_default(level, monkeypatch):
    monkeypatch.setitem(MCMDOutlierDetector._parameter_constraints, "strictness", [str])
    with pytest.raises(KeyError, match=level):
        MCMDOutlierDetector(30, strictness=level).fit(wall_with_errors())
