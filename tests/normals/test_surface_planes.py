"""Normals next to edges and on smooth surfaces: borrowed planes, whole neighborhoods."""

import pickle
import sys

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.stats import f, norm, skew

from scenes import corner, cylinder, sphere, torus
from sklearn_mcmd import RobustNormalEstimator
from sklearn_mcmd.datasets import make_street
from sklearn_mcmd.metrics import bias_angle
from sklearn_mcmd.normals._smoothness import SmoothnessLimits, is_smooth, whole_planes
from sklearn_mcmd.normals._smoothness_numba import whole_planes_3d
from sklearn_mcmd.planes._record import Neighborhoods, Planes


def angles(X, normals, **parameters):
    estimator = RobustNormalEstimator(random_state=0, n_jobs=2, **parameters).fit(X)
    return bias_angle(estimator.normals_, normals)


@pytest.mark.parametrize("noise", [0.0, 0.005])
@pytest.mark.parametrize("make", [sphere, cylinder, torus])
def test_smooth_surfaces_are_measured_no_worse_than_by_least_squares(make, noise):
    X, N = make(5000, noise)
    robust, least_squares = angles(X, N), angles(X, N, method="pca")
    # What the torus of 0.3 bends within one neighborhood, 60 degrees, is nearly an edge's.
    most = 0.98 if make is torus and noise else 0.99
    assert (robust < 10).mean() >= most * (least_squares < 10).mean()
    assert np.median(robust) <= 1.1 * np.median(least_squares)


def test_points_next_to_an_edge_borrow_the_plane_of_their_face():
    X, N, distance = corner(4000)
    # Nearer than three standard deviations the two faces cannot be told apart.
    near = (distance > 0.006) & (distance < 0.06)
    own, borrowed = (angles(X, N, n_neighbors=30, borrow=b)[near] for b in (False, True))
    assert (borrowed < 10).mean() > max(0.98, (own < 10).mean() + 0.015)


def test_plane_index_says_whose_plane_it_is():
    X, N, distance = corner(4000)
    estimator = RobustNormalEstimator(30, random_state=0).fit(X)
    rows = np.flatnonzero(estimator.plane_index_ != np.arange(len(X)))
    assert len(rows) > 50
    lenders = estimator.plane_index_[rows]
    clear = distance[rows] > 0.006
    other_face = (N[lenders] != N[rows]).any(axis=1)
    assert np.count_nonzero(other_face & clear) <= 1
    own = np.setdiff1d(lenders, rows)  # those who did not borrow themselves
    of_own = np.isin(lenders, own)
    assert_allclose(
        estimator.normals_[rows[of_own]], estimator.normals_[lenders[of_own]], atol=1e-12
    )


@pytest.mark.parametrize("n", [500, 4000])  # NumPy and compiled
def test_new_points_are_given_planes_as_fitted_ones_are(n):
    X, _, _ = corner(n)
    estimator = RobustNormalEstimator(20, features="all", random_state=0)
    columns = estimator.fit_transform(X)
    assert_array_equal(estimator.transform(X), columns)
    assert_allclose(estimator.transform(X[7:8]), columns[7:8], rtol=1e-9, atol=1e-12)


def test_the_compiled_planes_are_those_of_numpy(monkeypatch):
    X, _, _ = corner(4000)
    X = np.vstack([X, 0.2 * torus(2000, 0.003)[0] + 2])
    compiled = RobustNormalEstimator(30, random_state=0).fit(X)
    monkeypatch.setattr(
        "sklearn_mcmd.planes._local_planes.LocalPlaneModel.ready", lambda self: False
    )
    plain = RobustNormalEstimator(30, random_state=0).fit(X)
    # Sums in another order may tip a neighborhood on a limit.
    assert (compiled.plane_index_ == plain.plane_index_).mean() > 0.998
    assert (bias_angle(compiled.normals_, plain.normals_) < 1e-4).mean() > 0.998


