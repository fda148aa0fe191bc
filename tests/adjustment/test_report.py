"""The text says what the detector found."""

import re

import numpy as np
import pytest
from scipy import stats

from adjustment_clouds import plane_with_outliers
from sklearn_mcmd.adjustment import (
    BaardaPlaneDetector,
    FuzzyPlaneDetector,
    compare_planes,
    flatness,
    text_report,
)

DETECTORS = [
    BaardaPlaneDetector(),
    BaardaPlaneDetector(surface="orthogonal", sigma0="auto", elimination="all"),
    FuzzyPlaneDetector(),
    FuzzyPlaneDetector(1e-9, surface="orthogonal"),
]


def reported(detector, X, **options):
    """The rows of a report by name, and its text."""
    text = text_report(detector, X, **options)
    return {line[:22].strip(): line[22:] for line in text.splitlines()}, text


def numbers(words):
    """The numbers of a row before what is noted behind them."""
    return [float(word) for word in re.findall(r"-?\d+\.\d+", words.partition("(")[0])]


@pytest.mark.parametrize("detector", DETECTORS)
def test_the_text_has_the_figures_of_the_fit(detector):
    X = plane_with_outliers(200, 10, 12.0)
    rows, text = reported(detector.fit(X), X, unit="m", title="Wall 7", n_worst=3)
    n_outliers = (detector.labels_ == -1).sum()
    assert text.startswith("Wall 7\n======\n")
    assert rows["outliers"] == f"{n_outliers} of 200 ({n_outliers / 2:.2f} %)"
    assert float(rows["critical value"]) == pytest.approx(detector.critical_value_, abs=1e-4)
    elimination = getattr(detector, "elimination", None)
    assert ("one at a time" in text) == (elimination == "single")
    assert ("all rejected at once" in text) == (elimination == "all")
    worst = int(np.argmax(detector.test_statistic_))
    assert text.splitlines()[-3].split()[0] == str(worst)
    side = "above the plane" if detector.surface == "vertical" else "on the side of the normal"
    assert rows["residuals"].endswith(f"positive {side}")


@pytest.mark.filterwarnings("ignore:sigma0=1e.300 is")
def test_the_square_of_a_huge_sigma0_is_not_formed():
    X = plane_with_outliers(200, 10, 12.0)
    rows, _ = reported(BaardaPlaneDetector(sigma0=1e300).fit(X), X)
    assert rows["variance ratio"].startswith("0 = v'Pv")


@pytest.mark.parametrize("surface", ["vertical", "orthogonal"])
@pytest.mark.parametrize("scale", [[1, 1, 1], [1e17, 1e17, 0]])  # of the last, the error is 0
@pytest.mark.parametrize("offset", [0, 5_000_000])
def test_an_exact_plane_has_neither_noise_nor_standard_error(surface, scale, offset):
    x, y = np.random.default_rng(0).uniform(0, 50, (2, 40)) + offset
    X = np.column_stack([x, y, 2 * x + 3 * y + 1]) * np.array(scale, float)
    detector = BaardaPlaneDetector(sigma0="auto", surface=surface).fit(X)
    rows, text = reported(detector, X, unit="m")
    words = "float64's rounding: no noise to test against"
    assert rows["sigma0"] == f"{detector.sigma0_:.4g} m ({words})"
    assert "Standard errors" not in text
    if offset == 0:
        errors = [line.split("±")[1].split("1e-9")[0] for line in text.splitlines() if "±" in line]
        assert set(errors) == {" less than "}
    degrees = 74.498640 if scale[2] else 0.0  # arccos(1 / sqrt(14))
    assert float(rows["dip"].split()[0]) == pytest.approx(degrees, abs=1e-6)


@pytest.mark.parametrize("detector", [BaardaPlaneDetector, FuzzyPlaneDetector])
def test_the_report_has_the_global_test_or_why_there_is_none(detector):
    X = plane_with_outliers(400, 5, 12.0)
    given = detector(sigma0=0.5).fit(X)
    before, after = given.global_test_pvalue_initial_, given.global_test_pvalue_
    words = f"p = {before:.2g} with all points, {after:.2g} without outliers; rejected"
    assert before < after < 0.05
    assert reported(given, X)[0]["global test"].startswith(words)
    rows, _ = reported(detector(sigma0="auto").fit(X), X)
    assert rows["global test"].startswith("none: sigma0 is estimated from these points")


