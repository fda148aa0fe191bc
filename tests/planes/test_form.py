"""What a plane leaves: lack of fit and bows against dense algebra, levels and powers."""

import numpy as np
import pytest
from scipy import stats

from sklearn_mcmd.adjustment import BaardaPlaneDetector
from sklearn_mcmd.planes._form import cells_of, form_of, planes_of

NOISE = 0.004


def wall(n=2000, bow=0.0, seed=0, width=(4.0, 2.5)):
    rng = np.random.default_rng(seed)
    X = np.column_stack([rng.uniform(0, 1, (n, 2)) * width, rng.normal(0, NOISE, n)])
    X[:, 2] += bow * (1 - (2 * X[:, 0] / width[0] - 1) ** 2)
    return X


def form(X, **options):
    return BaardaPlaneDetector(1e-9, sigma0=NOISE, surface="orthogonal", **options).fit(X).form_


@pytest.mark.parametrize("weighted", [False, True])
def test_f_and_bows_are_those_of_nested_regressions(weighted):
    rng = np.random.default_rng(1)
    places, z = rng.normal(size=(90, 2)) * [3, 1], rng.normal(size=90)
    p = rng.uniform(0.5, 2, 90) if weighted else np.ones(90)
    x, y = places.T
    plane = np.column_stack([np.ones(90), x, y])
    quadric = np.column_stack([plane, x * x, x * y, y * y])
    cells = np.eye(16)[cells_of(places, z, p).of_point]

    def left(design, values, p):
        root = np.sqrt(p)
        return values - design @ np.linalg.lstsq(root[:, None] * design, root * values)[0]

    v, of_quadric = left(plane, z, p), left(quadric, z, p)
    form = form_of(places, v, p if weighted else None)
    assert form.bow_deviation == pytest.approx(np.sqrt((p @ v**2 - p @ of_quadric**2) / 3))
    assert form.n_bows == 3
    assert form.bow == pytest.approx(np.ptp(v - of_quadric))
    # The means of cells, on the plane that fits them best, against the noise inside of cells.
    sums = cells.T @ p
    means, centers = (cells.T @ (p * v)) / sums, (cells.T @ (p[:, None] * plane)) / sums[:, None]
    between, within = sums @ left(centers, means, sums) ** 2, p @ left(cells, v, p) ** 2
    assert form.statistic == pytest.approx(between / 13 / (within / 74))
    assert form.pvalue == pytest.approx(stats.f.sf(form.statistic, 13, 74))
    assert form.noise == pytest.approx(np.sqrt(within / 74))


def test_cells_hold_as_many_points_and_ties_stay_together():
    rng = np.random.default_rng(0)
    places = rng.uniform(0, 1, (1600, 2)) ** 3 * [4, 1]  # of uneven density
    assert (cells_of(places, np.zeros(1600)).weights == 100).all()
    lattice = np.stack(np.meshgrid(np.arange(10.0), np.arange(7.0)), -1).reshape(-1, 2)
    order = rng.permutation(70)
    here, there = (cells_of(one, np.zeros(70)).of_point for one in (lattice, lattice[order]))
    assert len({*zip(here[order], there, strict=True)}) == len(set(here)) == len(set(there))


def test_flat_walls_lack_fit_at_the_level_and_bows_of_half_the_noise_do():
    flat = np.array([form(wall(200, seed=seed)).pvalue for seed in range(300)])
    assert np.mean(flat < 0.05) == pytest.approx(0.05, abs=0.038)  # three standard errors
    assert np.mean(flat < 0.5) == pytest.approx(0.5, abs=0.087)
    bowed = [form(wall(bow=NOISE / 2, seed=seed)) for seed in range(60)]
    assert np.mean([one.pvalue < 0.05 for one in bowed]) > 0.9
    # What noise adds to the height, as to a range, is some third of a millimeter.
    assert np.mean([one.bow for one in bowed]) == pytest.approx(NOISE / 2, abs=NOISE / 8)


@pytest.mark.parametrize("n", [4, 5, 6, 9])
def test_few_points_have_no_lack_of_fit_and_independent_noise(n):
    detector = BaardaPlaneDetector(1e-9, sigma0="auto").fit(wall(n))
    assert not detector.form_.is_alike(0) or detector.form_.pvalue < 0.25
    assert detector.form_.n_bows <= min(3, detector.dof_)
    assert np.isfinite(detector.precision().covariance).all()


def test_a_line_bows_by_three_degrees_and_exact_points_by_none():
    rng = np.random.default_rng(0)
    line = np.column_stack([rng.uniform(0, 5, 300), rng.normal(0, NOISE, 300)])
    of_line = form(line)
    assert of_line.n_bows == 3
    assert form(line + np.array([0, 1]) * 0.01 * line[:, :1] ** 2).pvalue < 1e-6
    exact = BaardaPlaneDetector(1e-9, sigma0=NOISE).fit(np.round(wall() * [1, 1, 0], 3))
    assert not exact.form_.is_alike(exact._fitted.scale)


@pytest.mark.parametrize(("width", "has_tilt"), [(NOISE / 100, False), (NOISE * 100, True)])
def test_a_cell_has_no_tilt_across_a_width_that_is_noise(width, has_tilt):
    rng = np.random.default_rng(0)
    places, p = rng.uniform(-1, 1, (200, 2)) * [2, width], rng.uniform(0.5, 2, 200)
    z = rng.normal(0, NOISE, 200) / np.sqrt(p)
    heights, cofactors = planes_of(cells_of(places, z, p, 0), places, z, p, NOISE)
    design = np.column_stack([np.ones(200), places])[:, : 2 + has_tilt]
    normal = np.linalg.inv((design.T * p) @ design)
    np.testing.assert_allclose(heights, design @ normal @ (design.T @ (p * z)), atol=NOISE / 1000)
    np.testing.assert_allclose(cofactors, np.sum(design @ normal * design, axis=1), rtol=0.01)


def test_many_regressors_have_no_bows():
    rng = np.random.default_rng(0)
    form = form_of(rng.normal(size=(300, 80)), rng.normal(size=300))
    assert np.isnan(form.pvalue)
    assert np.isnan(form.bow)
    assert not form.is_alike(0.1)