def test_results_do_not_depend_on_threads_chunks_or_order(monkeypatch):
    X, _, _ = corner(4000)
    expected = RobustNormalEstimator(30, random_state=0).fit(X)
    order = np.random.default_rng(0).permutation(len(X))
    monkeypatch.setattr("sklearn_mcmd.planes._neighbor_table.AT_ONCE", 997)
    shuffled = RobustNormalEstimator(30, random_state=0, n_jobs=2).fit(X[order])
    angle = bias_angle(shuffled.normals_, expected.normals_[order])
    assert (angle < 1e-4).mean() > 0.999


METHODS = [
    {}, {"borrow": False}, {"method": "mcmd_md"}, {"refine": None}, {"outlier_rate": 0.3},
    {"method": "pca"}, {"method": "ransac"}, {"method": "msac"}, {"method": "robpca"},
    {"method": "ulsif", "method_params": {"contamination": 0.1}},
    {"method": "qsp", "method_params": {"contamination": 0.1}},
]  # fmt: skip


@pytest.mark.parametrize("parameters", METHODS, ids=str)
def test_threads_give_the_same_to_the_last_bit_every_time(monkeypatch, parameters):
    # A compiled loop must not depend on where its arrays lie.
    monkeypatch.setattr("sklearn_mcmd.planes._neighbor_table.AT_ONCE", 97)
    X = np.vstack([corner(800)[0], 0.2 * torus(800, 0.003)[0] + 2])
    X = np.vstack([X, np.random.default_rng(0).uniform(0, 1, (60, 3))])
    features = ["mean_curvature", "roughness", "normal_error"]
    estimator = RobustNormalEstimator(20, features=features, random_state=0, **parameters)
    expected = estimator.fit_transform(X)
    estimator.set_params(n_jobs=8)
    for _ in range(5 if parameters else 20):
        assert_array_equal(estimator.fit_transform(X), expected)


def neighborhoods_of_three_kinds(n, k):
    """Curved, creased and flat ones, turned; and the scale that a robust plane would have."""
    rng = np.random.default_rng(0)
    heights = [lambda u, v: 0.3 * u**2 + 0.1 * u * v, lambda u, v: np.abs(u), lambda u, v: 0 * u]
    neighborhoods, scale = [], []
    for i in range(n):
        u, v = rng.uniform(-1, 1, (2, k))
        z = heights[i % 3](u, v) + rng.normal(0, 0.02, k)
        neighborhoods.append(np.column_stack([u, v, z]) @ np.linalg.qr(rng.normal(size=(3, 3)))[0])
        scale.append([0.05, 0.02, 0.02][i % 3])
    return np.array(neighborhoods), np.array(scale)


def test_smoothness_is_decided_by_the_residual_of_a_quadric():
    """Against least squares by NumPy, on 300 neighborhoods of three kinds."""
    neighborhoods, scale = neighborhoods_of_three_kinds(300, 40)
    found = whole_planes(neighborhoods, np.full(300, 40))
    centroids, _, axes, deviation, left, ordinary = found
    smooth = is_smooth(left, scale)
    for i in range(300):
        local = (neighborhoods[i] - centroids[i]) @ axes[i]
        z, u, v = local.T
        design = np.column_stack([np.ones(40), u, v, u * u, u * v, v * v])
        rest = z - design @ np.linalg.lstsq(design, z)[0]
        plane, quadric = (z @ z) / 37, (rest @ rest) / 34
        assert smooth[i] == (quadric <= 1.2**2 * scale[i] ** 2)
        assert_allclose([deviation[i] ** 2, left[i] ** 2], [plane, quadric], rtol=1e-9)
        # Four tests of normality, of which each allows 1.5 standard errors of its statistic.
        chance = norm.sf(1.5)
        gained = (plane * 37 - quadric * 34) / 3 / quadric
        like_noise = gained <= f.isf(chance, 3, 34)
        like_noise &= np.abs(z).max() <= norm.isf(chance / 80) * z.std()
        like_noise &= abs(skew(z)) <= 1.5 * np.sqrt(6 * 38 / (41 * 43))
        geary = np.abs(z).mean() / z.std()
        like_noise &= abs(geary - np.sqrt(2 / np.pi)) <= 1.5 * np.sqrt((1 - 3 / np.pi) / 40)
        assert ordinary[i] == like_noise
    assert smooth[0::3].mean() > 0.95
    assert smooth[1::3].mean() < 0.05
    assert smooth[2::3].mean() > 0.8
    assert not ordinary[0::3].any()
    assert not ordinary[1::3].any()
    assert ordinary[2::3].mean() > 0.4


