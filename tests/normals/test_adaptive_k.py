"""n_neighbors="auto": sizes by the noise, against planes whose noise is known."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from scipy.spatial import cKDTree
from scipy.stats import chi2

from sklearn_mcmd import RobustNormalEstimator
from sklearn_mcmd.datasets import make_street
from sklearn_mcmd.metrics import bias_angle
from sklearn_mcmd.normals._adaptive_k import (
    ScaleFinder,
    SizeLimits,
    are_turned,
)
from sklearn_mcmd.planes._neighborhoods import NeighborIndex
from sklearn_mcmd.planes._principal_planes import normal_errors
from sklearn_mcmd.planes._whole import Steps

TILT, LEAST, MOST, QUIET, AROUND = SizeLimits()


def sheet(n, noise, seed=0):
    """Points on z = 0 with one point on each unit of area, and noise along z."""
    rng = np.random.default_rng(seed)
    side = np.sqrt(n)
    return np.column_stack([rng.uniform(0, side, (n, 2)), rng.normal(0, noise, n)])


def sizes_of(X, n_jobs=None):
    """In the order of X."""
    finder = ScaleFinder(NeighborIndex(X, AROUND), Steps(), n_jobs)
    return finder.sizes()[finder.index.places]


def planes_by_numpy(X, k):
    """Errors and normals of planes of the k nearest, with the noise that a quadric leaves."""
    errors, normals = np.empty(len(X)), np.empty_like(X)
    for i, nearest in enumerate(cKDTree(X).query(X, k)[1]):
        members = X[nearest] - X[nearest].mean(axis=0)
        values, axes = np.linalg.eigh(members.T @ members / k)
        z, u, v = (members @ axes).T
        design = np.column_stack([np.ones(k), u, v, u * u, u * v, v * v])
        left = np.linalg.norm(z - design @ np.linalg.lstsq(design, z, rcond=None)[0])
        left, size = np.array([left]) / np.sqrt(k - 6), np.array([k])
        errors[i], normals[i] = normal_errors(left, values[None], size)[0], axes[:, 0]
    return errors, normals


def test_sizes_are_those_of_the_literal_steps_on_a_cloud_of_three_noises():
    X = np.concatenate([sheet(150, noise, seed=i) for i, noise in enumerate([0.1, 0.4, 0.7])])
    X[:, 0] += np.repeat([0, 12.5, 25], 150)
    around = cKDTree(X).query(X, AROUND)[1]

    def quiet(values):
        return np.sort(values[around], axis=1)[:, int(QUIET * AROUND)]

    k, wanted = LEAST, np.full(450, np.inf)
    while np.isinf(wanted).any() and k <= MOST // 2:
        (errors, normals), (_, larger) = planes_by_numpy(X, k), planes_by_numpy(X, 2 * k)
        error = quiet(errors) / np.sqrt(chi2.ppf(QUIET, k - 6) / (k - 6))
        found = k * error / TILT
        cosine = np.minimum(np.abs(np.einsum("ij,ij->i", normals, larger)), 1)
        bent = (found > 2 * k) & are_turned(quiet(np.degrees(np.arccos(cosine))), error)
        found = np.maximum(np.where(bent, k, np.where(found > 2 * k, np.inf, found)), LEAST)
        wanted = np.where(np.isinf(wanted), found, wanted)
        wanted = np.where(np.isinf(wanted), quiet(wanted), wanted)
        k *= 2
    expected = np.rint(quiet(np.minimum(wanted, MOST)))
    assert_array_equal(sizes_of(X), expected)
    assert len(np.unique(expected)) > 20


@pytest.mark.parametrize("apart", [1, 6, 12])
def test_scans_in_rows_get_neighbors_of_so_many_rows_that_none_is_a_face(apart):
    """Rows that are D apart, of points at s, need ``(2 / pi) * 9 * 2 D / s`` neighbors; the length
    of a row is known up to a factor of two."""
    x, y = np.meshgrid(np.arange(30) * apart, np.arange(40 * apart))
    rng = np.random.default_rng(0)
    X = np.column_stack([x.ravel(), y.ravel() + rng.uniform(0, 0.3, x.size), np.zeros(x.size)])
    needed = 0 if apart == 1 else 2 / np.pi * 9 * 2 * apart
    sizes = np.median(sizes_of(X))
    assert max(needed / 2, LEAST) <= sizes <= max(2 * needed, LEAST)


def test_hopeless_noise_gets_the_most():
    X = np.random.default_rng(0).uniform(size=(3000, 3))
    assert_array_equal(sizes_of(X), MOST)


@pytest.mark.parametrize("n", [700, 3000])
def test_estimator_tells_the_sizes_and_keeps_them(n):
    X = make_street(n, random_state=0).data
    estimator = RobustNormalEstimator("auto", random_state=0)
    columns = estimator.fit_transform(X)
    assert_array_equal(estimator.n_neighbors_, sizes_of(X))
    assert estimator.n_neighbors_.shape == estimator.n_support_.shape == (n,)
    cosine = np.abs(np.einsum("nd,nd->n", estimator.transform(X)[:, 3:6], columns[:, 3:6]))
    assert np.mean(cosine > 1 - 1e-9) > 0.99  # other than where neighbors are equally far


@pytest.mark.parametrize("n", [700, 3000])
def test_each_point_has_the_plane_of_its_own_size(n):
    X = make_street(n, random_state=0).data
    auto = RobustNormalEstimator("auto", method="pca").fit(X)
    for k in np.unique(auto.n_neighbors_)[::10]:
        fixed = RobustNormalEstimator(int(k), method="pca").fit(X)
        rows = auto.n_neighbors_ == k
        assert bias_angle(auto.normals_[rows], fixed.normals_[rows]).max() < 1e-5


def test_a_radius_limits_them():
    X = sheet(3000, 0.5)
    auto = RobustNormalEstimator("auto", method="pca").fit(X)
    within = RobustNormalEstimator("auto", radius=2.0, method="pca").fit(X)
    assert_array_equal(within.n_neighbors_, auto.n_neighbors_)
    # A disk's variance along an axis is a quarter of its squared radius.
    assert np.median(within.eigenvalues_[:, -1]) < 1.5 < np.median(auto.eigenvalues_[:, -1])


def test_more_dimensions_than_three_ask_for_a_number():
    with pytest.raises(ValueError, match="X has 4 features; give a number of neighbors"):
        RobustNormalEstimator("auto").fit(np.random.default_rng(0).normal(size=(40, 4)))


def waves(noise, n=4000):
    """A surface that bends with a period of 18 spacings, and its normals."""
    rng = np.random.default_rng(0)
    height, step = 2.0, 2 * np.pi / 18
    x, y = rng.uniform(0, np.sqrt(n), (2, n))
    surface = np.column_stack([x, y, height * np.sin(step * x) * np.cos(step * y)])
    slopes = [np.cos(step * x) * np.cos(step * y), -np.sin(step * x) * np.sin(step * y)]
    normals = np.column_stack([*(-height * step * np.array(slopes)), np.ones(n)])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return surface + rng.normal(0, noise, n)[:, None] * normals, normals


@pytest.mark.slow
def test_one_setting_does_for_clouds_for_which_no_fixed_number_does():
    ratios = {"auto": [], 16: [], 32: [], 64: [], 128: []}
    for noise in (0.0, 0.2, 0.4, 0.8):
        X, normals = waves(noise)
        errors = {}
        for k in ratios:
            found = RobustNormalEstimator(k, random_state=0).fit(X).normals_
            errors[k] = np.sqrt(np.mean(bias_angle(found, normals) ** 2))
        for k, error in errors.items():
            ratios[k].append(error / min(errors.values()))
    worst = {k: max(values) for k, values in ratios.items()}
    assert worst.pop("auto") < 1.3 < min(worst.values())
