"""What rays tell equals what the literal oracle says, on small clouds."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from reference import judged
from sklearn_mcmd import MCMDOutlierDetector
from sklearn_mcmd.outliers._ray_evidence import RayEvidence
from sklearn_mcmd.planes._consistent_set import draw_trials

FORM = {"n_neighbors": 30, "max_outlier_rate": 0.1, "random_state": 0}


def beams(n, rng, azimuth=(-0.9, 0.9), elevation=(-0.5, 0.35)):
    azimuth, elevation = rng.uniform(*azimuth, n), rng.uniform(*elevation, n)
    level = np.cos(azimuth), np.sin(azimuth)
    return np.column_stack([*np.cos(elevation) * level, np.sin(elevation)])


def clump(n, center, spread, rng):
    return center + spread * rng.normal(size=(n, 3))


def snowed_room(rng):
    """Walls and ground of a room, flakes, a ghost, second returns, some of what carries the sensor,
    one beside all, and a few behind walls, which no beam beside them could see."""
    rays = beams(300, rng)
    wall = 5 / np.abs(rays[:, :2]).max(axis=1)
    ranges = np.minimum(wall, 1.5 / np.maximum(-rays[:, 2], 1e-9)) + rng.normal(0, 0.01, 300)
    ranges[:40] *= rng.uniform(0.2, 0.8, 40)
    ranges[290:] *= 1.7
    X = ranges[:, None] * rays
    ghost = clump(12, [2.5, 0.5, 0.3], 0.03, rng)
    own = 0.1 * X[70:74], [[0, 0, 0]]
    return np.vstack([X, X[50:90:10] / 2, X[30:36], ghost, *own, [[0, 4, 1]]]), np.zeros(3)


def ball_before_a_wall(rng):
    """Seen while moving: a ball and a ghost in front of a wall, and one behind it."""
    y, z = rng.uniform(-2, 2, (2, 240))
    wall = np.column_stack([np.full(240, 6.0), y, z]) + rng.normal(0, 0.01, (240, 3))
    parts = ((60, [4, 0.3, 0.2], 0.25), (12, [9, -0.8, 0.3], 0.04), (12, [3, 0.8, -0.5], 0.04))
    X = np.vstack([wall, *(clump(*part, rng) for part in parts)])
    return X, 0.4 * rng.normal(size=X.shape)


AXIS = np.array([np.cos(0.185), np.sin(0.185), 0])  # of the sheet


def sheet_at_an_edge(rng):
    """Mixed pixels between a wall and the one behind it, and four flakes."""
    parts = (60, (0.18, 0.19)), (230, (-0.5, 0.5))
    rays = np.vstack([beams(n, rng, across, (-0.4, 0.4)) for n, across in parts])
    ranges = np.where(rays[:, 1] > np.tan(0.185) * rays[:, 0], 4, 7) / rays[:, 0]
    ranges[:60] = rng.uniform(4.2, 6.8, 60)
    ranges[60:64] = 2.0, 2.5, 3.0, 5.0
    return ranges[:, None] * rays + rng.normal(0, 0.002, rays.shape), -4 * AXIS


def reveal(rng):
    """Mixed pixels between a wall and a window .8 behind it; planes seem to face the sensor."""
    parts = (90, (0.18, 0.19)), (260, (-0.4, 0.6))
    rays = np.vstack([beams(n, rng, across, (-0.4, 0.4)) for n, across in parts])
    depth = np.where(rays[:, 1] > np.tan(0.185) * rays[:, 0], 4, 4.8)
    depth[:90] = rng.uniform(4, 4.8, 90)
    return (depth / rays[:, 0] + rng.normal(0, 0.002, 350))[:, None] * rays, np.zeros(3)


def sheet_far_away(rng):
    """The same seen from so far that no sheet can be told."""
    return sheet_at_an_edge(rng)[0], -200 * AXIS


def grazed_ground(rng):
    """Rough ground, far away as rough as the beams' steps: its ranges scatter, and it goes on."""
    azimuth, down = (side.ravel() for side in np.meshgrid(*np.ogrid[-8:8, 16:42]))
    azimuth, down = np.radians(azimuth / 8), np.radians(down / 8)
    ranges = (1.7 + rng.normal(0, 0.02, 416)) / np.sin(down)
    flat = np.cos(down)
    rays = np.column_stack([flat * np.cos(azimuth), flat * np.sin(azimuth), -np.sin(down)])
    return ranges[:, None] * rays, np.zeros(3)


