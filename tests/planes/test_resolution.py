"""Rounded coordinates: the steps are found, one step is no outlier, and no normal is sure of itself
on one level."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from depth_frames import GROWTH, turned_wall
from sklearn_mcmd import MCMDOutlierDetector, RegionGrowing, RobustNormalEstimator
from sklearn_mcmd.metrics import bias_angle
from sklearn_mcmd.planes._resolution import coordinate_steps, in_own_precision


def lattice_of(X):
    return coordinate_steps(X).lattice


def rounded_plane(step, n=3000, seed=0):
    rng = np.random.default_rng(seed)
    X = rng.uniform(0, 2, (n, 3)) * [1, 1, 0] + rng.normal(0, 0.003, (n, 3))
    X[:, 2] += 0.02 * X[:, 0]
    return np.round(X / step) * step


@pytest.mark.parametrize("step", [0.01, 0.001, 2.5])
@pytest.mark.parametrize("shift", [0, 5e6])
@pytest.mark.parametrize("n", [50, 20_000])
def test_the_step_of_rounded_coordinates_is_found(step, shift, n):
    X = np.random.default_rng(0).uniform(0, 100 * step, (n, 3))
    assert_allclose(lattice_of(np.round(X / step) * step + shift), step, rtol=1e-4)


@pytest.mark.parametrize("n", [1, 5, 20, 1000, 100_000])
def test_continuous_coordinates_have_no_step(n):
    for seed in range(5):
        X = np.random.default_rng(seed).normal(size=(n, 3))
        assert lattice_of(X) == 0


def test_steps_are_found_that_float32_has_rounded_once_more():
    X = np.round(np.random.default_rng(0).uniform(0, 0.3, (3000, 3)), 3) + 400
    assert_allclose(lattice_of(X.astype(np.float32)), 0.001, rtol=0.01)


def test_coordinates_that_are_a_hundredth_of_a_step_off_a_lattice_have_no_step():
    off = np.random.default_rng(0).uniform(-0.01, 0.01, (400, 3))
    assert lattice_of(np.arange(400.0)[:, None] + off) == 0


def test_a_raster_of_heights_has_no_step():
    x, y = np.meshgrid(np.arange(30.0), np.arange(30.0))
    z = np.random.default_rng(0).normal(size=900)
    assert lattice_of(np.column_stack([x.ravel(), y.ravel(), z])) == 0
    assert lattice_of(np.column_stack([x.ravel(), y.ravel(), 0 * z])) == 0
    z = np.where(np.arange(900) == 7, 1.0, 0.0)  # an outlier
    X = np.column_stack([x.ravel(), y.ravel(), z])
    assert lattice_of(X) == 0
    assert MCMDOutlierDetector(random_state=0).fit_predict(X)[7] == -1


def test_a_level_floor_shares_the_step_of_the_other_axes():
    rng = np.random.default_rng(0)
    X = rng.uniform(0, 2, (5000, 3)) * [1, 1, 0] + rng.normal(0, 0.003, (5000, 3))
    X = np.round(X / 0.01) * 0.01  # two or three levels of z
    assert_allclose(lattice_of(X), 0.01)
    assert (MCMDOutlierDetector(random_state=0).fit_predict(X) == -1).mean() < 0.01


def test_a_few_points_that_were_not_rounded_do_not_matter():
    X = rounded_plane(0.01)
    X[:3] = [[0.50031, 0.50012, 0.00013], [0.1234, 0.4321, 0.0077], [1.00349, 0.7071, 0.0141]]
    assert_allclose(lattice_of(X), 0.01, rtol=1e-3)


@pytest.mark.parametrize(("n_between", "step"), [(3, 1), (6, 0)])
def test_at_most_two_percent_of_gaps_may_be_shorter_than_the_step(n_between, step):
    """Each point between two whole numbers makes two short gaps of a long one, of 400."""
    axis = np.append(np.arange(400.0), 50 * np.arange(1, n_between + 1) + 0.3)
    assert lattice_of(np.stack([axis] * 3, axis=1)) == step


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("unit", [1.0, -1.0, 1000.0])
@pytest.mark.parametrize("moved", [0.0, 7.0])
def test_levels_of_a_depth_are_found(axis, unit, moved):
    X = unit * turned_wall(60, 3, axis)[0]
    places = (X + unit * moved).astype(np.float32)
    steps = coordinate_steps(places)
    assert steps.axis == axis
    # Depths are rounded to millimeters as well, a tenth of their steps.
    expected = abs(unit) * GROWTH * np.square(X[:, axis] / unit)
    assert_allclose(steps.at(places), expected, rtol=0.1)
    off = unit * np.random.default_rng(0).normal(0, 1e-3, (200, 3))
    some_off = np.vstack([X, X[:200] + off])  # less than 1 %
    assert_allclose(coordinate_steps(some_off).at(X), expected, rtol=0.1)


def test_levels_are_found_where_most_points_are_on_few_and_between_are_none():
    X = turned_wall(75, 3)[0]
    facing = np.repeat(X[np.argsort(X[:, 2])[:100]], 300, axis=0)  # half of all, on one level
    for frame in (np.vstack([X, facing]), X[(X[:, 2] < 2.6) | (X[:, 2] > 3.4)]):
        steps = coordinate_steps(frame)
        assert_allclose(steps.at(X), GROWTH * X[:, 2] ** 2, rtol=0.1)


STATIONS = np.arange(100.0, 300)  # places along x, of profiles or rasters
NO_DEPTHS = {
    "even": STATIONS,
    "national": 1e3 + 0.01 * STATIONS,
    "random": np.sort(np.random.default_rng(0).uniform(1, 9, 200)),
    "a lattice with holes": np.delete(STATIONS, np.arange(0, 90, 7)),
    "growing": 1.01**STATIONS,
    "two rasters": np.append(STATIONS[:100], 200 + 2 * np.arange(100)),
    "squares": STATIONS**2,
    "float16": np.arange(1, 4, 0.01).astype(np.float16).astype(float),
    "tiny": 1e-170 * STATIONS,
    "zeros that are no returns": np.append(0.0, 50 + STATIONS),
}


@pytest.mark.parametrize("places", NO_DEPTHS.values(), ids=NO_DEPTHS)
def test_levels_that_are_no_depths_have_no_growth(places):
    floor = np.random.default_rng(0).uniform(-1, 1, (100 * len(places), 3)) * [1, 1, 0.001]
    floor[:, 0] = np.repeat(places, 100)
    assert coordinate_steps(floor).growth == 0


@pytest.mark.parametrize(
    ("turn", "depth", "n_neighbors"),
    [(20, 3, 50), (40, 3, 50), (40, 5, 50), (60, 5, 50), (75, 3, 50), (60, 3, "auto")],
)
def test_a_wall_that_a_camera_saw_in_levels_knows_how_its_normals_are_off(turn, depth, n_neighbors):
    X, normal = turned_wall(turn, depth)
    features = ["normal_error"]
    estimator = RobustNormalEstimator(n_neighbors, features=features, random_state=0).fit(X)
    off = bias_angle(estimator.normals_, np.tile(normal, (len(X), 1)))
    # 95 % are asked; where no level was known, 0 to 33 % were.
    assert np.mean(off <= 1.73 * estimator.normal_error_) > 0.94
    assert np.median(estimator.normal_error_) < (60 if np.median(off) > 10 else 8)
    assert estimator.normal_error_.max() <= 90
    told = estimator.transform(X[::50])
    assert_allclose(told[:, 3:6], estimator.normals_[::50])
    assert_allclose(told[:, -1], estimator.normal_error_[::50])


def test_levels_across_a_neighborhood_are_one_surface():
    X, normal = turned_wall(60, 3)  # a level each 3 cm; .41 within 10 degrees, 91 regions before
    off = bias_angle(RobustNormalEstimator(random_state=0).fit(X).normals_, normal[None])
    assert np.mean(off < 10) > 0.99
    regions = RegionGrowing(random_state=0).fit(X)
    assert regions.region_sizes_[0] > 0.99 * len(X)


@pytest.mark.parametrize("method", ["mcmd_z", "mcmd_md"])
def test_a_plane_rounded_to_centimeters_is_not_full_of_outliers(method):
    """Without a least scale a quarter of the points would be, most of them infinitely far."""
    X = rounded_plane(0.01)
    X[:20, 2] += 0.1
    labels = MCMDOutlierDetector(method=method, random_state=0).fit_predict(X)
    assert (labels[20:] == -1).mean() < 0.03
    assert (labels[:20] == -1).all()


NATIONAL, FAR = np.array([[400_000.0, 5_700_000.0, 100.0], [400_000.0, 9_000_000.0, 100.0]])


def raster(step, corner=NATIONAL):
    """Heights on a raster, whole ones."""
    x, y = step * np.mgrid[:40, :40].reshape(2, -1)
    return np.column_stack([x, y, np.round(5 * np.sin(x / 9 / step) + 0.3 * y / step)]) + corner


def single(X):
    return X.astype(np.float32).astype(float)


RNG = np.random.default_rng(0)
WHOLE = {
    "a raster of 10 m": raster(10.0),
    "centers of a raster of 1 m": raster(1.0, np.array([400_000.5, 5_700_000.5, 100])),
    "heights of float32": single(raster(10.0) * [1, 1, 0.917]),
    "whole meters anywhere": RNG.integers(0, 300, (2000, 3)) + NATIONAL,
    "where float32 has steps of 1 m": RNG.integers(0, 300, (2000, 3)) + FAR,
    "a raster there": single(raster(10.0, np.array([400_005.0, 9_000_005.0, 0])) * [1, 1, 0.917]),
    "eastings with the number of the zone": raster(10.0, np.array([32_400_000, 5_700_000, 100])),
    "half meters": single(raster(0.5) * [1, 1, 0.917]),
    "5 m where float32 has steps of 1 m": single(raster(5.0, FAR) * [1, 1, 0.917]),
    "some points off it": np.vstack([raster(10.0), single(RNG.random((9, 3)) * 300 + NATIONAL)]),
}
ROUNDED = {
    "a scan": RNG.random((2000, 3)) * 9 + NATIONAL,
    "a scan of centimeters": np.round(RNG.random((2000, 3)) * 9 + NATIONAL, 2),
    "where float32 has steps of 1 m": RNG.random((2000, 3)) * 9 + FAR,
    "whole numbers as large on all axes": RNG.integers(0, 60, (2000, 3)) + 1.6e7,
    "a tile": RNG.random((2000, 3)) * [1000, 1000, 50] + NATIONAL,
    "a floor": RNG.random((2000, 3)) * [9, 9, 0] + NATIONAL,
    "a wall along an axis": RNG.normal(0, [9, 0.05, 9], (2000, 3)) + NATIONAL,
    "a wall along the other": RNG.normal(0, [0.001, 9, 9], (2000, 3)) + NATIONAL,
    "eastings with the number of the zone": RNG.random((2000, 3)) * 60 + [32_400_000, 5.7e6, 100],
    "a room": RNG.random((2000, 3)) * 4 - 2,
    "whole millimeters": RNG.integers(0, 4000, (2000, 3)).astype(float),
}


@pytest.mark.parametrize("X", WHOLE.values(), ids=WHOLE)
def test_whole_meters_in_national_coordinates_are_not_rounded_by_float32(X):
    assert np.array_equal(single(X), X)
    assert in_own_precision(X).dtype == np.float64


@pytest.mark.parametrize("name", ROUNDED)
def test_numbers_that_were_float32_are_float32(name):
    X = single(ROUNDED[name])
    assert in_own_precision(X).dtype == np.float32
    assert in_own_precision(X + 1e-4).dtype == np.float64
