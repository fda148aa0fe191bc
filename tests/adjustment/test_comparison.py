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
    pair, place = [fitted(rng, offset=offset, **one) for one in ({}, change)], np.full(3, offset)
    found = compare_planes(*pair, place=place)
    assert found.verdict == verdict
    angle = np.degrees(np.arctan(change.get("slope", 0.3)) - np.arctan(0.3))
    assert found.tilt.value == pytest.approx(angle, abs=4 * found.tilt.error)


@pytest.mark.parametrize("variance", ["prior", "posterior"])
def test_a_plane_and_itself_differ_by_0_with_the_errors_of_two_such_planes(variance):
    a = fitted(np.random.default_rng(0))
    one, center = a.precision(variance), a._fitted.plane.center
    found = compare_planes(a, a, variance=variance, place=center)
    assert (found.tilt.value, found.offset.value) == (0, 0)
    assert found.offset.error == pytest.approx(np.sqrt(2) * one.offset_error)
    assert found.tilt.error == pytest.approx(np.sqrt(2) * one.ellipse[0])
    assert found.offset.smallest > 2 * found.offset.error


@pytest.mark.parametrize(
    ("surface", "variance"), [("vertical", "prior"), ("orthogonal", "posterior")]
)
def test_equal_planes_differ_with_probability_alpha(surface, variance):
    rng = np.random.default_rng(3)
    verdicts = []
    for _ in range(160):
        # One plane is known better: Welch's degrees of freedom.
        a, b = fitted(rng, 12, surface=surface), fitted(rng, 36, surface=surface)
        verdicts.append(compare_planes(a, b, variance=variance).verdict != "same")
    assert np.mean(verdicts) == pytest.approx(0.05, abs=0.052)  # three standard errors


def test_an_offset_of_the_smallest_size_is_found_with_the_power():
    rng = np.random.default_rng(4)
    a, b = fitted(rng, 20), fitted(rng, 20)
    smallest = compare_planes(a, b, variance="prior").offset.smallest
    height = smallest * np.sqrt(1 + 0.3**2)  # along z
    found = []
    for _ in range(150):
        a, b = fitted(rng, 20), fitted(rng, 20, height=height)
        found.append(compare_planes(a, b, variance="prior").offset.significant)
    assert np.mean(found) == pytest.approx(0.8, abs=0.098)  # three standard errors


def turned(X, degrees, place):
    """Points turned about an axis along y through a place."""
    cosine, sine = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return (X - place) @ [[cosine, 0, -sine], [0, 1, 0], [sine, 0, cosine]] + place


def flat(rng, n=60):
    return np.column_stack([rng.uniform(0, 4, (n, 2)), rng.normal(0, SIGMA, n)])


def detector(X):
    return BaardaPlaneDetector(1e-9, sigma0=SIGMA, surface="orthogonal").fit(X)


def test_a_plane_that_turns_about_the_place_does_not_move():
    rng, place, moved = np.random.default_rng(7), np.array([2.0, 2.0, 0.0]), []
    for _ in range(150):
        pair = detector(flat(rng)), detector(turned(flat(rng), 1.0, place))
        moved.append(compare_planes(*pair, variance="prior", place=place).offset.significant)
    assert np.mean(moved) == pytest.approx(0.025, abs=0.038)  # three standard errors
    # Elsewhere it does, and the middle of the extents does not follow where points are many.
    X = flat(rng, 2000)
    X[:1000, 0] /= 4
    both = detector(X), detector(turned(X, 1.0, place))
    told = compare_planes(*both)
    np.testing.assert_allclose(told.place, place, atol=0.1)
    assert "moved" in compare_planes(*both, place=both[0]._fitted.plane.center).verdict


def test_errors_of_large_tilts_are_their_deviations():
    rng, tilt, found = np.random.default_rng(8), 80, []
    for _ in range(200):
        pair = detector(flat(rng)), detector(turned(flat(rng), tilt, np.zeros(3)))
        found.append(compare_planes(*pair, variance="prior").tilt)
    values, errors = np.array([(one.value, one.error) for one in found]).T
    assert values.mean() == pytest.approx(tilt, abs=0.05)
    # The deviation is known to 5 %.
    assert np.sqrt(np.mean(errors**2)) / values.std() == pytest.approx(1, abs=0.15)


