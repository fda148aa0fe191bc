"""Standard errors and bands of planes against dense algebra, simulations and statsmodels."""

import warnings

import numpy as np
import pytest

from adjustment_clouds import slope
from sklearn_mcmd.adjustment import BaardaPlaneDetector
from sklearn_mcmd.adjustment._least_squares import adjust_plane
from sklearn_mcmd.adjustment._precision import precision_of, quantile

OFFSET = np.array([362_000.0, 5_157_000.0, 100.0])


@pytest.mark.parametrize("sigma0", [0.01, "auto"])
def test_covariances_are_those_of_dense_algebra_also_far_from_the_origin(sigma0):
    X, move = slope(), np.eye(4)
    detector = BaardaPlaneDetector(1e-9, sigma0=sigma0)
    near, far = (detector.fit(X + offset).precision() for offset in (0, OFFSET))
    A = np.column_stack([X[:, :2], np.ones(40)])
    Q = np.linalg.inv(A.T @ A)
    a, b, c = h = Q @ A.T @ X[:, 2]
    slopes = Q * np.sum((X[:, 2] - A @ h) ** 2) / 37
    # Derivatives of normal = (-a, -b, 1) / L and distance = c / L.
    length = np.sqrt(a * a + b * b + 1)
    J = -np.outer([-a, -b, 1, c], [a, b, 0]) / length**3
    J[[0, 1, 3], [0, 1, 2]] += np.array([-1, -1, 1]) / length
    move[3, :3] = OFFSET  # the distance grows by the normal times the offset
    normal = J @ slopes @ J.T
    # Rounding of 5e6 to float64 is 1e-9, a 1e-7th of the noise; products of covariances add a few.
    for ours, truth, atol in (
        (near.slopes_covariance, slopes, 1e-11),
        (near.covariance, normal, 1e-11),
        (far.covariance, move @ normal @ move.T, 1e-7),
    ):
        scale = np.sqrt(np.outer(np.diag(truth), np.diag(truth)))
        np.testing.assert_allclose(ours / scale, truth / scale, atol=atol)


def simulated_planes(surface, n, n_planes, normal, noise=0.01, seed=0):
    """True normal and distance, and the precisions and estimates of simulated planes."""
    rng = np.random.default_rng(seed)
    truth = np.array(normal) / np.linalg.norm(normal)
    basis = np.linalg.svd(truth[None])[2][1:]
    for _ in range(n_planes):
        X = rng.uniform(0, 5, (n, 2)) @ basis + [3.0, 1.0, 2.0]
        if surface == "vertical":
            X[:, 2] += rng.normal(0, noise, n)
        else:
            X += rng.normal(0, noise, (n, 3))
        yield truth, float(truth @ [3.0, 1.0, 2.0]), adjust_plane(X, surface=surface)


@pytest.mark.parametrize(
    ("surface", "normal"),
    [("vertical", (-0.3, 0.2, 1)), ("orthogonal", (-0.3, 0.2, 1)), ("orthogonal", (1, 2, 0.01))],
)
@pytest.mark.parametrize(
    "n_planes", [1_000, pytest.param(30_000, marks=pytest.mark.slow)], ids=["1k", "30k"]
)
def test_errors_over_standard_errors_of_simulated_planes_have_variance_one(
    surface, normal, n_planes
):
    ratios = []
    for truth, distance, plane in simulated_planes(surface, 30, n_planes, normal):
        precision = precision_of(plane, 0.01, np.inf)
        side = np.sign(plane.normal @ truth)
        error = np.append(
            side * plane.normal - truth, side * plane.center @ plane.normal - distance
        )
        tilt = np.degrees(np.arctan2(np.hypot(*truth[:2]), abs(truth[2])))
        upward = np.sign(plane.normal[2]) * side * truth  # as the plane, which may lean either way
        azimuth = np.degrees(np.arctan2(*upward[:2])) % 360
        turned = (precision.azimuth - azimuth + 180) % 360 - 180
        ratios.append(
            [
                *(error / np.sqrt(np.diag(precision.covariance))),
                (precision.tilt - tilt) / precision.tilt_error,
                turned / precision.azimuth_error,
            ]
        )
    # A variance of n draws is known to sqrt(2 / n); four of these, and 1 % for the higher orders
    # that standard errors leave out (noise over width, squared).
    variance = np.mean(np.square(ratios), axis=0)
    np.testing.assert_allclose(variance, 1, atol=4 * np.sqrt(2 / n_planes) + 0.01)


