"""Where the sensor stood: empty space, sheets of rays, sparse surfaces, and what stays the same."""

import pickle

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from outliers.test_ray_evidence import FORM, sheet_at_an_edge
from sklearn_mcmd import MCMDOutlierDetector
from sklearn_mcmd.datasets import make_street
from sklearn_mcmd.outliers._detector import judged_cloud
from sklearn_mcmd.sensors._rays import one_far_position

HEIGHT = 2.0  # of the sensor above the ground of the simulated room


def room(n_rings=32, n_steps=240, rng=None, noise=0.003):
    """A turn of a sensor at the origin in a room of 20 m by 20 m, its ground 2 m below."""
    rng = rng or np.random.default_rng(0)
    elevation = np.repeat(np.radians(np.linspace(-40, 12, n_rings)), n_steps)
    azimuth = np.tile(np.linspace(-np.pi, np.pi, n_steps, endpoint=False), n_rings)
    azimuth += 0.3 * (azimuth[1] - azimuth[0]) * rng.random(len(azimuth))
    around = np.column_stack([np.cos(azimuth), np.sin(azimuth)])
    rays = np.column_stack([np.cos(elevation)[:, None] * around, np.sin(elevation)])
    wall = 10 / np.abs(rays[:, :2]).max(axis=1)
    with np.errstate(divide="ignore"):
        ground = np.where(rays[:, 2] < 0, HEIGHT / -rays[:, 2], np.inf)
    ranges = np.minimum(wall, ground) + rng.normal(0, noise, len(rays))
    return ranges[:, None] * rays


def flakes(n, rng):
    """Points in the free space of the room."""
    directions = rng.normal(size=(n, 3)) * [1, 1, 0.2]
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return rng.uniform(1.5, 4.5, (n, 1)) * directions


@pytest.fixture(scope="module")
def snowed():
    rng = np.random.default_rng(1)
    X = np.vstack([room(rng=rng), flakes(300, rng)])
    order = rng.permutation(len(X))
    return X[order], np.repeat([False, True], [len(X) - 300, 300])[order]


def detector(**parameters):
    return MCMDOutlierDetector(random_state=0, **parameters)


@pytest.fixture(scope="module")
def street():
    errors = {"outlier_share": 0.1, "outlier_kinds": ["mixed_pixel"]}
    return make_street(12_000, sampling="scan_lines", tree=True, random_state=0, **errors)


def on_sheets(fitted, rows):
    """Which of some rows are isolated by a sheet of rays."""
    judged = judged_cloud(fitted)
    return np.isin(judged.index.places[rows], judged.off_surface.rows[judged.beside_rays.by_sheet])


def test_mixed_pixels_are_on_sheets_and_a_single_point_is_not(street):
    fitted = detector(sensor_origin=street.sensor_origins[0]).fit(street.data)
    mixed = np.flatnonzero((street.target == -1) & (fitted.scores_ < -3))[::10]
    assert on_sheets(fitted, mixed).mean() > 0.9
    turn = np.vstack([room(), [[3.0, 1.0, 0.5]]])
    assert not on_sheets(detector(sensor_origin="origin").fit(turn), [len(turn) - 1]).any()


def test_a_position_on_the_ground_is_doubted_and_that_of_the_scanner_is_not(street):
    """The ground contains the rays from a point on it; most of it would be sheets of rays."""
    X, plain = street.data, detector().fit(street.data)
    ground = street.sensor_origins[0] * [1, 1, 0]
    with pytest.warns(UserWarning, match="% of all that is flat would be sheets .* or none"):
        told = detector(sensor_origin=ground).fit(X)
    assert_array_equal(told.sensor_origin_, ground)  # what is told is used
    assert np.mean(told.scores_ < -3) > 0.15 > 0.1 > np.mean(plain.scores_ < -3)
    with pytest.warns(UserWarning, match="It is not used"):
        claimed = detector(sensor_origin="auto").fit(X, sensor_origin=ground)
    assert claimed.sensor_origin_ is None
    assert claimed.n_by_rays_ == 0
    assert_array_equal(claimed.scores_, plain.scores_)
    assert_array_equal(claimed.score_samples(X[:50] + 0.01), plain.score_samples(X[:50] + 0.01))
    right = detector(sensor_origin="auto").fit(X, sensor_origin=street.sensor_origins[0])
    assert_array_equal(right.sensor_origin_, street.sensor_origins[0])


