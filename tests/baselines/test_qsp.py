"""qSp against brute force."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from sklearn_mcmd.baselines import Qsp, fit_neighborhoods


@pytest.mark.parametrize("exclude_self", [True, False])
@pytest.mark.parametrize("n", [50, 12])
def test_scores_are_distances_to_the_nearest_of_the_sample(n, exclude_self):
    points = np.random.default_rng(0).normal(size=(7, n, 3)) + 100
    method = Qsp(sample_size=15, exclude_self=exclude_self)
    sample = method.tables(3).of(n, 3)[0]
    assert len(set(sample)) == min(15, n - 1)
    found = method.fit_sizes(points, np.full(7, n), method.tables(3))
    for b in range(7):
        for j in range(n):
            others = [s for s in sample if not (exclude_self and s == j)]
            nearest = min(np.linalg.norm(points[b, j] - points[b, s]) for s in others)
            assert_allclose(found.scores[b, j], nearest, atol=1e-12)


def test_a_query_is_measured_as_a_member_at_its_place():
    points = np.random.default_rng(0).normal(size=(3, 40, 3))
    found = fit_neighborhoods("qsp", points, random_state=0)
    assert_allclose(found.score(points), found.scores, atol=1e-12)


@pytest.mark.parametrize("contamination", [0.0, 0.1, 0.25])
def test_the_share_asked_for_is_removed_and_it_is_the_farthest(contamination):
    points = np.random.default_rng(0).normal(size=(9, 40, 3))
    found = fit_neighborhoods("qsp", points, random_state=0, contamination=contamination)
    removed = ~found.inliers
    assert_array_equal(removed.sum(axis=1), round(40 * contamination))
    # Two members of the sample may be each other's nearest: ties are in order.
    highest_kept = np.where(removed, -np.inf, found.scores).max(axis=1)
    assert (np.where(removed, found.scores, np.inf).min(axis=1) >= highest_kept).all()
    assert (found.cutoff > highest_kept).all()


def test_without_a_share_nothing_is_removed():
    points = np.random.default_rng(0).normal(size=(2, 40, 3))
    found = fit_neighborhoods("qsp", points, random_state=0)
    assert found.inliers.all()
    assert np.isnan(found.cutoff).all()


def test_far_points_have_the_largest_scores():
    points = np.random.default_rng(0).normal(size=(50, 40, 3))
    points[:, 0] += 20
    found = fit_neighborhoods("qsp", points, random_state=0, sample_size=10)
    assert (found.scores.argmax(axis=1) == 0).all()
