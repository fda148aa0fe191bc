"""Curvatures against surfaces whose curvatures are known, their errors, and invariances."""

from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation
from scipy.stats import truncnorm
from sklearn.base import clone

from scenes import corner, sphere, torus
from sklearn_mcmd import RobustNormalEstimator
from sklearn_mcmd.normals._curvature import _derive, _fit_jets
from sklearn_mcmd.normals._features import OF_CURVATURES
from sklearn_mcmd.planes._record import Neighborhoods, Planes

NAMES = list(OF_CURVATURES)
TRUNCATED = truncnorm(-3, 3).std()  # what is left of noise within three standard deviations


def measure(X, normals=None, n_neighbors=50, new=None, **parameters):
    """Curvatures by name; on the side of the true normals if these are given."""
    estimator = RobustNormalEstimator(
        n_neighbors, features=NAMES, random_state=0, n_jobs=1, **parameters
    )
    columns = estimator.fit_transform(X)
    columns = columns if new is None else estimator.transform(new)
    found = dict(zip(estimator.get_feature_names_out(), columns.T, strict=True))
    for end in ("max", "min"):
        found[end] = np.column_stack([found[f"{end}_curvature_direction_x{i}"] for i in range(3)])
    found["normal"] = columns[:, 3:6]
    if normals is not None:
        found = turned(found, np.einsum("ij,ij->i", found["normal"], normals) < 0)
    return SimpleNamespace(**found)


def turned(found, rows):
    """Curvatures as seen from the other side, at some points."""
    other = {name: found[name].copy() for name in found}
    signs = np.where(rows, -1.0, 1.0)
    for name in ("mean_curvature", "shape_index"):
        other[name] = signs * found[name]
    for name, opposite in (("max", "min"), ("min", "max")):
        other[f"{name}_curvature"][rows] = -found[f"{opposite}_curvature"][rows]
        other[f"{name}_curvature_error"][rows] = found[f"{opposite}_curvature_error"][rows]
        other[name][rows] = found[opposite][rows]
    return other


def saddle(n, noise=0.0):
    """z = (x x - y y) / 2 around the origin: points, principal curvatures."""
    rng = np.random.default_rng(0)
    x, y = rng.uniform(-1, 1, (2, n))
    # The second fundamental form over the first, by SymPy's formulas for a graph.
    p, q = x, -y
    w = np.sqrt(1 + p * p + q * q)
    mean = ((1 + q * q) - (1 + p * p)) / (2 * w**3)
    gaussian = -1 / w**4
    half = np.sqrt(mean**2 - gaussian)
    X = np.column_stack([x, y, (x * x - y * y) / 2])
    normals = np.column_stack([-p, -q, np.ones(n)]) / w[:, None]
    return X + noise * rng.normal(size=X.shape), normals, mean + half, mean - half


@pytest.mark.parametrize("n", [900, 5000])  # NumPy and compiled
def test_a_sphere_has_one_over_its_radius(n):
    X, N = sphere(n)
    found = measure(2 * X + [5e5, 5.4e6, 100], -N, 30)
    bias = 30 * 4 / n / 4  # a quarter of the squared radius of a neighborhood: the quartic term
    for values in (found.max_curvature, found.min_curvature, found.mean_curvature):
        assert_allclose(values, 0.5, rtol=2 * bias)
    assert_allclose(found.gaussian_curvature, 0.25, rtol=4 * bias)
    assert (found.shape_index < -0.95).all()  # a cup from within


def test_a_saddle_bends_both_ways():
    X, N, most, least = saddle(5000)
    inside = np.abs(X[:, :2]).max(axis=1) < 0.8
    found = measure(X, N)
    assert_allclose(found.max_curvature[inside], most[inside], atol=0.05)
    assert_allclose(found.min_curvature[inside], least[inside], atol=0.05)
    middle = np.linalg.norm(X[:, :2], axis=1) < 0.1
    assert_allclose(found.shape_index[middle], 0, atol=0.02)
    assert np.abs(found.max[middle, 0]).min() > 0.99
    assert np.abs(found.min[middle, 1]).min() > 0.99