@pytest.mark.parametrize("cutoff", [0.5, 3.0])
def test_points_on_sheets_are_outliers_by_rays_alone_at_any_cutoff(cutoff):
    X, sensor = sheet_at_an_edge(np.random.default_rng(0))
    fitted = MCMDOutlierDetector(**FORM, cutoff=cutoff).fit(X, sensor_origin=sensor)
    assert fitted.n_by_rays_ == np.count_nonzero(on_sheets(fitted, np.arange(60))) > 40
    assert MCMDOutlierDetector(**FORM, cutoff=cutoff).fit(X).n_by_rays_ == 0


def test_one_position_for_each_point_says_the_same_as_one_for_all(snowed):
    X = snowed[0][::4]  # its rows are in no order
    expected = detector(sensor_origin="origin").fit(X).scores_
    assert_array_equal(detector(sensor_origin=[0.0, 0.0, 0.0]).fit(X).scores_, expected)
    for origin in ("origin", np.zeros(3), np.zeros_like(X)):
        scores = detector(sensor_origin=[7.0, 7.0, 7.0]).fit(X, sensor_origin=origin).scores_
        assert_array_equal(scores, expected)


def test_neither_the_order_of_rows_nor_threads_matter(snowed):
    X = snowed[0][::4]  # its rows are in no order
    scores = detector(sensor_origin="origin").fit(X).scores_
    assert_array_equal(detector(sensor_origin="origin", n_jobs=2).fit(X).scores_, scores)
    order = np.random.default_rng(2).permutation(len(X))
    assert_array_equal(detector(sensor_origin="origin").fit(X[order]).scores_, scores[order])
    origins = np.random.default_rng(3).normal(0, 0.1, X.shape)
    scores = detector().fit(X, sensor_origin=origins).scores_
    shuffled = detector().fit(X[order], sensor_origin=origins[order]).scores_
    assert_array_equal(shuffled, scores[order])


def test_points_of_the_cloud_keep_their_scores_and_new_flakes_are_found(snowed):
    X, _ = snowed
    for origin in ("origin", np.zeros_like(X)):
        fitted = detector().fit(X, sensor_origin=origin)
        assert_array_equal(fitted.score_samples(X), fitted.scores_)
        assert_array_equal(detector().fit_predict(X, sensor_origin=origin), fitted.predict(X))
        rng = np.random.default_rng(5)
        assert (fitted.predict(flakes(200, rng)) == -1).mean() > 0.9
        assert (fitted.predict(room(rng=rng)[::7]) == -1).mean() < 0.01
        again = pickle.loads(pickle.dumps(fitted))
        assert_array_equal(again.score_samples(X[::9] + 0.01), fitted.score_samples(X[::9] + 0.01))


def test_points_at_the_sensor_go_by_coordinates(snowed):
    X, snow = snowed
    with_silent = np.vstack([X, np.zeros((400, 3))])
    flagged = detector(sensor_origin="origin").fit_predict(with_silent) == -1
    assert not flagged[len(X) :].any()  # places measured so often keep company with themselves
    assert flagged[: len(X)][snow].mean() > 0.95


def test_what_carries_the_sensor_is_judged_as_if_it_had_no_ray():
    """The roof of a car under it, which its beams graze; nearer than a tenth of the usual range."""
    X = room()
    ranges = np.linalg.norm(X, axis=1)
    on_roof = 0.3 / np.maximum(-X[:, 2] / ranges, 1e-9)
    own = on_roof < 0.09 * np.median(ranges)
    on_roof += np.random.default_rng(1).normal(0, 0.03, len(X))
    X[own] *= (on_roof / ranges)[own, None]
    plain, told = (detector(sensor_origin=where).fit(X) for where in (None, "origin"))
    assert own.sum() > 500
    assert_array_equal(told.scores_[own], plain.scores_[own])