def rough_sign(rng):
    """A plate before a wall that beams graze at 12 degrees, too rough for ranges to follow it."""
    y, z = (side.ravel() for side in np.meshgrid(*np.ogrid[-0.3:0.3:16j, -0.3:0.3:15j]))
    rays = np.column_stack([np.ones(240), y, z])
    normal = np.array([np.sin(np.radians(12)), np.cos(np.radians(12)), 0])
    depth = 4 * normal[0] / (rays @ normal)
    on_sign = (abs(depth - 4) < 1.5) & (depth * abs(z) < 1.2)
    X = np.where(on_sign, depth, 8)[:, None] * rays
    rough = rng.normal(0, 0.15, 240)[:, None] * normal, rng.normal(0, 0.005, (240, 3))
    return X + np.where(on_sign[:, None], *rough), np.zeros(3)


def test_planes_that_are_too_few_for_a_sheet_are_free_to_be_of_a_surface():
    X, sensor = rough_sign(np.random.default_rng(0))
    flagged = MCMDOutlierDetector(**FORM).fit_predict(X, sensor_origin=sensor) == -1
    assert flagged.sum() <= 1  # all 58 of the sign, if it were of none


SHEETS = sheet_at_an_edge, sheet_far_away, reveal


@pytest.mark.parametrize(
    "cloud", [snowed_room, ball_before_a_wall, *SHEETS, grazed_ground, rough_sign]
)
def test_what_rays_tell_equals_the_literal_oracle(cloud):
    X, sensor = cloud(np.random.default_rng(0))
    fitted = MCMDOutlierDetector(**FORM).fit(X, sensor_origin=sensor)
    trials = draw_trials(fitted.n_trials_, 30, random_state=0)
    scores, on_surface, company = judged(X, 30, trials, 15, sensor=sensor)
    assert_array_equal(fitted.on_surface_, on_surface)
    assert_allclose(fitted.isolation_, company[0], rtol=1e-9)
    assert_allclose(fitted.separation_, company[1], rtol=1e-9)
    assert_allclose(-fitted.scores_, scores["groups"], rtol=1e-9)


@pytest.mark.parametrize(("n_sheets", "doubted"), [(10, False), (11, True)])
def test_a_position_is_doubted_if_more_than_a_tenth_of_all_that_is_flat_is_sheets(
    n_sheets, doubted
):
    """Measurements count, not places: one place of a sheet has all but one of them."""
    on_sheet = np.repeat([True, False], [2, 50])
    evidence = RayEvidence(None, approximate=False, scatter=None, on_sheet=on_sheet, n_jobs=None)
    counts = np.array([n_sheets - 1, 1, *np.repeat(90 / 45, 45), *np.repeat(9, 5)])
    surfaces = np.repeat([False, True, False], [2, 45, 5])
    words = evidence.doubt(surfaces, counts)
    assert bool(words) == doubted
    assert "11 % of all that is flat would be sheets" in words or not doubted


@pytest.mark.parametrize(
    ("cloud", "new"),
    [
        (snowed_room, [[1.8, -0.9, 0], [1.7, 1, 0.25], [4.5, -0.4, 0.5], [4.5, 2.66, 1.4]]),
        (sheet_at_an_edge, [5.7 * AXIS, 5.9 * AXIS + [0, 0, 0.5], [9, 1, 1], [9, -1, 0.5]]),
    ],
)
def test_a_new_point_has_about_the_score_that_it_would_have_in_the_cloud(cloud, new):
    """In free space, before a wall, on a sheet and behind all. By coordinates it has half to
    4 times the score, and next to none on the sheet; with it in the cloud planes vary a little."""
    X, sensor = cloud(np.random.default_rng(0))
    scores = MCMDOutlierDetector(**FORM).fit(X, sensor_origin=sensor).score_samples(new)
    for point, score in zip(new, scores, strict=True):
        more = MCMDOutlierDetector(**FORM).fit(np.vstack([X, point]), sensor_origin=sensor)
        assert_allclose(score, more.scores_[-1], rtol=0.22)
