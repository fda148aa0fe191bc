"""qSp against brute force."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from sklearn_mcmd.baselines import Qsp


@pytest.mark.parametrize("n", [50, 12])
def test_scores_are_distances_to_the_nearest_other_member_of_the_sample(n):
    points = np.random.default_rng(0).normal(size=(7, n, 3)) + 100
    method = Qsp(sample_size=15)
    sample = method.table(n, 3, method.seed(3))[0]
    assert len(set(sample)) == min(15, n - 1)
    fit = method.fit_sizes(points, np.full(7, n), method.seed(3))
    gaps = np.linalg.norm(points[:, :, None] - points[:, None, sample], axis=-1)
    gaps[:, np.arange(n)[:, None] == sample] = np.inf
    assert_allclose(fit.scores, gaps.min(axis=2), atol=1e-12)
    assert_allclose(fit.score(points), fit.scores, atol=1e-12)


@pytest.mark.parametrize("contamination", [None, 0.0, 0.1, 0.19])
def test_the_share_asked_for_is_removed_and_it_is_the_farthest(contamination):
    points = np.random.default_rng(0).normal(size=(9, 40, 3))
    fit = Qsp(contamination).fit(points, random_state=0)
    removed = ~fit.inliers
    assert_array_equal(removed.sum(axis=1), round(40 * (contamination or 0)))
    # Two members of the sample may be each other's nearest: ties are in order.
    highest_kept = np.where(removed, -np.inf, fit.scores).max(axis=1)
    assert (np.where(removed, fit.scores, np.inf).min(axis=1) >= highest_kept).all()
    assert np.isnan(fit.cutoff).all() if contamination is None else True
    assert contamination is None or (fit.cutoff > highest_kept).all()