def test_the_fit_is_least_squares_of_the_members_it_chose():
    rng = np.random.default_rng(3)
    u, v = rng.uniform(-1, 1, (2, 40))
    height = 0.1 + 0.2 * u - 0.3 * v + 0.4 * u * u - 0.2 * u * v + 0.1 * v * v
    height += rng.normal(0, 0.01, 40)
    height[:3] += 1.0  # outliers
    points = np.column_stack([u, v, height])
    planes = Planes.unknown(1, 3)
    planes.centroids[:], planes.normals[:] = points[3:].mean(axis=0), [0, 0, 1]
    planes.scale[:], planes.radius[:] = points[3:, 2].std(), 2.0
    around = Neighborhoods(np.arange(40, dtype=np.int32)[None], np.array([40]))
    tangents = np.array([[[1.0, 0, 0], [0, 1, 0]]])
    model = SimpleNamespace(index=SimpleNamespace(points=points), least_scales=lambda at: 0 * at[0])
    jets = _fit_jets(model, planes, np.zeros((1, 3)), around, tangents)
    assert jets.n_used[0] == 37
    design = np.column_stack([np.ones(40), u, v, u * u, u * v, v * v])[3:]
    expected, squares, _, _ = np.linalg.lstsq(design, height[3:], rcond=None)
    assert_allclose(jets.slopes[0], expected[1:3], rtol=1e-9)
    assert_allclose(jets.bends[0], 2 * expected[3:], rtol=1e-9)  # in radii of 2
    deviation = np.sqrt(squares[0] / 31)
    assert_allclose(2 * jets.noise[0], deviation / TRUNCATED, rtol=1e-9)
    covariance = np.linalg.inv(design.T @ design)[3:, 3:]
    lower = np.zeros((3, 3))
    lower[np.tril_indices(3)] = jets.factors[0]
    assert_allclose(np.linalg.inv(lower @ lower.T), 16 * covariance, rtol=1e-8)
    # The mean curvature at zero slopes is half of the sum of the second derivatives.
    gradient = np.array([1.0, 0, 1])
    flat = jets._replace(slopes=np.zeros((1, 2)))
    found = _derive(flat, tangents, planes.normals, planes.radius)
    mean = (found.max_curvature[0] + found.min_curvature[0]) / 2
    assert_allclose(mean, expected[3] + expected[5], rtol=1e-9)
    own = np.sqrt(gradient @ covariance @ gradient) * deviation / TRUNCATED
    assert 1.0 < found.mean_error[0] / own < 1.06  # Student's quantile of 31 over the normal one


@pytest.mark.parametrize(("n", "noise"), [(900, 0.03), (5000, 0.005), (5000, 0.015)])
def test_errors_are_those_of_repeated_measurement(n, noise):
    X, N = sphere(n, noise)
    found = measure(X, -N, 30)
    bias = 30 * 4 / n / 4
    z = (found.mean_curvature - 1 - bias) / found.mean_curvature_error
    assert 0.8 < z.std() < 1.3
    assert abs(z.mean()) < 0.4


def test_outliers_do_not_bend_a_sphere():
    X, N = sphere(4500, 0.005)
    outliers = np.random.default_rng(1).uniform(-1.3, 1.3, (500, 3))
    clean = measure(X, -N)
    spoiled = measure(np.vstack([X, outliers]), np.vstack([-N, np.ones((500, 3))]))
    errors = [np.abs(found.mean_curvature[:4500] - 1) for found in (clean, spoiled)]
    assert np.median(errors[1]) < 1.2 * np.median(errors[0])
    assert np.quantile(errors[1], 0.95) < 2 * np.quantile(errors[0], 0.95)


@pytest.fixture(scope="module")
def mixed():
    """Curved, flat and creased surfaces with stray points."""
    rng = np.random.default_rng(0)
    parts = [torus(900, 0.003)[0], 2 + corner(800)[0], rng.uniform(-1, 3, (60, 3))]
    return np.vstack(parts)


@pytest.mark.parametrize(
    "parameters", [{}, {"method": "pca"}, {"radius": 0.25}, {"method": "ransac"}]
)
def test_new_points_and_threads_give_the_same(mixed, parameters):
    X = np.vstack([mixed, mixed[:5]])  # copies
    estimator = RobustNormalEstimator(30, features=NAMES, random_state=0, **parameters)
    found = estimator.fit_transform(X)
    assert_array_equal(estimator.transform(X), found)
    assert_allclose(estimator.transform(X[7:8]), found[7:8], rtol=1e-9, atol=1e-12)
    assert_array_equal(clone(estimator).set_params(n_jobs=2).fit_transform(X), found)
    assert np.isfinite(found).all()


