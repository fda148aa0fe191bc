"""Clouds that leave a plane test little to work with: each has a defined, argued answer."""

import warnings

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from adjustment_clouds import plane_with_outliers
from sklearn_mcmd.adjustment import BaardaPlaneDetector, FuzzyPlaneDetector

DETECTORS = [
    BaardaPlaneDetector(),
    BaardaPlaneDetector(test="tau"),
    BaardaPlaneDetector(test="t", elimination="all"),
    BaardaPlaneDetector(surface="orthogonal"),
    BaardaPlaneDetector(estimator="huber", elimination="all"),
    BaardaPlaneDetector(robust_start=True, random_state=0),
    FuzzyPlaneDetector(),
    FuzzyPlaneDetector(test="tau"),
    FuzzyPlaneDetector(surface="orthogonal", weighting="cut"),
    FuzzyPlaneDetector(estimator="tukey"),
]
parametrized = pytest.mark.parametrize("detector", DETECTORS, ids=lambda d: repr(d).split(".")[-1])


@parametrized
@pytest.mark.parametrize("n", [1, 2, 3])
def test_no_more_points_than_parameters_are_all_inliers_with_a_warning(detector, n):
    X = np.random.default_rng(0).normal(size=(n, 3))
    with pytest.warns(UserWarning, match="without redundancy"):
        detector.fit(X)
    assert (detector.labels_ == 1).all()
    assert (detector.predict(X) == 1).all()
    assert detector.variance_factor_ == 0
    assert np.isnan(detector.global_test_pvalue_)


@pytest.mark.parametrize("test", ["tau", "t"])
@pytest.mark.parametrize("elimination", ["single", "all"])
def test_one_point_more_than_parameters_can_t_be_tested_without_sigma(test, elimination):
    X = np.random.default_rng(1).normal(size=(4, 3))
    X[0, 2] += 1e6
    detector = BaardaPlaneDetector(test=test, elimination=elimination, correction="none").fit(X)
    assert (detector.elimination_step_ == 0).all()
    assert (detector.labels_ == 1).all()


def exact_plane(n=50, seed=0):
    xy = np.random.default_rng(seed).uniform(0, 10, (n, 2))
    return np.column_stack([xy, xy @ [0.1, 0.3] + 7])


@parametrized
def test_an_exact_plane_has_no_outlier(detector):
    detector.fit(exact_plane())
    assert (detector.labels_ == 1).all()
    assert_allclose(detector.variance_factor_, 0, atol=1e-25)


@pytest.mark.parametrize(
    "detector",
    [
        BaardaPlaneDetector(),
        BaardaPlaneDetector(test="tau"),
        BaardaPlaneDetector(test="t"),
        BaardaPlaneDetector(sigma0="auto"),
        BaardaPlaneDetector(surface="orthogonal"),
        BaardaPlaneDetector(robust_start=True, sigma0="auto", random_state=0),
        FuzzyPlaneDetector(),
        FuzzyPlaneDetector(test="tau"),
        FuzzyPlaneDetector(test="t"),
        FuzzyPlaneDetector(estimator="tukey", sigma0="auto"),
    ],
)
def test_the_one_point_off_an_exact_plane_is_found(detector):
    X = exact_plane()
    X[17, 2] += 10
    assert_array_equal(np.flatnonzero(detector.fit_predict(X) == -1), [17])


@parametrized
def test_collinear_regressors_are_tested_like_a_line(detector):
    rng = np.random.default_rng(2)
    x = rng.uniform(0, 10, 100)
    X = np.column_stack([x, 2 * x + 1, 0.5 * x + rng.normal(scale=0.1, size=100)])
    X[5, 2] += 30
    detector.fit(X)
    assert detector.rank_ == (3 if detector.surface == "orthogonal" else 2)
    if detector.surface == "vertical":
        assert detector.labels_[5] == -1
        assert (detector.labels_ == -1).sum() == 1


@parametrized
def test_points_of_one_location_are_tested_against_their_mean(detector):
    if detector.surface == "orthogonal":
        pytest.skip("points above each other are an upright line, which lies in a plane")
    z = np.random.default_rng(3).normal(scale=0.1, size=60)
    z[5] += 30
    X = np.column_stack([np.full((60, 2), 4.2), z])
    assert_array_equal(np.flatnonzero(detector.fit(X).labels_ == -1), [5])
    assert detector.rank_ == 1


@parametrized
def test_a_constant_column_changes_nothing(detector):
    if detector.surface == "orthogonal":
        pytest.skip("a constant column is the normal of an exact plane")
    X = plane_with_outliers(100, 1, 30.0)
    expected = detector.fit(X[:, [0, 2]]).labels_
    labels = detector.fit(np.column_stack([X[:, 0], np.full(100, 0.3), X[:, 2]])).labels_
    assert_array_equal(labels, expected)


@parametrized
def test_coordinates_of_ten_million_change_no_label(detector):
    X = np.round(plane_with_outliers(200, 3, 15.0), 6)
    near = detector.fit(X).labels_
    far = detector.fit(X + np.array([1e7, -1e7, 1e4])).labels_
    assert (near[:3] == -1).all()
    assert_array_equal(far, near)