def test_standard_errors_and_reliability_are_those_of_the_detector():
    X = plane_with_outliers(200, 10, 12.0)
    detector = BaardaPlaneDetector().fit(X)
    rows, text = reported(detector, X, unit="m")
    precision, found = detector.precision(), detector.reliability(X)
    assert f"cone {precision.cone:.2g} degrees" in rows["normal's ellipse"]
    assert numbers(rows["dip"]) == pytest.approx([precision.tilt, precision.tilt_error], rel=0.05)
    turn = np.radians(precision.ellipse[0])
    assert numbers(rows["normal"]) == pytest.approx([*detector.normal_, turn], rel=0.05)
    assert rows["alpha_0, 1 - beta"].endswith(f"noncentrality {found.noncentrality:.2f}")
    least, most = found.minimal_bias.min(), found.minimal_bias.max()
    assert rows["detectable bias"] == f"{least:.4g} to {most:.4g} m (MDB)"
    worst = int(np.argmax(detector.test_statistic_))
    row = next(line for line in text.splitlines() if line.split()[:1] == [str(worst)])
    told = [float(cell) for cell in row.split()[5:7]]
    assert told == pytest.approx([found.minimal_bias[worst], found.gross_error[worst]], rel=1e-2)


def test_flatness_and_comparison_are_reported_if_given():
    X = plane_with_outliers(200, 10, 12.0)
    detector, other = (BaardaPlaneDetector().fit(X + np.array([0, 0, dz])) for dz in (0, 3))
    flat, compared = flatness(detector, X, 5.0), compare_planes(detector, other)
    rows, _ = reported(detector, X, flatness=flat, comparison=compared)
    assert rows["tolerance"] == "5 between two parallel planes"
    assert rows["flatness"].startswith(flat.verdict)
    assert rows["against"] == "moved"
    assert numbers(rows["offset"]) == pytest.approx(compared.offset[:2], rel=0.05)


@pytest.mark.parametrize("test", ["w", "tau", "t"])
def test_each_listed_point_has_its_p_and_what_its_error_would_have_done(test):
    X = plane_with_outliers(60, 3, 9.0)
    detector = BaardaPlaneDetector(test=test).fit(X)
    _, text = reported(detector, X)
    told = detector.reliability(X)
    lines = [line.split() for line in text.splitlines()]
    head = next(line for line in lines if line[:1] == ["row"])
    assert head[3:5] == ["statistic", "p"]
    for i in np.argsort(-detector.test_statistic_)[:5]:
        row = next(line for line in lines if line[:1] == [str(i)])
        inside = detector.support_[i]
        f, value = detector.dof_ + 1 - inside, detector.test_statistic_[i]
        if test == "tau":
            value = value * np.sqrt((f - 1) / (f - value**2))
        tail = stats.norm.sf(value) if test == "w" else stats.t.sf(value, f - 1)
        assert float(row[4]) == pytest.approx(2 * tail, rel=0.05)
        assert float(row[8]) == pytest.approx(detector.leverage_[i] * told.gross_error[i], rel=0.05)


def test_the_variance_ratio_of_the_fuzzy_test_has_the_degrees_of_freedom_without_its_outliers():
    X = plane_with_outliers(60, 6, 12.0)
    detector = FuzzyPlaneDetector(sigma0=1.0).fit(X)
    f = np.count_nonzero(detector.labels_ == 1) - 3
    assert f < detector.dof_
    low, high = stats.chi2(f).ppf([0.025, 0.975]) / f
    words = reported(detector, X)[0]["variance ratio"]
    assert words.startswith(f"{detector.variance_factor_:.4g} = v'Pv")
    assert words.endswith(f"{low:.4g} to {high:.4g} is usual (95 %)")


def test_a_horizontal_plane_falls_to_no_side():
    rng = np.random.default_rng(1)
    X = rng.uniform(-2, 2, (30, 3)) * [1, 1, 0] + rng.normal(0, 0.004, (30, 3))
    for slope, falls in ((0.0, False), (0.1, True)):
        tilted = X + np.outer(X[:, 0] * slope, [0, 0, 1])
        detector = BaardaPlaneDetector(sigma0=0.004, surface="orthogonal").fit(tilted)
        report = text_report(detector, tilted)
        assert ("dip direction" in report) == falls


def test_where_there_is_no_reliability_the_report_does_without():
    X = plane_with_outliers(200, 10, 12.0)
    text = text_report(BaardaPlaneDetector(0.9, correction="none").fit(X), X)
    assert "Standard errors" in text
    assert "Reliability" not in text
