"""The report says what the detector found."""

import numpy as np
import pytest
from scipy import stats

from adjustment_clouds import plane_with_outliers
from sklearn_mcmd.adjustment import (
    BaardaPlaneDetector,
    FuzzyPlaneDetector,
    compare_planes,
    flatness,
    plot_report,
    text_report,
)
from sklearn_mcmd.adjustment._report import normal_row

DETECTORS = [
    BaardaPlaneDetector(),
    BaardaPlaneDetector(surface="orthogonal", sigma0="auto", elimination="all"),
    FuzzyPlaneDetector(),
    FuzzyPlaneDetector(1e-9, surface="orthogonal"),
]


@pytest.mark.parametrize("detector", DETECTORS)
def test_the_text_has_the_figures_of_the_fit(detector):
    X = plane_with_outliers(200, 10, 12.0)
    text = text_report(detector.fit(X), X, unit="m", title="Wall 7", n_worst=3)
    n_outliers = (detector.labels_ == -1).sum()
    assert text.startswith("Wall 7\n======\n")
    assert f"{n_outliers} of 200" in text
    assert f"{detector.critical_value_:.4f}" in text
    assert f"{detector.variance_factor_:.6g}" in text
    elimination = getattr(detector, "elimination", None)
    assert ("one at a time" in text) == (elimination == "single")
    assert ("all rejected at once" in text) == (elimination == "all")
    worst = int(np.argmax(detector.test_statistic_))
    assert text.splitlines()[-3].split()[0] == str(worst)


def test_the_count_of_returned_points_is_reported():
    X = plane_with_outliers(500, 100, 60.0, sigma=0.1)
    detector = BaardaPlaneDetector(0.15, correction="none", elimination="all").fit(X)
    removed = np.count_nonzero(detector.elimination_step_)
    assert f"{removed} in" in text_report(detector, X)
    assert f"{removed - 100} came back" in text_report(detector, X)


def test_less_than_no_worst_points_are_refused():
    X = plane_with_outliers(50, 2, 12.0)
    detector = BaardaPlaneDetector().fit(X)
    for ask in (
        lambda n: text_report(detector, X, n_worst=n),
        lambda n: detector.reliability(X, n_worst=n),
    ):
        with pytest.raises(ValueError, match="'n_worst' parameter"):
            ask(-1)
        ask(0)


def test_other_points_than_the_fitted_are_refused():
    X = plane_with_outliers(50, 2, 12.0)
    detector = FuzzyPlaneDetector().fit(X)
    with pytest.raises(ValueError, match="pass the training points"):
        text_report(detector, X[:-1])


@pytest.mark.parametrize(
    ("detector", "columns"),
    [(one, columns) for one, columns in zip(DETECTORS, [[0, 1, 2], [0, 2]] * 2, strict=True)],
)
def test_the_figure_has_three_panels_and_can_be_saved(detector, columns, tmp_path):
    pytest.importorskip("matplotlib")
    X = plane_with_outliers(200, 10, 12.0)[:, columns]
    figure = plot_report(detector.fit(X), X, unit="m")
    figure.savefig(tmp_path / "report.png")
    assert (tmp_path / "report.png").stat().st_size > 10_000
    titles = {axes.get_title() for axes in figure.axes}
    assert {"Residual map", "Residuals"} < titles
    (residual_map,) = [axes for axes in figure.axes if axes.get_title() == "Residual map"]
    assert residual_map.get_xlabel().endswith("[m]")
    assert residual_map.get_ylabel().endswith("[m]")
    last = "Memberships" if isinstance(detector, FuzzyPlaneDetector) else "Test statistics"
    assert last in titles


def panel(figure, title):
    return next(axes for axes in figure.axes if axes.get_title() == title)