@parametrized
def test_weight_zero_equals_absence(detector):
    X = plane_with_outliers(120, 12, 12.0)
    p = np.random.default_rng(4).choice([0.0, 0.5, 2.0], 120)
    detector.fit(X, sample_weight=p)
    decision, labels = detector.decision_function(X), detector.labels_
    detector.fit(X[p > 0], sample_weight=p[p > 0])
    # A start draws other subsets of other row numbers, so only the verdicts can agree there.
    assert_array_equal(labels[p > 0], detector.labels_)
    assert_allclose(decision, detector.decision_function(X), rtol=1e-7, atol=1e-9)


@parametrized
def test_a_point_of_weight_zero_is_never_an_outlier(detector):
    X = plane_with_outliers(60, 1, 1000.0)
    p = np.ones(60)
    p[0] = 0
    assert detector.fit_predict(X, sample_weight=p)[0] == 1


@parametrized
def test_a_point_of_huge_weight_carries_the_plane_and_isn_t_flagged(detector):
    X = plane_with_outliers(60, 0)
    p = np.ones(60)
    p[7] = 1e12
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the plane may be bad, and the others rejected
        detector.fit(X, sample_weight=p)
    assert np.isfinite(detector.test_statistic_).all()
    assert detector.labels_[7] == 1
    if detector.support_[7]:
        assert abs(X[7] @ detector.normal_ - detector.distance_) < 1e-4


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


@parametrized
def test_integers_and_single_precision_are_accepted(detector):
    X = np.round(plane_with_outliers(100, 2, 40.0)).astype(int)
    assert_array_equal(detector.fit(X).labels_, detector.fit(X.astype(np.float32)).labels_)


@parametrized
def test_nan_is_refused(detector):
    with pytest.raises(ValueError, match="NaN"):
        detector.fit(np.array([[0.0, np.nan], [1, 2], [3, 4]]))


def test_one_column_is_refused():
    with pytest.raises(ValueError, match="minimum of 2"):
        BaardaPlaneDetector().fit(np.arange(5.0)[:, None])


def test_ties_are_removed_in_the_order_of_rows():
    # Two outliers, mirror images of each other in a symmetric grid.
    x = np.arange(-10.0, 11)
    z = np.zeros(21)
    z[[2, 18]] = 50
    detector = BaardaPlaneDetector().fit(np.column_stack([x, z]))
    assert_array_equal(detector.elimination_step_[[2, 18]], [1, 2])


def wall(tilt, noise=0.005):
    """A sheet of 8 by 3, tilted about its long side, with equal noise in all directions."""
    rng = np.random.default_rng(0)
    across = rng.uniform(0, 3, 2000)
    angle = np.radians(tilt)
    X = [rng.uniform(0, 8, 2000), across * np.cos(angle), across * np.sin(angle)]
    return np.column_stack(X) + rng.normal(0, noise, (2000, 3))


# sigma0="auto" hides the rejected points, but at 90 degrees the vertical plane misses the wall.
@pytest.mark.parametrize(("tilt", "sigma0"), [(80, 0.005), (90, 0.005), (90, "auto"), (90, 1.0)])
@pytest.mark.parametrize("detector", [BaardaPlaneDetector, FuzzyPlaneDetector])
def test_vertical_residuals_of_a_wall_are_warned_of(detector, tilt, sigma0):
    with pytest.warns(UserWarning, match=f"tilted by {tilt} degrees.*surface='orthogonal'"):
        detector(sigma0=sigma0).fit(wall(tilt))


@pytest.mark.parametrize("detector", [BaardaPlaneDetector, FuzzyPlaneDetector])
@pytest.mark.parametrize(("tilt", "surface"), [(30, "vertical"), (90, "orthogonal")])
def test_planes_on_which_the_surface_is_right_give_no_warning(detector, tilt, surface):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        detector(sigma0=0.005, surface=surface).fit(wall(tilt))


def test_noise_of_other_units_than_the_regressors_is_no_wall():
    rng = np.random.default_rng(0)
    X = np.column_stack([rng.uniform(0, 1, (500, 2)), rng.normal(0, 100, 500)])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        BaardaPlaneDetector(sigma0=100.0).fit(X)


@pytest.mark.parametrize("detector", [BaardaPlaneDetector, FuzzyPlaneDetector])
def test_a_sigma0_whose_square_underflows_rejects_what_is_off_the_plane(detector):
    X = wall(0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        fitted = detector(sigma0=1e-300).fit(X)
    assert fitted.global_test_pvalue_ == 0
    assert np.mean(fitted.labels_ == -1) > 0.9


@pytest.mark.parametrize("detector", [BaardaPlaneDetector, FuzzyPlaneDetector])
def test_a_number_as_sample_weight_is_refused_by_name(detector):
    with pytest.raises(ValueError, match="sample_weight has shape \\(\\)"):
        detector().fit(wall(0), sample_weight=2.0)


@pytest.mark.parametrize("surface", ["vertical", "orthogonal"])
def test_residuals_are_observed_minus_adjusted(surface):
    X = wall(30)
    fitted = BaardaPlaneDetector(sigma0=0.005, surface=surface).fit(X)
    direction = fitted.normal_ / (fitted.normal_[-1] if surface == "vertical" else 1)
    expected = (X - X.mean(axis=0)) @ direction
    residuals = fitted.residuals(X)
    np.testing.assert_allclose(residuals - residuals.mean(), expected - expected.mean(), atol=1e-12)