def test_the_compiled_whole_planes_are_those_of_numpy():
    neighborhoods, _ = neighborhoods_of_three_kinds(900, 40)
    sizes = np.random.default_rng(1).integers(10, 41, 900)
    neighborhoods[::50, :, 2] = 0.0  # perfect planes
    neighborhoods[1::50, :, 1:] = 0.0  # lines
    expected = whole_planes(neighborhoods, sizes)
    points, indices = neighborhoods.reshape(-1, 3), np.arange(900 * 40).reshape(900, 40)
    around = Neighborhoods(indices.astype(np.int32), sizes)
    planes, directions = Planes.empty(900, 3), np.empty((900, 3))
    deviation, left, ordinary = np.empty(900), np.empty(900), np.empty(900, dtype=bool)
    limits = SmoothnessLimits.of(40, 3)
    whole_planes_3d(points, around, limits, planes, directions, deviation, left, ordinary)
    assert_array_equal(ordinary, expected[5])
    assert ordinary[0::50][sizes[0::50] >= 12].all()
    assert not ordinary[1::50].any()
    assert_allclose(planes.centroids, expected[0], rtol=1e-9, atol=1e-12)
    assert_allclose(planes.eigenvalues, expected[1], rtol=1e-9, atol=1e-12)
    assert_allclose(deviation, expected[3], rtol=1e-9, atol=1e-12)
    assert_allclose(left, expected[4], rtol=1e-7, atol=1e-12)


def test_neighborhoods_on_two_scan_lines_determine_no_quadric():
    t = np.linspace(0, 1, 20)
    lines = np.vstack([np.column_stack([t, np.full(20, y), t**2]) for y in (0.0, 0.1)])
    _, _, _, _, left, ordinary = whole_planes(lines[None], np.array([40]))
    assert left[0] == np.inf
    assert not is_smooth(left, np.array([np.inf]))[0]
    assert not ordinary[0]


@pytest.mark.parametrize(("n", "k", "share", "height"), [
    (900, 50, 0.4, 0.06), (3000, 50, 0.3, 0.04), (3000, 100, 0.45, 0.04), (3000, 50, 0.4, 0.02),
])  # fmt: skip
@pytest.mark.parametrize("borrow", [False, True])
@pytest.mark.parametrize("levels", ["between", "at"])
def test_scattered_outliers_do_not_pass_for_noise(n, k, share, height, borrow, levels):
    """Kept whole, neighborhoods with two fifths of these tilt by 8 degrees and more."""
    rng = np.random.default_rng(0)
    X = np.column_stack([rng.uniform(0, 1, (n, 2)), rng.normal(0, 0.001, n)])
    outlier = rng.uniform(size=n) < share
    off = (
        rng.uniform(-height, height, n) if levels == "between" else rng.choice([-1, 1], n) * height
    )
    X[outlier, 2] = off[outlier]
    tilt = angles(X, np.tile([0.0, 0.0, 1.0], (n, 1)), n_neighbors=k, borrow=borrow)[~outlier]
    paper = angles(X, np.tile([0.0, 0.0, 1.0], (n, 1)), n_neighbors=k, refine=None)[~outlier]
    assert np.quantile(tilt, 0.95) <= 1.2 * np.quantile(paper, 0.95)


def test_planes_are_borrowed_from_within_reach_in_numpy_as_compiled(monkeypatch):
    X, _, _ = corner(1500)
    compiled = RobustNormalEstimator(30, radius=0.06, random_state=0).fit(X)
    monkeypatch.setattr(
        "sklearn_mcmd.planes._local_planes.LocalPlaneModel.ready", lambda self: False
    )
    plain = RobustNormalEstimator(30, radius=0.06, random_state=0).fit(X)
    assert (compiled.plane_index_ != np.arange(1500)).sum() > 30
    # Of copies of one plane either may lend.
    assert (bias_angle(compiled.normals_, plain.normals_) < 1e-4).all()
    assert np.linalg.norm(X - X[plain.plane_index_], axis=1).max() <= 0.06