def test_planes_with_sides_turn_by_more_than_a_right_angle_and_others_do_not():
    rng, place = np.random.default_rng(5), np.array([2.0, 2.0, 0.0])
    clouds, up = [flat(rng), turned(flat(rng), 120, place)], np.array([2.0, 2.0, 9.0])
    told = compare_planes(*map(detector, clouds), place=place)
    a, b = (
        BaardaPlaneDetector(1e-9, sigma0=SIGMA, surface="orthogonal", toward=toward).fit(X)
        for X, toward in zip(clouds, (up, turned(up, 120, place)), strict=True)
    )
    found = compare_planes(a, b, place=place)
    assert (told.tilt.value, found.tilt.value) == pytest.approx((60, 120), abs=0.5)
    assert (told.verdict, found.verdict) == ("tilted", "tilted")
    assert found.tilt.error == pytest.approx(told.tilt.error)


def test_a_registration_moves_the_center_and_the_rims():
    rng = np.random.default_rng(9)
    X = np.column_stack([rng.uniform(0, 1, (4000, 2)) * [6, 2], rng.normal(0, SIGMA, 4000)])
    a, b = detector(X), detector(X + np.array([0, 0, 0.004]))
    plain, told = compare_planes(a, b), compare_planes(a, b, registration_error=0.005)
    assert (plain.verdict, told.verdict) == ("moved", "same")
    assert (plain.registration_error, told.registration_error) == (0, 0.005)
    assert told.offset.error**2 - plain.offset.error**2 == pytest.approx(0.005**2)
    # The shorter rim is 1 from the middle, and the tilt of 0 is into the direction known worst.
    same = [compare_planes(a, a, registration_error=error).tilt.error for error in (0, 0.005)]
    turn = np.degrees(0.005 / 1.0)
    assert np.sqrt(same[1] ** 2 - same[0] ** 2) == pytest.approx(turn, rel=0.03)


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
    with pytest.raises(ValueError, match=r"place=\[1, 2\] is no place: give 3 coordinates"):
        compare_planes(a, a, place=[1, 2])
    with pytest.raises(ValueError, match="registration_error"):
        compare_planes(a, a, registration_error=-1)
    with pytest.raises(ValueError, match="not fitted yet"):
        compare_planes(a, BaardaPlaneDetector())


@pytest.mark.parametrize("surface", ["orthogonal", "vertical"])
@pytest.mark.parametrize("shift", [[500.0, 0, 150.0], [5e6, 4e5, 7.0], [0, -8.0, 0]])
def test_clouds_with_a_gap_between_them_do_not_overlap(shift, surface):
    rng = np.random.default_rng(0)
    pair = [fitted(rng, offset=np.array(one), surface=surface) for one in ([0.0, 0, 0], shift)]
    with pytest.warns(UserWarning, match="do not overlap.* one coordinate system"):
        assert compare_planes(*pair).verdict == "no overlap"
    assert compare_planes(*pair, place=[0.0, 0, 0]).verdict != "no overlap"  # as was asked for


def test_strips_that_cross_at_their_ends_overlap():
    rng = np.random.default_rng(0)
    strips = []
    for low, high in (([0.0, 0.0], [10.0, 0.5]), ([9.5, 0.0], [10.0, 10.0])):
        xy = rng.uniform(low, high, (300, 2))
        xyz = np.column_stack([xy, SIGMA * rng.normal(size=300)])
        strips.append(BaardaPlaneDetector(sigma0=SIGMA).fit(xyz))
    assert compare_planes(*strips).verdict != "no overlap"


@pytest.mark.parametrize("shift", [[5.0, 0, 1.5], [4.0, 4.0, 1.2], [0, 0, 300.0], [2.0, 1.0, 0.6]])
def test_neighbors_and_what_moved_along_the_normal_are_compared_in_silence(shift):
    rng = np.random.default_rng(0)
    pair = fitted(rng, slope=shift[2] / 5 % 0.6), fitted(rng, offset=np.array(shift))
    assert compare_planes(*pair).verdict != "no overlap"


def test_the_place_of_vertical_surfaces_is_on_them():
    rng = np.random.default_rng(0)
    flat = rng.exponential(1, (500, 2))
    X = np.column_stack([flat, flat @ [0.7, -0.4] + rng.normal(0, SIGMA, 500)])
    plane = BaardaPlaneDetector(sigma0=SIGMA, surface="vertical").fit(X)
    place = compare_planes(plane, plane).place
    assert place[2] == pytest.approx(place[:2] @ plane.coef_ + plane.intercept_, abs=1e-9)