@pytest.mark.parametrize("surface", ["vertical", "orthogonal"])
@pytest.mark.parametrize("variance", ["posterior", "prior"])
def test_ellipses_of_95_percent_hold_95_percent_of_the_normals_of_ten_points(surface, variance):
    inside = []
    for truth, _, plane in simulated_planes(surface, 10, 700, (-0.3, 0.2, 1)):
        scale, dof = (0.01, np.inf) if variance == "prior" else (plane.variance_factor**0.5, 7)
        precision = precision_of(plane, scale, dof)
        error = np.degrees(precision.ellipse_axes.T @ (plane.normal - truth))
        radius = np.linalg.norm(error / precision.ellipse)
        inside.append(radius <= precision.confidence_factor(0.95))
    assert 0.925 < np.mean(inside) < 0.975  # 0.95 is known to 0.0082


@pytest.mark.parametrize("width", [1.5, 3.0])
def test_errors_of_a_strip_as_narrow_as_a_few_deviations_hold(width):
    rng, tilts, heights = np.random.default_rng(0), [], []
    for _ in range(250):
        X = rng.uniform(-1, 1, (200, 3)) * [100, width * np.sqrt(3), 0]
        X += rng.normal(size=X.shape)
        detector = BaardaPlaneDetector(1e-9, sigma0=1.0, surface="orthogonal", correction="none")
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message="The points that pass are as thick")
            precision = detector.fit(X).precision("prior")
        normal, rim = detector.normal_, np.array([[0, 1.5 * width, 0]])
        error = np.array([0, 0, np.sign(normal[2])]) - normal
        tilts.append(abs(error @ precision.ellipse_axes[:, 0]) / np.radians(precision.ellipse[0]))
        height = abs((rim[0] - detector._fitted.plane.center) @ normal)
        heights.append(height / detector.band(rim, variance="prior")[0][0])
    assert 0.91 < np.mean(np.array(tilts) < 1.96) < 0.99  # 0.95 is known to 0.014
    assert 0.91 < np.mean(np.array(heights) < 1) < 0.99


@pytest.mark.parametrize("weighted", [False, True])
def test_statsmodels_has_the_same_covariance_and_bands(weighted):
    linear_model = pytest.importorskip("statsmodels.regression.linear_model")
    X = slope()
    weights = np.random.default_rng(1).uniform(0.5, 2, len(X)) if weighted else np.ones(len(X))
    detector = BaardaPlaneDetector(1e-9, sigma0=0.01).fit(X, weights=weights)
    model = linear_model.WLS(X[:, 2], np.column_stack([X[:, :2], np.ones(len(X))]), weights=weights)
    fitted = model.fit()
    np.testing.assert_allclose(
        detector.precision("independent").slopes_covariance, fitted.cov_params(), rtol=1e-9
    )
    places = slope(5, seed=3)
    told = fitted.get_prediction(np.column_stack([places[:, :2], np.ones(5)]))
    of_plane, of_point = detector.band(places, 0.9, "independent")
    for ours, obs in ((of_plane, False), (of_point, True)):
        low, high = told.conf_int(obs=obs, alpha=0.1).T
        np.testing.assert_allclose(ours, (high - low) / 2, rtol=1e-9)


def test_dip_and_its_errors_do_not_depend_on_the_side_of_the_normal():
    X, both = slope(), []
    for height in (100.0, -100.0):
        detector = BaardaPlaneDetector(sigma0=0.01, surface="orthogonal", toward=[0, 0, height])
        told = detector.fit(X).precision()
        assert np.sign(detector.normal_[2]) == np.sign(height)
        both.append([told.tilt, told.tilt_error, told.azimuth, told.azimuth_error, told.cone])
    np.testing.assert_allclose(*both, rtol=1e-9)
    fall = np.degrees(np.arctan2(-0.3, 0.2)) % 360  # that of the normal of `slope`
    assert both[0][2] == pytest.approx(fall, abs=3)


