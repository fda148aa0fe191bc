"""RobustNormalEstimator: the reference, truth, invariances, orientation, columns."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from reference import plane, saliency
from scenes import sphere
from sklearn_mcmd import RobustNormalEstimator
from sklearn_mcmd.datasets import make_street
from sklearn_mcmd.metrics import bias_angle
from sklearn_mcmd.planes._consistent_set import draw_trials

GRID = np.array([5e5, 5.4e6, 100])  # national grid coordinates


@pytest.fixture(scope="module")
def street():
    return make_street(6000, random_state=0)


@pytest.mark.parametrize("n", [400, 3000])  # NumPy and compiled
@pytest.mark.parametrize(("method", "cutoff"), [("mcmd_z", 2.5), ("mcmd_md", 3.0575159)])
def test_normals_equal_algorithm_4_taken_literally(n, method, cutoff):
    X = make_street(n, random_state=2).data
    estimator = RobustNormalEstimator(
        30, method=method, reweight=False, max_outlier_rate=0.2, random_state=1
    ).fit(X)
    trials = draw_trials(estimator.n_trials_, 30, random_state=1)
    for i in range(0, 60, 3):
        _, normal, eigenvalues = saliency(X, X[i], 30, trials, 15, method, cutoff)
        assert bias_angle(estimator.normals_[i], normal) < 1e-6
        assert_allclose(estimator.eigenvalues_[i], eigenvalues, rtol=1e-9, atol=1e-18)
        assert_allclose(estimator.surface_variation_[i], eigenvalues[0] / eigenvalues.sum())


@pytest.mark.filterwarnings("ignore:the n_neighbors=50 nearest")  # steps make rows
def test_float32_at_national_grid_coordinates_warns(street):
    moved = (street.data + GRID).astype(np.float32)
    with pytest.warns(UserWarning, match="float32. rounds coordinates as large as 5,4"):
        RobustNormalEstimator(random_state=0).fit(moved)


def test_transform_of_the_training_cloud_is_fit_transform(street):
    estimator = RobustNormalEstimator(random_state=0)
    columns = estimator.fit_transform(street.data)
    assert_array_equal(columns, estimator.transform(street.data))
    assert_array_equal(columns[:, :3], street.data)
    assert_array_equal(columns[:, 3:6], estimator.normals_)
    assert_array_equal(columns[:, 6], estimator.surface_variation_)
    assert_array_equal(columns[:, 7:10], estimator.eigenvalues_)
    assert_array_equal(columns[:, 10], estimator.plane_offset_)
    assert_array_equal(columns[:, 11], estimator.plane_scale_)


def test_a_radius_takes_the_points_within_it(street):
    X = street.data
    estimator = RobustNormalEstimator(200, radius=0.2, method="pca").fit(X)
    for i in range(0, 200, 20):
        inside = X[np.linalg.norm(X - X[i], axis=1) <= 0.2]
        if 4 <= len(inside) <= 200:
            _, eigenvalues, axes = plane(inside)
            assert_allclose(estimator.eigenvalues_[i], eigenvalues, rtol=1e-9)
            assert bias_angle(estimator.normals_[i], axes[:, 0]) < 1e-6


@pytest.mark.parametrize("n", [300, 3000])
def test_lonely_points_use_their_nearest_neighbors(n):
    X = make_street(n, random_state=0).data
    columns = RobustNormalEstimator(30, radius=1e-6, random_state=0).fit_transform(X)
    assert np.isfinite(columns).all()
    expected = RobustNormalEstimator(4, method="pca").fit(X)
    found = RobustNormalEstimator(30, radius=1e-6, method="pca").fit(X)
    assert_allclose(found.eigenvalues_, expected.eigenvalues_, rtol=1e-9, atol=1e-30)


@pytest.mark.parametrize("n", [100, 2000])
def test_collinear_neighborhoods_have_a_defined_normal(n):
    t = np.linspace(0, 1, n)[:, None]
    normals = RobustNormalEstimator(20, random_state=0).fit(t * [[1.0, 1.0, 0.0]]).normals_
    assert_allclose(normals, np.tile([0, 0, 1.0], (n, 1)), atol=1e-9)
    steep = RobustNormalEstimator(20, random_state=0).fit(t * [[0.0, 0.0, 1.0]])
    assert_allclose(np.abs(steep.normals_ @ [0, 0, 1]), 0, atol=1e-9)
    assert_allclose(steep.surface_variation_, 0, atol=1e-12)


@pytest.mark.parametrize("direction", [None, [0.0, -1.0, 0.2]])
def test_normals_point_up_or_to_the_side_of_a_direction(street, direction):
    normals = RobustNormalEstimator(orientation=direction, random_state=0).fit(street.data).normals_
    assert (normals @ (direction or [0, 0, 1]) >= 0).all()


def test_level_normals_point_to_where_the_coordinate_before_the_last_is_positive():
    across, up = np.mgrid[:20.0, :20.0].reshape(2, -1)
    wall = np.stack([across, across, up], axis=1)
    normals = RobustNormalEstimator(20, random_state=0).fit(wall).normals_
    level = normals[normals[:, 2] == 0]
    assert level.size
    assert (level[:, 1] > 0).all()


def test_normals_point_to_the_sensor():
    X, directions = sphere(2000)
    inside = RobustNormalEstimator(
        20, orientation="sensor", sensor_origin="origin", random_state=0
    ).fit(X)
    assert (np.einsum("ij,ij->i", inside.normals_, directions) < -0.9).all()
    assert_array_equal(inside.transform(X[:9])[:, 3:6], inside.normals_[:9])


@pytest.fixture(scope="module")
def corridor():
    """A floor and a ceiling, and where a sensor between them was when it saw each point."""
    rng = np.random.default_rng(0)
    X = rng.uniform(0, 8, (2400, 3)) * [1, 0.2, 0] + rng.normal(0, 0.002, (2400, 3))
    X[1200:, 2] += 2
    origins = np.column_stack([X[:, 0] + 0.3, np.full(2400, 0.8), np.full(2400, 1.0)])
    origins[np.arange(2400) % 3 == 0, 2] = [[5.0]]  # a second one, above the ceiling
    return X, origins


MOVED = {"orientation": "sensor", "random_state": 0}


def test_normals_point_to_where_the_sensor_was_at_each_point(corridor):
    X, origins = corridor
    fitted = RobustNormalEstimator(20, **MOVED).fit(X, sensor_origin=origins)
    toward = np.einsum("ij,ij->i", fitted.normals_, origins - X)
    assert (toward > 0).all()
    above = origins[:, 2] > 2
    assert_array_equal(np.sign(fitted.normals_[1200:, 2]), np.where(above[1200:], 1, -1))
    columns = RobustNormalEstimator(20, **MOVED).fit_transform(X, sensor_origin=origins)
    assert_array_equal(columns[:, 3:6], fitted.normals_)
    assert_array_equal(fitted.transform(X)[:, 3:6], fitted.normals_)
    # New points count as measured from where the nearest was; the order of rows does not matter.
    near = fitted.transform(X + 1e-7)[:, 3:6]
    assert (np.einsum("ij,ij->i", near, fitted.normals_) > 0).all()
    order = np.random.default_rng(1).permutation(len(X))
    again = RobustNormalEstimator(20, **MOVED).fit(X[order], sensor_origin=origins[order])
    assert_array_equal(again.normals_, fitted.normals_[order])


def test_one_neighborhood_looks_to_where_the_sensor_was(corridor):
    X, origins = corridor[0][:1200], corridor[1][:1200] * [1, 1, -1]
    origins[::2, 2] *= -1
    fitted = RobustNormalEstimator(None, **MOVED).fit(X, sensor_origin=origins)
    assert_array_equal(np.sign(fitted.normals_[:, 2]), np.sign(origins[:, 2]))
    assert_array_equal(fitted.transform(X)[:, 3:6], fitted.normals_)


@pytest.mark.parametrize("shift", [0.0, 1e6])
def test_a_spanning_tree_orients_closed_surfaces_outward(shift):
    first, directions = sphere(1500)
    second, more = sphere(1200, seed=1)
    X = np.vstack([first, 0.5 * second + [5, 0, 0]]) + shift  # two parts, not connected
    estimator = RobustNormalEstimator(20, orientation="mst", random_state=0).fit(X)
    outward = np.einsum("ij,ij->i", estimator.normals_, np.vstack([directions, more]))
    assert (outward > 0.9).all()
    queries = X[::7]
    assert_array_equal(estimator.transform(queries)[:, 3:6], estimator.normals_[::7])


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"orientation": "sensor"}, "needs sensor_origin, where the sensor stood"),
        ({"sensor_origin": [0, 0, 9]}, "orientation is not"),
        ({"orientation": [0, 0, 0]}, "must not be zero"),
        ({"orientation": [0, 1]}, r"orientation must have shape \(3,\)"),
        ({"orientation": "sensor", "sensor_origin": [0, 0, np.nan]}, "sensor_origin contains NaN"),
        ({"orientation": "sensor", "sensor_origin": [0, 0]}, r"sensor_origin must be .* shape"),
        ({"radius": 1.0, "n_neighbors": None}, "radius=1.0 has no meaning with n_neighbors=None"),
    ],
)
def test_bad_parameters_are_named(street, parameters, message):
    with pytest.raises(ValueError, match=message):
        RobustNormalEstimator(**parameters).fit(street.data)