def test_nothing_is_borrowed_on_a_plane_but_by_chance():
    rng = np.random.default_rng(0)
    X = np.column_stack([rng.uniform(0, 1, (3000, 2)), rng.normal(0, 0.002, 3000)])
    for k, most in ((12, 0.05), (20, 0.05), (50, 0.01)):
        estimator = RobustNormalEstimator(k, random_state=0).fit(X)
        assert (estimator.plane_index_ != np.arange(3000)).mean() < most


@pytest.mark.parametrize(("k", "least"), [(20, 0.90), (30, 0.90), (50, 0.92)])
@pytest.mark.parametrize("share", [0.0, 0.2])
def test_the_true_normal_is_within_the_error_that_is_told(k, least, share):
    """Of a plane: 95 % where the scale does not depend on what was removed or borrowed."""
    rng = np.random.default_rng(0)
    X = np.column_stack([rng.uniform(0, 1, (8000, 2)), rng.normal(0, 0.004, 8000)])
    outliers = rng.random(8000) < share
    X[outliers, 2] += rng.normal(0, 0.08, outliers.sum())
    estimator = RobustNormalEstimator(k, random_state=0).fit(X)
    inside = ~outliers & (np.abs(X[:, :2] - 0.5) < 0.45).all(axis=1)
    right = bias_angle(estimator.normals_, [0, 0, 1]) <= 1.73 * estimator.normal_error_
    assert least < right[inside].mean() < 0.97


def test_planes_across_a_kerb_come_last():
    """Noisy faces: their normals, and what ordinary neighborhoods are spared, from the truth."""
    street = make_street(30_000, outlier_share=0.1, random_state=0)
    clear = (street.target == 1) & (street.edge_distance > 0.015)
    near = clear & (street.edge_distance < 4 * street.spacing)
    angle = angles(street.data, street.normals, n_neighbors=50)
    own = angles(street.data, street.normals, n_neighbors=50, borrow=False)
    # Three standard deviations off the edge the faces can be told apart.
    assert (angle[near] < 10).mean() > max(0.9, (own[near] < 10).mean() + 0.05)
    assert np.median(angle[clear & ~near]) <= 1.05 * np.median(own[clear & ~near])


def test_the_paper_to_the_letter_borrows_nothing():
    X, _, _ = corner(2000)
    literal = RobustNormalEstimator(30, refine=None, random_state=0).fit(X)
    assert_array_equal(literal.plane_index_, np.arange(len(X)))


def test_two_locations_of_four_points_are_each_given_a_plane(monkeypatch):
    X = np.array([[0.0, 0, 0], [1, 0, 0], [0, 0, 0], [1, 0, 0]])
    empty = np.empty

    def filled(shape, dtype=float, **kwargs):
        return np.full(shape, np.nan if np.dtype(dtype) == float else 101, dtype)

    monkeypatch.setattr(np, "empty", filled)
    estimator = RobustNormalEstimator(4, random_state=0).fit(X)
    monkeypatch.setattr(np, "empty", empty)
    assert_array_equal(estimator.normals_, np.tile([0, 0, 1.0], (4, 1)))
    assert set(estimator.plane_index_) <= set(range(4))


def test_a_model_that_was_fitted_with_numba_serves_without_it(monkeypatch):
    X, _, _ = corner(4000)
    estimator = pickle.loads(pickle.dumps(RobustNormalEstimator(20, random_state=0).fit(X)))
    expected = estimator.transform(X[:50])
    monkeypatch.setattr("sklearn_mcmd.planes._local_planes.compiled_function", lambda *_: None)
    for name in ("smoothness", "folds", "lenders"):
        monkeypatch.setitem(sys.modules, f"sklearn_mcmd.normals._{name}_numba", None)
    assert_allclose(estimator.transform(X[:50]), expected, rtol=1e-6, atol=1e-9)


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_neighborhoods_of_too_few_members_for_a_quadric_warn_of_nothing():
    street = make_street(5_000, noise=0.008, random_state=0)
    normals = RobustNormalEstimator(10, random_state=0).fit(street.data).normals_
    assert np.isfinite(normals).all()
