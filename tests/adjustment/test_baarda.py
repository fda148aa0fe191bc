"""Data snooping against a full adjustment in every round, and its edge cases."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import reference_adjustment as reference
from adjustment_clouds import plane_with_outliers, random_case
from sklearn_mcmd.adjustment import BaardaPlaneDetector, _elimination


@pytest.mark.filterwarnings("ignore:The tests reject")
@pytest.mark.filterwarnings("ignore:The points that pass are as thick as they are wide")
@pytest.mark.parametrize("surface", ["vertical", "orthogonal"])
@pytest.mark.parametrize("test", ["w", "tau", "t"])
@pytest.mark.parametrize("elimination", ["single", "all"])
def test_every_round_removes_what_a_full_adjustment_removes(
    surface, test, elimination, monkeypatch
):
    # So few candidates that the bound on all other points is put to work.
    monkeypatch.setattr(_elimination, "MIN_CANDIDATES", 4)
    for seed in range(20):
        X, p = random_case(seed)
        detector = BaardaPlaneDetector(test=test, elimination=elimination, surface=surface)
        expected = reference.snoop(
            X, p, alpha=0.05, test=test, single=elimination == "single", surface=surface
        )
        assert_array_equal(detector.fit(X, weights=p).elimination_step_, expected)


@pytest.mark.filterwarnings("ignore:The points that pass are as thick as they are wide")
def test_removals_between_full_adjustments_are_theirs_too():
    """So few points are all candidates, and the first six are far off, in short units."""
    for seed in range(3):
        rng = np.random.default_rng(seed)
        X = np.column_stack([rng.uniform(0, 1, 20), rng.normal(0, 0.02, 20)])
        X[:6, 1] += rng.uniform(0.2, 1, 6)
        expected = reference.snoop(X, alpha=0.05, sigma0=0.02, surface="orthogonal")
        detector = BaardaPlaneDetector(sigma0=0.02, surface="orthogonal").fit(X)
        assert_array_equal(detector.elimination_step_, expected)


@pytest.mark.parametrize("correction", ["none", "sidak", "bonferroni"])
def test_the_local_level_counts_the_points_that_are_left(correction):
    X = plane_with_outliers(60, 12, 4.0)
    expected = reference.snoop(X, alpha=0.2, correction=correction)
    detector = BaardaPlaneDetector(0.2, correction=correction).fit(X)
    assert expected.any()
    assert_array_equal(detector.elimination_step_, expected)


def test_points_that_a_batch_removed_wrongly_come_back():
    X = plane_with_outliers(500, 100, 60.0, sigma=0.1)
    detector = BaardaPlaneDetector(0.15, correction="none", elimination="all").fit(X)
    assert np.count_nonzero(detector.elimination_step_) > 105
    assert_array_equal(np.flatnonzero(detector.labels_ == -1), np.arange(100))


@pytest.mark.parametrize("test", ["w", "tau", "t"])
def test_the_statistic_of_a_removed_point_is_its_own_after_joining_the_support(test):
    X = plane_with_outliers(80, 3, 15.0)
    detector = BaardaPlaneDetector(test=test).fit(X)
    assert not detector.support_[:3].any()
    rows = np.append(np.flatnonzero(detector.support_), 0)
    v, r, omega, u = reference.adjustment(X[rows])
    T = reference.statistic(v, r, np.ones(len(rows)), omega, len(rows) - u, test, 1.0)
    assert_allclose(detector.test_statistic_[0], T[-1], rtol=1e-9)
    assert_allclose(detector.redundancy_[0], r[-1], rtol=1e-9)


@pytest.mark.parametrize("p", [np.random.default_rng(1).uniform(0.2, 5, 400), np.full(400, 2.0)])
def test_precisions_scale_with_the_square_of_sigma0(p):
    X = plane_with_outliers()
    one = BaardaPlaneDetector().fit(X, weights=p)
    other = BaardaPlaneDetector(sigma0=3).fit(X, weights=9 * p)
    assert_array_equal(one.labels_, other.labels_)
    assert_allclose(one.test_statistic_, other.test_statistic_)


@pytest.mark.parametrize("elimination", ["single", "all"])
def test_a_sigma0_far_too_small_leaves_the_last_plane_and_warns(elimination):
    X = plane_with_outliers(50, 0)
    with pytest.warns(UserWarning, match="Check sigma0=1e-06"):
        detector = BaardaPlaneDetector(sigma0=1e-6, elimination=elimination).fit(X)
    assert detector.support_.sum() > detector.rank_
    assert np.isfinite(detector.coef_).all()
    if elimination == "all":
        assert (detector.elimination_step_ > 0).all()


@pytest.mark.parametrize(
    ("weights", "words"),
    [
        (-np.ones(20), "has negative values"),
        (np.zeros(20), "is zero for all"),
        (np.ones(19), "has shape"),
        (np.full(20, np.nan), "contains NaN"),
    ],
)
def test_bad_weights_are_refused_by_name(weights, words):
    with pytest.raises(ValueError, match=f"weights {words}"):
        BaardaPlaneDetector().fit(plane_with_outliers(20, 0), weights=weights)