@pytest.mark.filterwarnings("ignore:as seen from the sensor")  # which is in the plane
def test_a_point_so_near_to_the_sensor_that_squares_vanish_is_where_the_sensor_is():
    rng = np.random.default_rng(0)
    X = rng.uniform(-1, 1, (600, 3)) * [1, 1, 0] + rng.normal(0, 0.01, (600, 3))
    X[0] = 0.0
    at, beside = (
        MCMDOutlierDetector(sensor_origin=origin, random_state=0).fit(X).scores_
        for origin in ([0.0, 0, 0], [1e-200, 0, 0])
    )
    assert_array_equal(at, beside)


@pytest.mark.parametrize(
    ("origin", "message"),
    [
        ([0.0, 0.0], r"sensor_origin must be .* shape \(3,\).*got shape \(2,\)"),
        (np.zeros((7, 3)), r"sensor_origin must be .* got shape \(7, 3\)"),
        ([0.0, np.nan, 0.0], "sensor_origin contains NaN"),
        ("there", "sensor_origin"),
        ([1.0, 1.0, 1.0], "sensor_origin is where all points are"),
    ],
)
def test_errors_name_the_parameter(origin, message):
    X = np.ones((60, 3))
    with pytest.raises(ValueError, match=message):
        detector().fit(X, sensor_origin=origin)
    with pytest.raises(ValueError, match=message):
        detector(sensor_origin=origin).fit(X)


@pytest.mark.parametrize("n_features", [2, 3, 4])
def test_it_works_in_any_dimension_and_on_few_points(n_features):
    rng = np.random.default_rng(0)
    for n in (8, 60, 300):
        X = 3 + rng.random((n, n_features)) * np.r_[np.ones(n_features - 1), 0.01]
        scores = detector(n_neighbors=8, sensor_origin="origin").fit(X).scores_
        assert np.isfinite(scores).all()


def test_one_position_far_from_the_cloud_tells_no_sheets():
    """A facade below an aircraft: it may have been seen from the side."""
    rng = np.random.default_rng(0)
    facade = rng.uniform([0, 0, 0], [20, 0.02, 20], (8000, 3))
    ground = rng.uniform([0, -20, 0], [20, 0, 0.02], (8000, 3))
    X = np.vstack([facade, ground])
    flagged = detector(sensor_origin=[10, -5, 500]).fit_predict(X) == -1
    assert flagged.mean() < 0.01
    assert one_far_position(X, np.broadcast_to([10.0, -5, 500], X.shape))
    assert not one_far_position(X, np.broadcast_to([10.0, -5, 30], X.shape))
    assert not one_far_position(X, np.vstack([X[1:], X[:1]]) + 500)


def test_one_position_far_from_the_cloud_isolates_no_point():
    """It is not exact, so it may excuse what is sparse, as twigs are, and condemns nothing."""
    rng = np.random.default_rng(0)
    ground = rng.uniform([0, 0, 0], [20, 20, 0.02], (4000, 3))
    twigs = rng.uniform([0, 0, 1], [20, 20, 4], (200, 3))
    X = np.vstack([ground, twigs])
    alone = detector().fit(X).isolation_
    with_position = detector(sensor_origin=[10, 10, 500]).fit(X).isolation_
    assert (with_position <= alone).all()
    assert (with_position < 0.9 * alone)[-200:].any()


def test_a_point_beside_a_wall_is_not_excused_by_the_beams_that_meet_the_wall():
    """Single points off a wall, 20 standard deviations of its noise and 2 of its spacings."""
    y, z = (g.ravel() for g in np.meshgrid(np.linspace(-1, 1, 41), np.linspace(-1, 1, 41)))
    rng = np.random.default_rng(0)
    wall = np.column_stack([5 + rng.normal(0, 0.005, y.size), y, z])
    errors = np.column_stack([np.full(9, 4.9), *(0.5 * g.ravel() for g in np.mgrid[-1:2, -1:2])])
    fitted = detector(sensor_origin="origin").fit(np.vstack([wall, errors]))
    assert (fitted.isolation_[-9:] > 3).all()


def test_new_points_of_a_ghost_are_judged_as_the_ghost(snowed):
    X, snow = snowed
    ghost = np.array([3.0, 2.0, 0.3]) + np.random.default_rng(5).normal(0, 0.03, (40, 3))
    fitted = detector(sensor_origin="origin").fit(np.vstack([X[~snow], ghost]))
    assert (fitted.scores_[-40:] < -3).all()
    assert (fitted.predict(ghost + 1e-4) == -1).all()
