"""Kinds of outliers, of clouds whose outliers are known."""

import re

import numpy as np
import pytest

from sklearn_mcmd import MCMDOutlierDetector
from sklearn_mcmd.report._outliers_page import KINDS, kinds_of_outliers, reasons_of


def cloud():
    """A plane, single points far above it, and a ghost of 20 points."""
    rng = np.random.default_rng(0)
    plane = np.column_stack([rng.uniform(0, 10, (4000, 2)), rng.normal(0, 0.01, 4000)])
    single = np.array([[1.0, 1, 4], [9, 1, 5], [1, 9, 6], [9, 9, 4]])
    ghost = rng.normal([5, 5, 5], 0.1, (20, 3))
    return np.vstack([plane, single, ghost])


def test_single_points_are_isolated_and_a_ghost_is_a_group():
    detector = MCMDOutlierDetector(random_state=0).fit(cloud())
    kinds = kinds_of_outliers(detector)
    assert (kinds[4000:4004] == [*KINDS].index("isolated")).all()
    assert (kinds[4004:] == [*KINDS].index("in groups")).all()
    assert ((kinds >= 0) == (detector.scores_ < detector.offset_)).all()


@pytest.mark.parametrize("strictness", ["isolated", "groups", "surfaces", None])
def test_every_outlier_has_a_kind_and_nothing_else(strictness):
    detector = MCMDOutlierDetector(strictness=strictness, random_state=0).fit(cloud())
    kinds = kinds_of_outliers(detector)
    assert ((kinds >= 0) == (detector.scores_ < detector.offset_)).all()
    if strictness in ("isolated", "groups"):
        assert not (kinds == [*KINDS].index("off surfaces")).any()
    if strictness is None:
        assert set(kinds[kinds >= 0]) <= {[*KINDS].index("off surfaces")}


def test_reasons_name_a_point_a_group_and_what_lies_off_every_surface():
    detector = MCMDOutlierDetector(random_state=0).fit(cloud())
    single, ghost = reasons_of(detector, [4002, 4010])
    away = re.fullmatch(r"single point, ([\d.]+) usual spacings from anything", single)[1]
    assert float(away) == pytest.approx(detector.isolation_[4002], rel=0.05)
    away = re.fullmatch(r"group of 20, ([\d.]+) of its sizes away", ghost)[1]
    assert float(away) == pytest.approx(detector.separation_[4010], rel=0.05)


def test_a_wire_that_hangs_is_told_from_other_groups():
    wire = [[4 + 0.1 * i, 5, 8] for i in range(20)]
    detector = MCMDOutlierDetector(random_state=0).fit(np.vstack([cloud(), wire]))
    (reason,) = reasons_of(detector, [len(cloud())])
    away = re.fullmatch(r"straight thing of 20 that hangs, ([\d.]+) of its lengths away", reason)[1]
    assert float(away) == pytest.approx(8 / (0.1 * np.sqrt(20**2 - 1)), rel=0.1)


def test_points_of_a_sparse_row_are_told_as_a_straight_thing():
    """They are far from each other: the row excuses that, up to its own separation."""
    rng = np.random.default_rng(0)
    wire = [0, 10, 80] + np.linspace(3, 17, 15)[:, None] * [1, 0, 0] + rng.normal(0, 0.005, (15, 3))
    plane = rng.random((6000, 3)) * [20, 20, 0] + rng.normal(0, 0.002, (6000, 3))
    detector = MCMDOutlierDetector(random_state=0).fit(np.vstack([plane, wire]))
    for reason in reasons_of(detector, range(6000, 6015)):
        assert re.fullmatch(r"straight thing of 15 that hangs, 5\.\d of its lengths away", reason)


def test_reasons_tell_what_excuses_a_point_best():
    """A point just off the plane is as alone there as another: the distance excuses it."""
    xyz = np.vstack([cloud(), [[5, 5, 0.05], [1, 1, 4]]])
    detector = MCMDOutlierDetector(random_state=0).fit(xyz)
    near, copy = reasons_of(detector, [4024, 4025])
    assert re.fullmatch(r"single point, [345]\.?\d? standard deviations off a surface", near)
    assert re.fullmatch(r"one of 2 together, \d+ usual spacings from anything", copy)
    share = detector.set_params(contamination=0.3).fit(xyz)
    on_surface = np.flatnonzero(share.on_surface_ & (share.scores_ < share.offset_))[:1]
    assert reasons_of(share, on_surface)[0].endswith(" standard deviations off a surface")


def test_leaves_that_go_with_strictness_surfaces_lie_off_every_surface():
    rng = np.random.default_rng(0)
    crown = rng.normal([5, 5, 1], 0.3, (400, 3))
    detector = MCMDOutlierDetector(strictness="surfaces", random_state=0)
    detector.fit(np.vstack([cloud()[:4000], crown]))
    assert reasons_of(detector, [np.argmin(np.linalg.norm(crown - [5, 5, 1], axis=1)) + 4000]) == [
        "off every surface"
    ]