@pytest.mark.parametrize("test", ["w", "tau", "t"])
def test_the_curves_are_those_of_the_normal_and_of_the_test(test):
    pytest.importorskip("matplotlib")
    X = 0.01 * plane_with_outliers(200, 10, 40.0)
    sigma0 = 0.01 if test == "w" else "auto"
    detector = BaardaPlaneDetector(test=test, sigma0=sigma0).fit(X)
    figure = plot_report(detector, X)
    histogram, statistics = panel(figure, "Residuals"), panel(figure, "Test statistics")
    residuals, good = detector.residuals(X), detector.labels_ == 1
    scale = residuals[good].std()
    (curve,) = histogram.lines
    bars = [patch for patch in histogram.patches if patch.get_height() > 0]
    width = bars[0].get_width()
    x, y = curve.get_data()
    np.testing.assert_allclose(y, good.sum() * width * stats.norm.pdf(x, scale=scale), rtol=1e-9)
    assert sum(bar.get_height() for bar in bars) == len(X)
    assert ("beyond" in histogram.get_xlabel()) == (np.abs(residuals).max() > 15 * scale)
    rank, expected = statistics.lines[0].get_data()
    level = 1 - (rank - 0.5) / good.sum()
    quantile = stats.norm.isf(level / 2)
    if test != "w":
        quantile = stats.t.isf(level / 2, detector.dof_ - 1)
    if test == "tau":
        quantile *= np.sqrt(detector.dof_ / (detector.dof_ - 1 + quantile**2))
    np.testing.assert_allclose(expected, quantile, rtol=1e-9)


def test_columns_beyond_space_have_numbers_in_the_map():
    pytest.importorskip("matplotlib")
    X = np.random.default_rng(0).normal(size=(50, 4))
    residual_map = panel(plot_report(BaardaPlaneDetector().fit(X), X), "Residual map")
    assert (residual_map.get_xlabel(), residual_map.get_ylabel()) == ("column 0", "column 1")


def exact_plane(offset):
    xy = np.random.default_rng(0).uniform(0, 10, (50, 2)) + offset
    return np.column_stack([xy, xy @ [0.1, 0.3] + 7])


@pytest.mark.filterwarnings("ignore:The points that pass are as thick as they are wide")
@pytest.mark.parametrize("detector", DETECTORS)
def test_a_point_more_than_three_has_a_report_too(detector, tmp_path):
    pytest.importorskip("matplotlib")
    X = plane_with_outliers(4, 0)
    assert "outliers" in text_report(detector.fit(X), X)
    plot_report(detector, X).savefig(tmp_path / "report.png")


@pytest.mark.parametrize("offset", [0.0, 5e6])
def test_the_report_of_an_exact_plane_says_that_there_is_no_noise(offset, tmp_path):
    X = exact_plane(offset)
    detector = BaardaPlaneDetector(sigma0="auto").fit(X)
    text = text_report(detector, X, unit="m")
    assert f"{detector.sigma0_:.6g} m (float64's rounding: " in text
    assert "no noise to test against" in text
    pytest.importorskip("matplotlib")
    plot_report(detector, X).savefig(tmp_path / "report.png")


@pytest.mark.parametrize("surface", ["vertical", "orthogonal"])
@pytest.mark.parametrize("scale", [[1, 1, 1], [1e17, 1e17, 0]])  # of the last, the error is 0
def test_an_exact_plane_has_no_standard_error(surface, scale):
    x, y = np.random.default_rng(0).integers(0, 50, (2, 40))
    X = np.column_stack([x, y, 2 * x + 3 * y + 1]) * np.array(scale, float)
    text = text_report(BaardaPlaneDetector(sigma0="auto", surface=surface).fit(X), X)
    told = [line.split("±")[1].strip() for line in text.splitlines() if "±" in line]
    assert set(told) == {"less than 1e-9"}
    assert f"tilt from horizontal  {'74.498640' if scale[2] else '0.000000'} degrees" in text


def test_the_report_of_a_plane_with_noise_says_nothing_of_rounding():
    X = plane_with_outliers(200, 0)
    text = text_report(BaardaPlaneDetector(sigma0="auto").fit(X), X)
    assert "(estimated)" in text
    assert "rounding" not in text


