"""How much light came back: ranks, what is refused, and how it reaches the judged cloud."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.stats import rankdata

from outliers.test_ray_evidence import FORM, sheet_at_an_edge
from sklearn_mcmd import MCMDOutlierDetector

X = np.random.default_rng(0).random((80, 3)) + np.repeat([[0.0], [4.0]], [76, 4], axis=0)
LIGHT = np.random.default_rng(1).integers(-20, 20, 80)  # with ties
LIGHT[76:] = -20, -19, -20, -18  # what is isolated is dark
X[76:] *= [[1], [2], [4], [8]]


def detector(**parameters):
    return MCMDOutlierDetector(20, max_outlier_rate=0.2, random_state=0, **parameters)


def scores(light=None, points=X):
    return detector().fit(points, intensity=light).scores_


@pytest.mark.parametrize("scale", [lambda v: 1e-9 * v, lambda v: np.exp(v) + 7, np.float32])
def test_neither_unit_nor_scale_matters(scale):
    assert_array_equal(scores(scale(LIGHT)), scores(LIGHT))


def test_copies_have_the_largest_in_any_order_of_rows():
    rng = np.random.default_rng(2)
    copies, light = np.vstack([X, X[:30]]), np.r_[LIGHT, rng.integers(-20, 20, 30)]
    largest = np.r_[np.maximum(LIGHT[:30], light[80:]), LIGHT[30:]]
    expected = scores(np.r_[largest, largest[:30]], copies)
    assert (expected != scores(None, copies)).mean() > 0.5
    for order in (np.arange(110), rng.permutation(110)):
        assert_allclose(scores(light[order], copies[order]), expected[order], rtol=1e-9)


def test_what_is_the_same_everywhere_says_nothing():
    assert_array_equal(scores(np.full(80, 7)), scores())


@pytest.mark.parametrize(
    ("intensity", "message"),
    [
        (LIGHT[:79], r"intensity must have the shape \(80,\) of the points; got \(79,\)"),
        (LIGHT[:, None], r"intensity must have .* got \(80, 1\)"),
        (np.where(LIGHT > 0, np.nan, 1.0), "intensity contains NaN"),
        (np.where(LIGHT > 0, np.inf, 1.0), "intensity contains infinity"),
        (["bright"] * 80, "could not convert string to float"),
    ],
)
def test_errors_name_the_parameter(intensity, message):
    for call in (detector().fit, detector().fit_predict):
        with pytest.raises(ValueError, match=message):
            call(X, intensity=intensity)


@pytest.mark.parametrize(
    ("parameters", "lacks"),
    [
        ({"strictness": None}, "a strictness other than the paper's"),
        ({"n_neighbors": None}, "n_neighbors"),
    ],
)
@pytest.mark.parametrize("told", [{"intensity": LIGHT}, {"sensor_origin": [0, 0, 9]}])
def test_one_plane_has_no_use_for_it(parameters, lacks, told):
    (name,) = told
    with pytest.raises(ValueError, match=rf"^{name} has .* give {lacks}, or leave {name} out\.$"):
        detector().set_params(**parameters).fit(X, **told)


def test_doubts_grow_in_the_dark_and_surfaces_stay():
    """Of two clouds of flakes before a wall, the darker one is the more isolated."""
    rng = np.random.default_rng(0)
    wall = rng.uniform(0, 4, (3000, 3)) * [1, 0, 1] + rng.normal(0, 0.003, (3000, 3))
    cloud = np.vstack([wall, rng.uniform([0, -2, 0], [4, -0.5, 4], (200, 3))])
    light = np.r_[rng.uniform(5, 20, 3000), np.zeros(150), np.full(50, 30.0)]
    plain, lit = detector().fit(cloud), detector().fit(cloud, intensity=light)
    off_surface = ~plain.on_surface_
    assert_array_equal(lit.scores_[~off_surface], plain.scores_[~off_surface])
    brighter = 1 - (rankdata(light) - 0.5) / len(light)
    telling = 2 * brighter[plain.isolation_ > 3].mean() - 1
    assert 0.3 < telling < 0.6
    assert_allclose(lit.isolation_, plain.isolation_ * (2 * brighter) ** (telling / 2))
    assert (lit.isolation_[3000:3150] > plain.isolation_[3000:3150]).all()
    assert (lit.isolation_[3150:] < 0.6 * plain.isolation_[3150:]).all()
    assert_array_equal(lit.separation_, plain.separation_)


@pytest.mark.parametrize(("flakes", "factor"), [(0.0, 1.4), (12.0, 1.0), (30.0, 1.0)])
def test_intensity_tells_only_where_what_is_isolated_is_darker_than_the_rest(flakes, factor):
    """Flakes as bright as the wall, or brighter, are as isolated as without intensity."""
    rng = np.random.default_rng(1)
    wall = rng.uniform(0, 4, (3000, 3)) * [1, 0, 1] + rng.normal(0, 0.003, (3000, 3))
    cloud = np.vstack([wall, rng.uniform([0, -2, 0], [4, -0.5, 4], (200, 3))])
    light = np.r_[rng.uniform(5, 19, 3000), flakes + rng.normal(0, 0.1, 200)]
    isolation = detector().fit(cloud, intensity=light).isolation_[3000:]
    assert_allclose(isolation, factor * detector().fit(cloud).isolation_[3000:], rtol=0.1)


def test_bright_mixed_pixels_stay_on_their_sheets():
    """However much light came back, a sheet of rays is an error, with the score of its scatter."""
    cloud, sensor = sheet_at_an_edge(np.random.default_rng(0))
    light = np.r_[np.linspace(8, 9, 60), np.linspace(0, 1, len(cloud) - 60)]
    plain = MCMDOutlierDetector(**FORM).fit(cloud, sensor_origin=sensor)
    lit = MCMDOutlierDetector(**FORM).fit(cloud, sensor_origin=sensor, intensity=light)
    sheets = plain._cloud.off_surface.rows[plain._cloud.beside_rays.by_sheet]
    assert len(sheets) > 30
    assert_array_equal(lit._cloud.point_scores[sheets], plain._cloud.point_scores[sheets])


@pytest.mark.parametrize("position", [None, "origin"])
def test_new_points_have_the_light_of_the_nearest_fitted_one(position):
    rng = np.random.default_rng(0)
    wall = np.column_stack([rng.uniform(-1, 1, (900, 2)), 5 + rng.normal(0, 0.005, 900)])
    cloud = np.vstack([wall, rng.uniform([-1, -1, 2], [1, 1, 4], (40, 3))])
    light = np.r_[rng.random(900), np.tile([0.01, 2.0], 20)]
    form = MCMDOutlierDetector(30, random_state=0)
    fitted = form.fit(cloud, sensor_origin=position, intensity=light)
    moved = fitted.score_samples(cloud[900:] + 1e-9)
    assert_allclose(moved, fitted.scores_[900:], rtol=0.3)
