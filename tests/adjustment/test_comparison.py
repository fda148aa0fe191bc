"""Two planes: verdicts, levels and smallest differences by simulation."""

import numpy as np
import pytest
from scipy import stats

from sklearn_mcmd.adjustment import BaardaPlaneDetector, FuzzyPlaneDetector, compare_planes

SIGMA = 0.01


def fitted(rng, n=40, slope=0.3, height=0.0, offset=0.0, surface="orthogonal", **options):
    xy = np.random.default_rng(n).uniform(-2.5, 2.5, (n, 2))
    xy -= xy.mean(axis=0)
    X = np.column_stack([xy, slope * xy[:, 0] + height])
    X += rng.normal(0, SIGMA, (n, 3)) if surface == "orthogonal" else 0
    X[:, 2] += 0 if surface == "orthogonal" else rng.normal(0, SIGMA, n)
    options = {"sigma0": SIGMA, "surface": surface} | options
    return BaardaPlaneDetector(1e-9, **options).fit(X + offset)


@pytest.mark.parametrize(
    ("change", "verdict"),
    [
        ({}, "same"),
        ({"height": 0.05}, "moved"),
        ({"slope": 0.35}, "tilted"),
        ({"slope": 0.35, "height": 0.2}, "tilted and moved"),
    ],
)
@pytest.mark.parametrize("offset", [0.0, 5e6])
def test_the_verdict_says_what_happened(change, verdict, offset):
    rng = np.random.default_rng(2)
    found = compare_planes(fitted(rng, offset=offset), fitted(rng, offset=offset, **change))
    assert found.verdict == verdict
    angle = np.degrees(np.arctan(change.get("slope", 0.3)) - np.arctan(0.3))
    assert found.tilt.value == pytest.approx(angle, abs=4 * found.tilt.error)


def test_the_other_way_round_only_the_sign_of_the_offset_changes():
    rng = np.random.default_rng(0)
    a, b = fitted(rng), fitted(rng, height=0.02)
    there, back = compare_planes(a, b), compare_planes(b, a)
    assert there.offset.value > 0 > back.offset.value
    # The offset is along the normal of the first plane.
    assert there.offset.value == pytest.approx(-back.offset.value, rel=1e-4)
    assert there.tilt == pytest.approx(back.tilt, rel=1e-4)


@pytest.mark.parametrize("variance", ["prior", "posterior"])
def test_a_plane_and_itself_differ_by_0_with_the_errors_of_two_such_planes(variance):
    a = fitted(np.random.default_rng(0))
    one, found = a.precision(variance), compare_planes(a, a, variance=variance)
    assert (found.tilt.value, found.offset.value) == (0, 0)
    assert found.offset.error == pytest.approx(np.sqrt(2) * one.offset_error)
    assert found.tilt.error == pytest.approx(np.sqrt(2) * one.ellipse[0])
    assert found.offset.smallest > 2 * found.offset.error


@pytest.mark.parametrize("surface", ["vertical", "orthogonal"])
@pytest.mark.parametrize("variance", ["prior", "posterior"])
def test_equal_planes_differ_with_probability_alpha(surface, variance):
    rng = np.random.default_rng(3)
    verdicts = []
    for _ in range(300):
        # One plane is known better: Welch's degrees of freedom.
        a, b = fitted(rng, 12, surface=surface), fitted(rng, 36, surface=surface)
        verdicts.append(compare_planes(a, b, variance=variance).verdict != "same")
    assert np.mean(verdicts) == pytest.approx(0.05, abs=0.038)  # three standard errors


def test_an_offset_of_the_smallest_size_is_found_with_the_power():
    rng = np.random.default_rng(4)
    a, b = fitted(rng, 20), fitted(rng, 20)
    smallest = compare_planes(a, b, variance="prior").offset.smallest
    height = smallest * np.sqrt(1 + 0.3**2)  # along z
    found = []
    for _ in range(300):
        a, b = fitted(rng, 20), fitted(rng, 20, height=height)
        found.append(compare_planes(a, b, variance="prior").offset.significant)
    assert np.mean(found) == pytest.approx(0.8, abs=0.07)  # three standard errors


def test_two_horizontal_lines_are_compared_as_by_welchs_t():
    # On points symmetric about their middle the offset there is the difference of the means.
    x = np.repeat(np.arange(-3.0, 4.0), 2)
    rng = np.random.default_rng(5)
    sets = [np.column_stack([x, rng.normal(m, s, 14)]) for m, s in ((0, 0.1), (0.1, 0.3))]
    for points in sets:  # without slope, so that residuals are those of the mean
        points[:, 1] -= np.polyfit(x, points[:, 1], 1)[0] * x
    a, b = (BaardaPlaneDetector(1e-9).fit(points) for points in sets)
    ours = compare_planes(a, b).offset
    # A line has one parameter more than a mean: 12 degrees of freedom and not 13.
    variances = [(points[:, 1].var() * 14 / 12) / 14 for points in sets]
    assert ours.value == pytest.approx(sets[1][:, 1].mean() - sets[0][:, 1].mean())
    assert ours.error == pytest.approx(np.sqrt(sum(variances)))
    dof = sum(variances) ** 2 / sum(v**2 / 12 for v in variances)
    assert ours.pvalue == pytest.approx(2 * stats.t.sf(abs(ours.value) / ours.error, dof))


def test_what_cannot_be_is_refused():
    rng = np.random.default_rng(0)
    a = fitted(rng)
    line = FuzzyPlaneDetector(sigma0=SIGMA).fit(rng.normal(size=(20, 2)) * [1, SIGMA])
    with pytest.raises(ValueError, match="of 3 and 2 columns"):
        compare_planes(a, line)
    with pytest.raises(ValueError, match="variance='prior' needs a known sigma0"):
        compare_planes(a, fitted(rng, sigma0="auto"), variance="prior")
    with pytest.raises(ValueError, match="not fitted yet"):
        compare_planes(a, BaardaPlaneDetector())
