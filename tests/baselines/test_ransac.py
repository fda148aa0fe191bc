"""RANSAC and MSAC against a literal loop."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sklearn_mcmd.baselines import Msac, Ransac


def noisy_planes(n_sets, n=50, d=3, seed=0, n_outliers=10):
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(n_sets, n, d))
    points[..., -1] *= 0.02
    points[:, :n_outliers, -1] += rng.uniform(0.5, 2, (n_sets, n_outliers))
    return points


def literally(points, table, method):
    """Scores and scale by trials one after another, until the consensus says there were enough."""
    n, d = points.shape
    subsets = [points[row] for row in table]
    normals = [np.linalg.svd(subset[1:] - subset[0])[2][-1] for subset in subsets]
    distances = np.abs([(points - s[0]) @ x for s, x in zip(subsets, normals, strict=True)])
    enough = int(np.ceil(np.log(1 - method.stop_probability) / np.log(1 - 0.5**d)))
    scale = method.noise_scale
    if scale is None:
        scale = 1.4826 * (1 + 5 / (n - d)) * np.median(distances[:enough], axis=1).min()
    best, winner, needed = np.inf, None, np.inf
    for t, squares in enumerate((distances / (method.cutoff * scale)) ** 2):
        if t >= needed:
            break
        count = int(np.sum(squares < 1))
        loss = np.minimum(squares, 1).sum() if isinstance(method, Msac) else n - count
        if loss < best:
            best, winner = loss, t
            clean = np.prod([(count - i) / (n - i) for i in range(d)])
            needed = np.inf if clean <= 0 else 1
            if 0 < clean < 1:
                needed = max(1, np.ceil(np.log(1 - method.stop_probability) / np.log(1 - clean)))
    return distances[winner] / scale, scale


@pytest.mark.parametrize("kind", [Ransac, Msac])
@pytest.mark.parametrize("noise_scale", [None, 0.02])
@pytest.mark.parametrize("d", [2, 3, 4])
def test_scores_are_those_of_one_trial_after_another(kind, noise_scale, d):
    points = noisy_planes(10, d=d)
    method = kind(noise_scale=noise_scale, n_refits=0, max_trials=200, stop_probability=0.99)
    seed = method.seed(0)
    fit = method.fit_sizes(points, np.full(10, 50), seed)
    table = method.table(50, d, seed)
    for i in range(10):
        scores, scale = literally(points[i], table, method)
        assert_allclose(fit.scale[i], scale)
        assert_allclose(fit.scores[i], scores, rtol=1e-6, atol=1e-8)


def test_neighborhoods_without_a_plane_have_no_scale_and_no_outlier():
    line = np.linspace(0, 1, 20)[:, None] * [1.0, 2.0, 3.0]
    fit = Ransac().fit(np.stack([line, np.zeros((20, 3))]), random_state=0)
    assert (fit.scale < 0).all()
    assert fit.inliers.all()


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("noise_scale", 0.0),
        ("noise_scale", "pooled"),
        ("quantile", 1.0),
        ("degrees_of_freedom", 1.5),
        ("max_trials", 0),
        ("stop_probability", 1),
        ("n_refits", -1),
    ],
)
def test_wrong_parameters_are_named(name, value):
    with pytest.raises(ValueError, match=f"'{name}' parameter of Ransac must be"):
        Ransac(**{name: value})
