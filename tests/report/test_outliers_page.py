"""Kinds of outliers, of clouds whose outliers are known."""

import numpy as np
import pytest

from sklearn_mcmd import MCMDOutlierDetector
from sklearn_mcmd.report._outliers_page import KINDS, kinds_of_outliers


def cloud():
    """A plane, single points far above it, and a ghost of 20 points."""
    rng = np.random.default_rng(0)
    plane = np.column_stack([rng.uniform(0, 10, (4000, 2)), rng.normal(0, 0.01, 4000)])
    single = np.array([[1.0, 1, 4], [9, 1, 5], [1, 9, 6], [9, 9, 4]])
    ghost = rng.normal([5, 5, 5], 0.1, (20, 3))
    return np.vstack([plane, single, ghost])


@pytest.mark.parametrize("strictness", ["isolated", "groups", "surfaces", None])
def test_single_points_are_isolated_a_ghost_is_a_group_and_nothing_else_has_a_kind(strictness):
    detector = MCMDOutlierDetector(strictness=strictness, random_state=0).fit(cloud())
    kinds = kinds_of_outliers(detector)
    assert ((kinds >= 0) == (detector.scores_ < detector.offset_)).all()
    if strictness in ("isolated", "groups"):
        assert not (kinds == [*KINDS].index("off surfaces")).any()
    if strictness == "groups":
        assert (kinds[4000:4004] == [*KINDS].index("isolated")).all()
        assert (kinds[4004:] == [*KINDS].index("in groups")).all()
    if strictness is None:
        assert set(kinds[kinds >= 0]) <= {[*KINDS].index("off surfaces")}


def test_points_of_a_sparse_row_go_as_a_group():
    """They are far from each other: the row excuses that, up to its own separation."""
    rng = np.random.default_rng(0)
    wire = [0, 10, 80] + np.linspace(3, 17, 15)[:, None] * [1, 0, 0] + rng.normal(0, 0.005, (15, 3))
    plane = rng.random((6000, 3)) * [20, 20, 0] + rng.normal(0, 0.002, (6000, 3))
    kinds = kinds_of_outliers(MCMDOutlierDetector(random_state=0).fit(np.vstack([plane, wire])))
    assert (kinds[6000:] == [*KINDS].index("in groups")).all()