def test_a_horizontal_plane_falls_nowhere_and_may_tilt_to_its_worst_side():
    grid = np.stack(np.meshgrid([0.0, 1, 2], [0.0, 1, 2, 3]), -1).reshape(-1, 2)
    X = np.column_stack([grid, np.zeros(12)])
    precision = BaardaPlaneDetector(sigma0=0.01).fit(X).precision("prior")
    assert precision.tilt == 0
    assert np.isinf(precision.azimuth_error)
    assert precision.tilt_error == precision.ellipse[0]


def test_what_cannot_be_is_refused():
    detector = BaardaPlaneDetector(sigma0="auto").fit(slope())
    with pytest.raises(ValueError, match="variance='prior' needs a known sigma0"):
        detector.precision("prior")
    with pytest.raises(ValueError, match=r"'variance' parameter .* Got 'sure'"):
        detector.precision("sure")
    with pytest.raises(ValueError, match="level=95 is no probability"):
        detector.band(slope(), 95)


def walls(smooth, length=0.4, n_planes=150, n=400, seed=0):
    """Detectors of walls of 4 by 2.5 whose noise of 4 has a part that is alike over a length."""
    rng = np.random.default_rng(seed)
    for _ in range(n_planes // 15):
        xy = rng.uniform(0, 1, (n, 2)) * [4, 2.5]
        gaps = np.linalg.norm(xy[:, None] - xy, axis=2)
        root = np.linalg.cholesky(np.exp(-((gaps / length) ** 2) / 2) + 1e-7 * np.eye(n))
        for noise, alike in rng.normal(size=(15, 2, n)):
            z = 4 * noise + smooth * root @ alike
            yield BaardaPlaneDetector(1e-9, sigma0=4.0).fit(np.column_stack([xy, z]))


@pytest.mark.parametrize(
    ("smooth", "independent", "covered"), [(0, (0.93, 0.97), 0.93), (2.5, (0.4, 0.6), 0.85)]
)
def test_bands_hold_planes_whose_noise_is_alike_nearby(smooth, independent, covered):
    places, inside = slope(40)[:, :2] * [0.8, 0.5], {"independent": [], "posterior": []}
    places = np.column_stack([places, np.zeros(40)])
    for detector in walls(smooth):
        gap = np.abs(detector.residuals(places))
        for variance, found in inside.items():
            found.append(np.mean(gap <= detector.band(places, variance=variance)[0]))
    low, high = independent
    assert low <= np.mean(inside["independent"]) <= high
    assert covered <= np.mean(inside["posterior"]) < 0.98


@pytest.mark.parametrize(("along", "n_strips"), [(0, 10), (1, 14), (1, 44)])
def test_bands_hold_walls_whose_rows_or_columns_have_noise_in_common(along, n_strips):
    inside, size = {"independent": [], "posterior": []}, np.array([4.0, 2.5])
    for seed in range(60):
        rng = np.random.default_rng(seed)
        places = rng.uniform(0, 1, (2000, 2))
        strip = (places[:, along] * n_strips).astype(int)
        z = rng.normal(0, 4, 2000) + rng.normal(size=n_strips)[strip]
        X = np.column_stack([places * size, z])
        detector = BaardaPlaneDetector(1e-9, sigma0=4.0).fit(X)
        middle = np.append(size / 2, 0.0)[None]
        for variance, each in inside.items():
            gap = np.abs(detector.residuals(middle)[0])
            each.append(gap <= detector.band(middle, variance=variance)[0][0])
    assert np.mean(inside["independent"]) < 0.75
    assert np.mean(inside["posterior"]) > 0.85  # of .92, less two standard errors of 60 walls


def test_errors_of_noise_that_is_alike_are_told_by_the_form_and_a_points_own_noise_stays():
    detector = next(walls(2.5))
    told, plain = detector.precision(), detector.precision("independent")
    assert (told.scale, told.dof) == (detector.form_.alike_deviation, detector.form_.alike_dof)
    assert told.alike > 1 == plain.alike
    assert told.alike == pytest.approx(told.scale / plain.scale)
    np.testing.assert_allclose(told.ellipse, told.alike * plain.ellipse)
    X = slope(5)
    of_plane, of_point = detector.band(X)
    own = quantile(0.95, detector.dof_) * plain.scale
    np.testing.assert_allclose(of_point**2 - of_plane**2, own**2)
    assert (detector.precision("prior").scale, detector.precision("prior").alike) == (4.0, 1)
