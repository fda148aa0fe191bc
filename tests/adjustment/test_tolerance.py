"""Zones against all candidates of a hull, and verdicts against the uncertainty."""

import numpy as np
import pytest
from scipy.optimize import linprog
from scipy.spatial import ConvexHull

from sklearn_mcmd.adjustment import BaardaPlaneDetector, flatness
from sklearn_mcmd.adjustment._tolerance import _least_largest, minimum_zone


def sheet(n=60, noise=0.05, seed=0):
    rng = np.random.default_rng(seed)
    return np.column_stack([rng.uniform(0, 4, (n, 2)), rng.normal(0, noise, n)])


def least_width(X):
    """The least width is that across a face of the hull, or across two of its edges."""
    hull = ConvexHull(X)
    edges = {tuple(sorted(pair)) for s in hull.simplices for pair in zip(s, np.roll(s, 1))}  # noqa: B905
    D = np.array([X[a] - X[b] for a, b in edges])
    normals = np.cross(D[:, None], D[None]).reshape(-1, 3)
    length = np.linalg.norm(normals, axis=1)
    normals = np.vstack(
        [normals[length > 1e-9] / length[length > 1e-9, None], hull.equations[:, :3]]
    )
    return np.ptp(X @ normals.T, axis=0).min()


@pytest.mark.parametrize("seed", range(5))
def test_the_minimum_zone_is_the_least_width_of_the_hull(seed):
    X = sheet(seed=seed)
    turn = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    expected = least_width(X)
    assert minimum_zone(X) == pytest.approx(expected, rel=1e-6)
    assert minimum_zone(X @ turn + 5e6) == pytest.approx(expected, rel=1e-6)


def test_the_minimum_zone_of_an_exact_plane_is_nothing_and_of_a_line_has_two_dimensions():
    exact = sheet(noise=0)
    assert minimum_zone(exact) == pytest.approx(0, abs=1e-15)
    assert minimum_zone(np.array([[0.0, 0], [1, 1], [2, 0]])) == pytest.approx(1)
    assert minimum_zone(exact[:1]) == pytest.approx(0, abs=1e-15)  # all that a test may leave


@pytest.mark.parametrize("sigma0", [0.004, "auto"])
@pytest.mark.parametrize(
    ("bow", "tolerance", "verdict"),
    [(0, 0.010, "kept"), (0.020, 0.005, "exceeded"), (0.010, 0.010, "undecided")],
)
def test_the_form_of_a_wall_is_judged_through_its_noise(sigma0, bow, tolerance, verdict):
    X = np.random.default_rng(1).uniform(0, 1, (8_000, 3)) * [4, 2.5, 0]
    X[:, 2] = np.random.default_rng(2).normal(0, 0.004, 8_000) + bow * (X[:, 0] / 2 - 1) ** 2
    options = {"surface": "orthogonal", "robust_start": True, "random_state": 0}
    found = flatness(BaardaPlaneDetector(sigma0=sigma0, **options).fit(X), X, tolerance)
    assert found.verdict == verdict
    # Cells are a quarter of the wall long, over which the bow rises by 7/16 of its height.
    assert found.form == pytest.approx(9 / 16 * bow, abs=0.002)
    assert found.form_uncertainty < 0.003 < found.uncertainty


