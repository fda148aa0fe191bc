"""What a plane leaves: lack of fit and bows against dense algebra, levels and powers."""

import numpy as np
import pytest
from scipy import stats

from sklearn_mcmd.adjustment import BaardaPlaneDetector
from sklearn_mcmd.planes._form import cells_of, form_of

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
    places = rng.normal(size=(90, 2)) * [3, 1]
    p = rng.uniform(0.5, 2, 90) if weighted else np.ones(90)
    x, y = places.T
    z = rng.normal(size=90) + x * y  # which no strips along the axes show
    plane = np.column_stack([np.ones(90), x, y])
    quadric = np.column_stack([plane, x * x, x * y, y * y])
    cells = np.eye(16)[cells_of(places, z, p).of_point]

    def left(design, values, p):
        root = np.sqrt(p)
        return values - design @ np.linalg.lstsq(root[:, None] * design, root * values)[0]

    v, of_quadric = left(plane, z, p), left(quadric, z, p)
    form = form_of(places, v, p if weighted else None)
    assert form.alike_deviation == pytest.approx(np.sqrt((p @ v**2 - p @ of_quadric**2) / 3))
    assert form.alike_dof == 3
    assert form.bow == pytest.approx(np.ptp(v - of_quadric))
    # The means of cells, on the plane that fits them best, against the noise inside of cells.
    sums = cells.T @ p
    means, centers = (cells.T @ (p * v)) / sums, (cells.T @ (p[:, None] * plane)) / sums[:, None]
    between, within = sums @ left(centers, means, sums) ** 2, p @ left(cells, v, p) ** 2
    assert form.statistic == pytest.approx(between / 13 / (within / 74))
    assert form.pvalue == pytest.approx(stats.f.sf(form.statistic, 13, 74))
    assert form.noise == pytest.approx(np.sqrt(within / 74))


@pytest.mark.parametrize("weighted", [False, True])
def test_strips_are_regressions_on_their_means(weighted):
    rng = np.random.default_rng(2)
    n, k = 320, 8
    places, strip = rng.uniform(-1, 1, (n, 2)) * [2, 1], np.empty(n, int)
    p = rng.uniform(0.5, 2, n) if weighted else np.ones(n)
    strip[np.argsort(places[:, 1])] = np.arange(n) * k // n
    z = rng.normal(size=n) + np.resize([3.0, -3.0], k)[strip]  # each differs from its neighbors
    design = np.column_stack([np.ones(n), places])
    v = z - design @ np.linalg.solve((design.T * p) @ design, design.T @ (p * z))
    sums = np.bincount(strip, p)
    means, centers = (np.bincount(strip, p * of) / sums for of in (v, places[:, 1]))
    _, residues, *_ = np.polyfit(centers, means, 1, w=np.sqrt(sums), full=True)
    form = form_of(places, v, p if weighted else None)
    assert (form.alike_deviation, form.alike_dof) == (
        pytest.approx(np.sqrt(residues[0] / (k - 2))),
        k - 2,
    )


def test_rows_of_a_scan_are_seen_along_the_level_line_whatever_the_axes_of_the_wall():
    rng, angle, seen = np.random.default_rng(3), np.radians(30), []
    fall = [-np.sin(angle), np.cos(angle)]
    for _ in range(20):
        places = rng.uniform(0, 3, (2000, 2))
        common = 0.4 * rng.normal(size=14)[(places[:, 1] * 14 / 3).astype(int)]
        turned = (places @ [1, 1j] * np.exp(1j * angle)).view(float).reshape(-1, 2)
        forms = [form_of(turned, rng.normal(size=2000) + common, rises=r) for r in (None, fall)]
        seen.append([one.alike_dof == 6 for one in forms])
    by_axes, by_fall = np.mean(seen, axis=0)
    assert by_axes < 0.5
    assert by_fall > 0.7  # in others bows make errors larger


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


def test_strips_do_not_depend_on_the_order_of_rows_where_places_tie():
    rng = np.random.default_rng(4)
    places = np.stack(np.meshgrid(np.arange(60.0), np.arange(20.0)), -1).reshape(-1, 2)
    z = rng.normal(size=1200) + np.repeat(rng.normal(size=20), 60)
    z -= z.mean()
    told = {form_of(places[order], z[order])[-2:] for order in map(rng.permutation, [1200] * 5)}
    first, *others = told
    np.testing.assert_allclose(others, [first] * len(others), rtol=1e-9)


@pytest.mark.parametrize("n", [4, 5, 6, 9])
def test_few_points_have_no_lack_of_fit_and_independent_noise(n):
    detector = BaardaPlaneDetector(1e-9, sigma0="auto").fit(wall(n))
    assert not detector.form_.is_alike(0) or detector.form_.pvalue < 0.25
    assert detector.form_.alike_dof <= min(3, detector.dof_)  # of bows: strips need 16 points
    assert np.isfinite(detector.precision().covariance).all()


def test_a_line_bows_and_exact_points_do_not():
    rng = np.random.default_rng(0)
    line = np.column_stack([rng.uniform(0, 5, 300), rng.normal(0, NOISE, 300)])
    assert form(line + np.array([0, 1]) * 0.01 * line[:, :1] ** 2).pvalue < 1e-6
    exact = BaardaPlaneDetector(1e-9, sigma0=NOISE).fit(wall() * [1, 1, 0])
    assert not exact.form_.is_alike(exact._fitted.scale)


def test_many_regressors_have_no_bows():
    rng = np.random.default_rng(0)
    form = form_of(rng.normal(size=(300, 80)), rng.normal(size=300))
    assert np.isnan(form.pvalue)
    assert np.isnan(form.bow)
    assert not form.is_alike(0.1)