def test_the_plane_is_given_by_a_point_and_digits_by_the_standard_error():
    X = plane_with_outliers(400, 0, sigma=0.004) + np.array([362_000, 5_157_000, 100])
    detector = BaardaPlaneDetector(sigma0="auto").fit(X)
    text = text_report(detector, X, unit="m")
    point, error = text.split("point of the plane")[1].splitlines()[0].split("±")
    assert error.split() == ["0.0002", "m"]  # 4 mm by the root of 400
    assert {len(value.split(".")[1]) for value in point.split()} == {4}
    assert abs(detector.residuals([[float(value) for value in point.split()]])[0]) < 1e-4
    assert f"{detector.variance_factor_:.6g} m^2 without outliers" in text
    assert "A residual is positive above the plane." in text
    assert "distance from origin" not in text


@pytest.mark.parametrize("surface", ["vertical", "orthogonal"])
def test_the_error_of_the_normal_is_its_scatter_among_planes(surface):
    slopes, told = [], []
    for seed in range(60):
        X = plane_with_outliers(50, 0, sigma=0.01, seed=seed) * [1, 0.2, 0.02]  # widest along x
        detector = BaardaPlaneDetector(sigma0="auto", surface=surface).fit(X)
        slopes.append(detector.normal_[1])
        told.append(float(normal_row(detector).split("±")[1]))
    # 60 normals tell their deviation to 9 %; what is printed has one digit.
    assert abs(np.log(np.median(told) / np.std(slopes))) < 0.5


@pytest.mark.parametrize("detector", [BaardaPlaneDetector, FuzzyPlaneDetector])
def test_the_report_tells_the_global_test_or_why_there_is_none(detector):
    X = plane_with_outliers(400, 5, 12.0)
    given = detector(sigma0=0.5).fit(X)
    before, after = given.global_test_pvalue_initial_, given.global_test_pvalue_
    words = f"p = {before:.2g} with all points, {after:.2g} without outliers; rejected"
    assert before < after < 0.05
    assert words in text_report(given, X)
    text = text_report(detector(sigma0="auto").fit(X), X)
    assert "global test           none: sigma0 is estimated from these points" in text


def test_standard_errors_and_reliability_are_those_of_the_detector():
    X = plane_with_outliers(200, 10, 12.0)
    detector = BaardaPlaneDetector().fit(X)
    text = text_report(detector, X, unit="m")
    precision, told = detector.precision(), detector.reliability(X)
    assert f"cone {precision.cone:.2g} degrees" in text
    assert f"noncentrality {told.noncentrality:.2f}" in text
    assert f"{told.minimal_bias.min():.4g} to {told.minimal_bias.max():.4g} m (MDB)" in text
    worst = int(np.argmax(detector.test_statistic_))
    row = next(line for line in text.splitlines() if line.split()[:1] == [str(worst)])
    assert float(row.split()[4]) == pytest.approx(told.minimal_bias[worst], rel=1e-2)
    assert float(row.split()[5]) == pytest.approx(told.gross_error[worst], rel=1e-2)


@pytest.mark.parametrize(
    "detector",
    [BaardaPlaneDetector(loss="huber"), BaardaPlaneDetector(0.9, correction="none")],
)
def test_where_there_is_no_reliability_the_report_does_without(detector):
    X = plane_with_outliers(200, 10, 12.0)
    text = text_report(detector.fit(X), X)
    assert "Standard errors" in text
    assert "Reliability" not in text


def test_exact_points_have_the_standard_errors_of_a_given_sigma0():
    x, y = np.random.default_rng(0).integers(0, 50, (2, 40)).astype(float)
    X = np.column_stack([x, y, 2 * x + 3 * y + 1])
    detector = BaardaPlaneDetector(sigma0=0.01).fit(X)
    text = text_report(detector, X)
    assert "a posteriori          the points have no noise; these are a priori" in text
    assert f"cone {detector.precision('prior').cone:.2g} degrees" in text


def test_flatness_and_comparison_are_told_if_given():
    X = plane_with_outliers(200, 10, 12.0)
    detector, other = (BaardaPlaneDetector().fit(X + np.array([0, 0, dz])) for dz in (0, 3))
    text = text_report(
        detector, X, flatness=flatness(detector, X, 5.0), comparison=compare_planes(detector, other)
    )
    assert "\ntolerance             5 between two parallel planes\n" in text
    assert "\nverdict               exceeded" in text
    assert "\nverdict               moved\n" in text