def noisy_wall(seed, n=2_000, noise=0.002, rows=0):
    rng = np.random.default_rng(seed)
    X = np.column_stack([rng.uniform(-1, 1, (n, 2)) * [2, 1.25], rng.normal(0, noise, n)])
    if rows:
        X[:, 1] = np.resize(np.repeat(np.linspace(-1.25, 1.25, rows), n // rows), n)
    return X, rng


def flatness_of(X, tolerance, noise=0.002):
    detector = BaardaPlaneDetector(sigma0=noise, surface="orthogonal").fit(X)
    return flatness(detector, X, tolerance)


@pytest.mark.parametrize("rows", [0, 2, 3, 6, 20])
def test_flat_walls_are_kept_also_if_measured_in_rows(rows):
    verdicts = [flatness_of(noisy_wall(seed, rows=rows)[0], 0.010).verdict for seed in range(10)]
    assert verdicts.count("kept") >= 9
    assert "exceeded" not in verdicts


@pytest.mark.parametrize("tolerance", [0.010, 0.030])
def test_a_bump_of_the_size_that_is_told_is_never_kept_and_a_higher_one_is_exceeded(tolerance):
    verdicts = []
    for seed in range(6):
        X, rng = noisy_wall(seed)
        flat, center = flatness_of(X, tolerance), rng.uniform(-1, 1, 2) * [1.5, 1]
        inside = np.all(np.abs(X[:, :2] - center) < np.array(flat.bump) / 2, axis=1)
        found = []
        for times in (1, 1.5):
            X[inside, 2] += times * flat.bump_height
            found.append(flatness_of(X, tolerance).verdict)
            X[inside, 2] -= times * flat.bump_height
        verdicts.append(found)
    low, high = zip(*verdicts, strict=True)
    assert tolerance < flat.bump_height < 1.35 * tolerance
    assert "kept" not in low + high
    assert high.count("exceeded") >= 5


@pytest.mark.parametrize(
    ("height", "verdict"), [(0.45, "kept"), (0.6, "kept"), (0.95, "undecided"), (1.4, "exceeded")]
)
def test_the_zone_may_lie_anywhere_so_a_plateau_as_high_as_the_tolerance_decides(height, verdict):
    """A plane of least squares lies near the floor; half of the tolerance beside it is no zone."""
    verdicts = []
    for seed in range(5):
        X, rng = noisy_wall(seed)
        center = rng.uniform(-1, 1, 2) * [1.4, 0.65]
        X[np.all(np.abs(X[:, :2] - center) < 0.5, axis=1), 2] += height * 0.020
        verdicts.append(flatness_of(X, 0.020).verdict)
    assert verdicts.count(verdict) >= 4


@pytest.mark.parametrize(
    ("height", "verdict"),
    [(0.5, "kept"), (0.95, None), (1.0, "undecided"), (1.1, "exceeded")],
)
@pytest.mark.parametrize("twisted", [False, True])
def test_a_bow_or_a_twist_as_high_as_the_tolerance_decides(height, verdict, twisted):
    verdicts = []
    for seed in range(5):
        X, _ = noisy_wall(seed)
        x, y = (X[:, :2] / [2, 1.25]).T
        # Few points are in the very corners: of 2,000, a twist lacks a twentieth of its height.
        X[:, 2] += height * 0.020 * (1.05 * x * y / 2 if twisted else x**2)
        verdicts.append(flatness_of(X, 0.020).verdict)
    assert verdict is None or verdicts.count(verdict) >= 4
    assert height == 1.1 or "exceeded" not in verdicts


def test_a_ghost_is_an_outlier_and_no_form():
    X, _ = noisy_wall(0)
    X[0, 2] = 0.1
    found = flatness_of(X, 0.020)
    assert (found.verdict, found.n_significant) == ("kept", 1)


def test_more_points_leave_a_kept_bow_kept():
    for n in (2_000, 20_000):
        X, _ = noisy_wall(0, n)
        X[:, 2] += 0.7 * 0.020 * (X[:, 0] / 2) ** 2
        assert flatness_of(X, 0.020).verdict == "kept"


def test_rounding_to_a_level_is_in_the_limits():
    """A file of steps of 1 cm shows neither a bow of 8 mm nor that a level plane has none."""
    X, _ = noisy_wall(0, noise=0.0005)
    X[:, 2] += 0.008 * (X[:, 0] / 2) ** 2
    assert flatness_of(np.round(X, 2), 0.002, 0.003).verdict != "kept"
    X, _ = noisy_wall(1, noise=0.001)
    X[:, 2] += 0.0049
    assert flatness_of(np.round(X, 2), 0.005, 0.003).verdict != "exceeded"


def test_a_strip_that_covers_a_third_of_small_cells_is_not_kept():
    X, _ = noisy_wall(0)
    X[np.abs(X[:, 0] - 0.3) < 0.04, 2] += 0.060  # cells are 0.25 wide
    assert flatness_of(X, 0.020).verdict != "kept"


def test_points_without_noise_have_a_verdict():
    X, _ = noisy_wall(0, 500, 0.0)
    assert flatness_of(X, 0.010).verdict == "kept"


def test_a_least_zone_with_margins_is_that_of_all_constraints():
    rng = np.random.default_rng(0)
    along, across, margins = rng.normal(size=(50, 2)), rng.normal(size=50), rng.normal(size=50)
    slopes, constant, least = _least_largest(along, across, margins)
    rows, one = np.column_stack([along, np.ones(50)]), -np.ones((50, 1))
    both, limits = np.block([[rows, one], [-rows, one]]), np.r_[across - margins, -across - margins]
    expected = linprog([0, 0, 0, 1], both, limits, bounds=(None, None)).x
    np.testing.assert_allclose([*slopes, constant, least], expected, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize(("n", "n_cells"), [(30, 4), (100, 8), (300, 16)])
def test_few_points_make_few_cells_that_keep_a_flat_wall_and_no_bow(n, n_cells):
    flat, bowed = [], []
    for seed in range(8):
        X, _ = noisy_wall(seed, n, 0.001)
        found = flatness_of(X, 0.010, 0.001)
        assert found.n_cells == n_cells
        flat.append(found.verdict)
        X[:, 2] += 0.004 * X[:, 0] ** 2
        bowed.append(flatness_of(X, 0.010, 0.001).verdict)
    assert flat.count("kept") >= 7
    assert "kept" not in bowed


def test_points_of_a_dent_are_counted_and_a_few_are_no_form():
    X = sheet(500, noise=0.001)
    X[:7, 2] -= 0.02
    found = flatness(BaardaPlaneDetector(sigma0="auto", surface="orthogonal").fit(X), X, 0.01)
    assert found.verdict == "kept"
    assert found.n_significant == found.n_outside == 7
    assert found.zone < 0.01  # of the others
    near = np.argsort(np.linalg.norm(X[:, :2] - 2, axis=1))[:60]
    X[near, 2] -= 0.02
    found = flatness(BaardaPlaneDetector(sigma0="auto", surface="orthogonal").fit(X), X, 0.01)
    assert found.verdict == "exceeded"


def test_a_tilted_plane_has_perpendicular_distances():
    X = sheet(200, noise=0)
    X[:, 2] = 2 * X[:, 0]
    X[0, 2] += 1
    found = flatness(BaardaPlaneDetector(sigma0=0.01).fit(X), X, 0.9)
    assert found.n_outside == 0  # 1 along z is 0.447 across
    assert flatness(BaardaPlaneDetector(sigma0=0.01).fit(X), X, 0.88).n_outside == 1


@pytest.mark.parametrize("width", [0, -1, np.nan, np.inf, "5mm"])
def test_a_width_that_cannot_be_is_refused(width):
    X = sheet()
    with pytest.raises(ValueError, match="is no width: give a finite number"):
        flatness(BaardaPlaneDetector().fit(X), X, width)
