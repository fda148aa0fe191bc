"""Clouds that leave a plane test little to work with: each has a defined, argued answer."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation
from sklearn import config_context
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import FunctionTransformer

from adjustment_clouds import plane_with_outliers, tilted_plane
from sklearn_mcmd.adjustment import BaardaPlaneDetector, FuzzyPlaneDetector
from sklearn_mcmd.adjustment._determinacy import normal_pvalue
from sklearn_mcmd.adjustment._least_squares import adjust_plane

DETECTORS = [
    BaardaPlaneDetector(),
    BaardaPlaneDetector(test="tau"),
    BaardaPlaneDetector(test="t", elimination="all"),
    BaardaPlaneDetector(surface="orthogonal"),
    BaardaPlaneDetector(elimination="all"),
    BaardaPlaneDetector(robust_start=True, random_state=0),
    FuzzyPlaneDetector(),
    FuzzyPlaneDetector(test="tau"),
    FuzzyPlaneDetector(surface="orthogonal", weighting="cut"),
]
parametrized = pytest.mark.parametrize("detector", DETECTORS, ids=lambda d: repr(d).split(".")[-1])


ALONG = np.outer(np.random.default_rng(2).uniform(0, 5, 500), [1.0, 2.0, 0.5])
FEW = np.random.default_rng(0).normal(size=(5000, 3))
COPIES = FEW[np.arange(5000) % 3]
REFUSED = [
    (FEW[:1], None, "n_samples=1 is too few .* 4 distinct points"),
    (FEW[:3], None, "n_samples=3 is too few .* 4 distinct points"),
    (COPIES[:500], None, "has 3 distinct .* n_samples=500"),
    (COPIES, None, "has 3 distinct .* n_samples=5000"),
    (COPIES * 0, None, "has 1 distinct .* n_samples=5000"),
    (FEW[:50], np.arange(50) < 3, "n_samples=50, of which 3 of positive weight, is too few"),
    (ALONG, None, "lie on one line"),
    (ALONG + 5e6, None, "lie on one line"),
    (ALONG * [0, 0, 1] + 4.2, None, r"lie (at one place|on one line)"),
]


@parametrized
@pytest.mark.parametrize(("X", "weights", "words"), REFUSED)
def test_points_that_determine_no_plane_are_refused(detector, X, weights, words):
    with pytest.raises(ValueError, match=words):
        detector.fit(X, weights=weights)


@pytest.mark.parametrize("test", ["tau", "t"])
@pytest.mark.parametrize("elimination", ["single", "all"])
def test_one_point_more_than_parameters_can_t_be_tested_without_sigma(test, elimination):
    X = np.random.default_rng(1).normal(size=(4, 3))
    X[0, 2] += 1e6
    detector = BaardaPlaneDetector(test=test, elimination=elimination, correction="none").fit(X)
    assert (detector.elimination_step_ == 0).all()
    assert (detector.labels_ == 1).all()


@pytest.mark.parametrize("seed", range(8))
def test_half_of_the_points_on_a_line_are_no_robust_start(seed):
    # A trial's third point may lie beside the line, and is then exact by itself.
    X = plane_with_outliers(100, 0)
    X = np.vstack([X, ALONG[:150] * [1, 1, 0] + [0, 0, 1]])
    common = {"sigma0": "auto", "surface": "orthogonal", "random_state": seed}
    with pytest.warns(UserWarning, match="half of the points or more on one line"):
        robust = BaardaPlaneDetector(robust_start=True, **common).fit(X)
    assert_array_equal(robust.labels_, BaardaPlaneDetector(**common).fit(X).labels_)


@pytest.mark.filterwarnings("ignore:The points lie along a plane tilted by")
def test_removing_all_at_once_never_leaves_a_line():
    X = np.vstack([ALONG[:200] * [1, 1, 0], [[3.0, 0, 40], [0, 5, -40], [5, 0, 40]]])
    detector = BaardaPlaneDetector(sigma0=0.01, elimination="all")
    with pytest.warns(UserWarning, match="points on a line"):
        detector.fit(X)
    assert detector.rank_ == 3


@pytest.mark.parametrize("n", [6, 50, 500])
def test_the_width_test_calls_a_rod_a_plane_as_often_as_alpha_says(n):
    p = []
    for seed in range(400):
        rng = np.random.default_rng(seed)
        X = rng.normal(size=(n, 3)) * [100, 1, 1] @ Rotation.random(None, rng).as_matrix()
        p.append(normal_pvalue(adjust_plane(X, surface="orthogonal")))
    for alpha in (0.05, 0.2, 0.5):
        # Four standard deviations of a share of 400.
        assert abs(np.mean(np.array(p) < alpha) - alpha) < 4 * np.sqrt(alpha * (1 - alpha) / 400)


@pytest.mark.parametrize("detector", [BaardaPlaneDetector, FuzzyPlaneDetector])
def test_the_normal_of_a_rod_is_warned_of(detector):
    X = ALONG + np.random.default_rng(1).normal(scale=0.01, size=(500, 3))
    with pytest.warns(UserWarning, match="as thick as they are wide"):
        detector(sigma0=0.01, surface="orthogonal").fit(X)


@parametrized
def test_weight_zero_equals_absence(detector):
    X = plane_with_outliers(120, 12, 12.0)
    p = np.random.default_rng(4).choice([0.0, 0.5, 2.0], 120)
    detector.fit(X, weights=p)
    decision, labels = detector.decision_function(X), detector.labels_
    detector.fit(X[p > 0], weights=p[p > 0])
    # A start draws other subsets of other row numbers, so only the verdicts can agree there.
    assert_array_equal(labels[p > 0], detector.labels_)
    assert_allclose(decision, detector.decision_function(X), rtol=1e-7, atol=1e-9)


@pytest.mark.parametrize("kind", [BaardaPlaneDetector, FuzzyPlaneDetector])
def test_a_pipeline_hands_requested_weights_to_the_detector(kind):
    X, weights = plane_with_outliers(200, 8, 12.0), np.where(np.arange(200) < 4, 0.01, 1.0)
    expected = kind().fit(X, weights=weights).labels_
    assert (expected != kind().fit(X).labels_).any()
    with config_context(enable_metadata_routing=True):
        test = kind().set_fit_request(weights=True)
        pipeline = make_pipeline(FunctionTransformer(), test)
        assert_array_equal(pipeline.fit(X, weights=weights)[-1].labels_, expected)
        assert_array_equal(pipeline.fit_predict(X, weights=weights), expected)


@pytest.mark.filterwarnings("ignore:The points that pass are as thick as they are wide")
@pytest.mark.filterwarnings("ignore:The tests reject 300 of 300 points")  # fuzzy has one plane
@parametrized
def test_one_outlier_of_a_million_sigma_is_found_and_spoils_nothing(detector):
    X = plane_with_outliers(300, 1, 1e6)
    detector.fit(X)
    assert detector.labels_[0] == -1
    if isinstance(detector, BaardaPlaneDetector) and detector.elimination == "single":
        assert (detector.labels_ == -1).sum() == 1
        # Noise is along z; its part along the normal is smaller.
        share = 1.0 if detector.surface == "vertical" else detector.normal_[2] ** 2
        assert 0.8 * share < detector.variance_factor_ < 1.2 * share


def test_an_uncontrolled_point_is_never_flagged():
    # The only point off the line x = 0 decides the slope alone: its residual is always 0.
    rng = np.random.default_rng(5)
    X = np.column_stack([np.zeros(30), rng.normal(size=30)])
    X[0] = [10, 1e6]
    detector = BaardaPlaneDetector().fit(X)
    assert detector.test_statistic_[0] == 0
    assert detector.labels_[0] == 1
    assert_allclose(detector.redundancy_[0], 0, atol=1e-12)


def test_ties_are_removed_in_the_order_of_rows():
    # Two outliers, mirror images of each other in a symmetric grid.
    x = np.arange(-10.0, 11)
    z = np.zeros(21)
    z[[2, 18]] = 50
    detector = BaardaPlaneDetector().fit(np.column_stack([x, z]))
    assert_array_equal(detector.elimination_step_[[2, 18]], [1, 2])


# sigma0="auto" hides the rejected points, but at 90 degrees the vertical plane misses the wall.
@pytest.mark.parametrize(("tilt", "sigma0"), [(80, 0.005), (90, 0.005), (90, "auto"), (90, 1.0)])
@pytest.mark.parametrize("detector", [BaardaPlaneDetector, FuzzyPlaneDetector])
def test_vertical_residuals_of_a_wall_are_warned_of(detector, tilt, sigma0):
    with pytest.warns(UserWarning, match=f"tilted by {tilt} degrees.*surface='orthogonal'"):
        detector(sigma0=sigma0).fit(tilted_plane(tilt, 0.005))