@cache
def torus_measured():
    X, N = torus(1500, 0.004)
    return X, N, measure(X, N, 30)


@given(
    seed=st.integers(0, 2**32 - 1),
    scale=st.floats(1e-3, 1e3),
    shift=st.lists(st.floats(-1e3, 1e3), min_size=3, max_size=3),
)
@settings(max_examples=10)
def test_curvatures_move_with_the_cloud(seed, scale, shift):
    X, N, ours = torus_measured()
    turn = Rotation.random(random_state=seed).as_matrix()
    theirs = measure(scale * (X @ turn.T + shift), N @ turn.T, 30)
    for name in NAMES[:8]:
        power = {"gaussian_curvature": 2, "shape_index": 0}.get(name, 1)
        moved = scale**power * getattr(theirs, name)
        close = np.isclose(moved, getattr(ours, name), rtol=1e-4, atol=1e-5)
        assert close.mean() > 0.99, name  # rounding may tip a member on a limit
    for name in ("max", "min"):
        parallel = np.abs(
            np.einsum("ij,ij->i", getattr(ours, name) @ turn.T, getattr(theirs, name))
        )
        assert (parallel > 1 - 1e-6).mean() > 0.99


def test_copies_seen_from_the_other_side_have_the_other_signs():
    """On a valley along y: some normals have a y of exactly 0, which has no sign."""
    x, y = (values.ravel() / 8 for values in np.mgrid[-10:11, -10:11])
    X = np.column_stack([x, y, x * x])
    estimator = RobustNormalEstimator(
        30, radius=0.4, method="pca", orientation="sensor", features="mean_curvature"
    )
    sensors = np.repeat([[0, 0, 9.0], [0, 0, -9.0]], len(X), axis=0)
    estimator.fit(np.vstack([X, X]), sensor_origin=sensors)
    above, below = np.split(estimator.features_[:, 0], 2)
    assert np.count_nonzero(above) > 0.8 * len(X)
    assert_array_equal(below, -above)


def test_directions_are_unit_vectors_in_the_surface(mixed):
    found = measure(mixed, n_neighbors=30)
    known = found.max.any(axis=1)
    assert known.mean() > 0.99
    assert_allclose(np.linalg.norm(found.max[known], axis=1), 1)
    assert_allclose(np.einsum("ij,ij->i", found.max, found.min), 0, atol=1e-9)
    for vectors in (found.max, found.min):
        assert (vectors[known, 2] >= 0).all()


@pytest.mark.parametrize("orientation", [None, "sensor"])
def test_one_neighborhood_has_one_quadric(orientation):
    X, N, most, least = saddle(200)
    X, N = (np.vstack([A, A * [-1, 1, 1], A * [1, -1, 1], A * [-1, -1, 1]]) for A in (X, N))
    sensor_origin = (
        None if orientation is None else [0.05, 0, 0.02]
    )  # on either side of the surface
    found = measure(X, N, None, orientation=orientation, sensor_origin=sensor_origin)
    assert_allclose(found.max_curvature, np.tile(most, 4), rtol=1e-6)  # symmetry: no tilt
    assert_allclose(found.min_curvature, np.tile(least, 4), rtol=1e-6)


@pytest.mark.filterwarnings("ignore:the n_neighbors=20 nearest")  # two lines are rows
def test_what_nothing_determines_is_zero_with_the_largest_error():
    rng = np.random.default_rng(0)
    line = np.column_stack([rng.uniform(0, 1, 60), np.zeros((60, 2))])
    few = rng.uniform(0, 1, (30, 3)) * [1, 1, 0]
    two_lines = np.column_stack([rng.uniform(0, 1, 60), np.arange(60) % 2, np.zeros(60)])
    for X, k in ((line, 20), (few, 7), (two_lines, 20)):
        estimator = RobustNormalEstimator(k, features=NAMES, random_state=0).fit(X)
        distances = np.sort(np.linalg.norm(X - X[3], axis=1))
        assert_array_equal(np.delete(estimator.features_, [5, 6, 7], axis=1), 0)
        assert_allclose(estimator.features_[3, 5:8], 1 / distances[k - 1])
