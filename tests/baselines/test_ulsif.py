"""uLSIF: its closed forms against brute force."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sklearn_mcmd.baselines import Ulsif
from sklearn_mcmd.baselines._ulsif import (
    RatioLimits,
    gaussian_kernels,
    leave_one_out_score,
    ratio_weights,
    second_moments,
)
from sklearn_mcmd.datasets import make_contaminated_plane


def kernels_of(n_test, n_training, n_sets=4, seed=0):
    rng = np.random.default_rng(seed)
    test, training = rng.normal(size=(n_sets, n_test, 2)), rng.normal(size=(n_sets, n_training, 2))
    basis = training[:, :6]
    widths = np.full(n_sets, 0.7)
    return gaussian_kernels(basis, test, widths), gaussian_kernels(basis, training, widths)


@pytest.mark.parametrize(("n_test", "n_training"), [(20, 12), (12, 20), (15, 15)])
@pytest.mark.parametrize("regularization", [0.01, 1.0])
def test_the_leave_one_out_score_is_that_of_leaving_out(n_test, n_training, regularization):
    test, training = kernels_of(n_test, n_training)
    scores = leave_one_out_score(test, training, regularization, second_moments(test))
    for b in range(len(test)):
        losses = []
        for i in range(min(n_test, n_training)):
            kept = np.delete(test[b], i, axis=1)
            matrix = kept @ kept.T / (n_test - 1) + regularization * np.eye(6)
            weights = np.linalg.solve(matrix, np.delete(training[b], i, axis=1).mean(axis=1))
            weights = np.maximum(weights, 0)
            losses.append((weights @ test[b, :, i]) ** 2 / 2 - weights @ training[b, :, i])
        assert_allclose(scores[b], np.mean(losses), rtol=1e-9)


def test_weights_minimize_the_regularized_loss():
    test, training = kernels_of(40, 30)
    # So large a regularization that no weight is cut off at zero.
    weights = ratio_weights(second_moments(test), training, 10.0)
    assert (weights > 0).all()
    for b in range(len(test)):

        def loss(w, b=b):
            quadratic = 0.5 * np.mean((w @ test[b]) ** 2) + 5.0 * w @ w
            return quadratic - np.mean(w @ training[b])

        best = loss(weights[b])
        for step in np.eye(6) * 1e-3:
            assert loss(weights[b] + step) > best
            assert loss(weights[b] - step) > best


def test_width_and_regularization_are_those_of_the_best_score():
    points = np.random.default_rng(0).normal(size=(3, 40, 2))
    fit = Ulsif().fit(points, random_state=0)
    ((_, model),) = fit.models
    shuffled = Ulsif().table(40, 2, Ulsif().seed(0))[-1]
    basis, test = model.basis, (points - fit.origin[:, None])[:, shuffled]
    # All training points are in the basis.
    gaps = np.linalg.norm(basis - np.median(basis, axis=1, keepdims=True), axis=2)
    best, kept = np.full(3, np.inf), [None] * 3
    for factor in 10.0 ** np.linspace(-1, 1, 9):
        widths = factor * np.median(gaps, axis=1)
        kernels = (gaussian_kernels(basis, p, widths) for p in (test, basis))
        test_kernels, training_kernels = kernels
        moments = second_moments(test_kernels)
        for regularization in RatioLimits().regularizations:
            parts = test_kernels, training_kernels, regularization, moments
            weights = ratio_weights(moments, training_kernels, regularization)
            for b, score in enumerate(leave_one_out_score(*parts)):
                if score < best[b]:
                    best[b], kept[b] = score, (widths[b], weights[b])
    assert_allclose(model.width, [width for width, _ in kept])
    assert_allclose(model.weights, [weights for _, weights in kept])


def test_most_outliers_are_found_by_the_central_part():
    shares = []
    for run in range(20):
        X, y = make_contaminated_plane(100, outlier_share=0.2, random_state=run)
        fit = Ulsif(contamination=0.23).fit(X[None], random_state=run)
        shares.append(np.mean(~fit.inliers[0, y == -1]))
    assert np.mean(shares) > 0.9


def test_scores_do_not_depend_on_the_unit():
    points = np.random.default_rng(0).normal(size=(5, 40, 3))
    here, there = (Ulsif().fit(p, random_state=0).scores for p in (points, 1000 * points + 7))
    assert_allclose(here, there, rtol=1e-6, atol=1e-9)


def test_a_share_of_more_than_half_is_refused():
    with pytest.raises(ValueError, match="'contamination' parameter of Ulsif"):
        Ulsif(contamination=0.7)
