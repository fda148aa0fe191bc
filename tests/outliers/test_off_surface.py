"""How far points that no surface explains stand off, by hand on small clouds."""

from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from sklearn_mcmd import MCMDOutlierDetector
from sklearn_mcmd.outliers._off_surface import Unexplained
from sklearn_mcmd.outliers._small_groups import judge_off_surface

# The mean distance to the 8 nearest on a square lattice of spacing 1.
LATTICE = (4 + 4 * np.sqrt(2)) / 8
LENGTH = np.sqrt(12)  # of a line, in standard deviations


def spacing_of(points, counts, others_only=False):
    gaps = np.linalg.norm(points[:, None] - points, axis=2)
    spacing = []
    for i, row in enumerate(gaps):
        copies = np.where(np.arange(len(points)) == i, 0 if others_only else counts - 1, counts)
        order = np.argsort(row, kind="stable")
        spacing.append(np.repeat(row[order], copies[order])[:8].mean())
    return np.array(spacing)


def index_of(points):
    return SimpleNamespace(points=points)


def company(points, n_explained, least=100, counts=None, n_jobs=None):
    """The first of the points are on a surface; values are those of all points, 0 for these."""
    counts = np.ones(len(points), dtype=int) if counts is None else counts
    explained = np.arange(len(points)) < n_explained
    spacings = (spacing_of(points, counts, others_only=only) for only in (False, True))
    unexplained = Unexplained.of(index_of(points), counts, explained, *spacings)
    judged = judge_off_surface(unexplained, least, n_jobs)
    assert_array_equal(judged.rows, np.flatnonzero(~explained))
    isolation, separation = np.zeros(len(points)), np.zeros(len(points))
    isolation[~explained], separation[~explained] = judged.isolation, judged.separation
    return SimpleNamespace(
        isolation=isolation,
        separation=separation,
        measure=judged.measure,
        usual=judged.usual,
        groups=judged.groups,
    )


def lattice(n=20):
    """A level square of n x n points, 1 apart, its first point at the origin."""
    return np.stack([*np.meshgrid(np.arange(n), np.arange(n)), np.zeros((n, n))], -1).reshape(-1, 3)


def with_rest(*points):
    return np.vstack([lattice(), *[np.atleast_2d(np.asarray(p, dtype=float)) for p in points]])


def test_n_times_as_many_points_as_a_thing_must_stand_off_n_times_as_far():
    line = [[10, 10, 170 + 0.5 * i] for i in range(30)]
    size = 170 / (0.5 * LENGTH * np.std(range(30)))
    for least, weight in ((31, 1), (30, 1), (15, 1 / 2), (9, 3 / 10)):
        judged = company(with_rest(*line), 400, least=least)
        assert_allclose(judged.separation[400:], size * weight)
    assert size * 7 / 30 < 3
    assert_array_equal(company(with_rest(*line), 400, least=7).separation[400:], 0)


def test_large_groups_stand_off_from_each_other():
    """Clumps of as many points as the least thing has, none of which is real to itself."""
    clump = np.random.default_rng(0).normal(size=(30, 3))
    centers = np.array([[10, 10, 200], [10, 70, 200], [90, 10, 200], [10, 10, 250]])
    groups = clump + centers[:, None]
    X = with_rest(*groups)
    judged = company(X, 400, least=30)
    for i, group in enumerate(groups):
        rows = slice(30 * i, 30 * (i + 1))
        others = np.vstack([X[:400], *np.delete(groups, i, axis=0)])
        gap = np.linalg.norm(group[:, None] - others, axis=2).min()
        spread = np.sqrt(np.linalg.eigvalsh(np.cov(group.T, bias=True))[-1])
        size = max(spread, judged.usual[rows].mean())
        assert_allclose(judged.separation[400:][rows], gap / size)


def line_at(x, y, z, n=12):
    """Points half a unit apart."""
    return [[x + 0.5 * i, y, z] for i in range(n)]


@pytest.mark.parametrize("n", [12, 24])
@pytest.mark.parametrize(("gap", "one_thing"), [(29, True), (31, False)])
def test_flat_groups_nearer_to_each_other_than_to_anything_real_are_one(n, gap, one_thing):
    """Beside each other, one 30 above the surface, the other beyond its border."""
    X = with_rest(line_at(5, 5, 30), line_at(5 - gap, 5, 30, n)[::-1])
    X[412:, 0] -= X[412:, 0].max() - (5 - gap)
    judged = company(X, 400)
    assert (judged.isolation[400:] < 3).all()
    to_real = np.linalg.norm(X[412:, None] - X[:400], axis=2).min()
    one_thing |= gap <= to_real
    group = X[400:] if one_thing else X[400:412]
    size = LENGTH * np.sqrt(np.linalg.eigvalsh(np.cov(group.T, bias=True))[-1])
    assert_allclose(judged.separation[400:412], 30 / size)


def test_pieces_are_one_thing_even_if_each_has_nearly_the_least_size_of_a_thing():
    judged = company(with_rest(line_at(5, 5, 30), line_at(5, 13, 30)), 400, least=12.5)
    assert_array_equal(judged.groups, 0)


@pytest.mark.parametrize("n", [3, 4])
def test_what_a_plane_needs_is_no_piece(n):
    X = with_rest(line_at(5, 5, 30, n), line_at(5, 9, 30), line_at(5, 13, 30))
    judged = company(X, 400, counts=np.repeat([1, 9, 1], [400, n, 24]))
    assert (judged.separation[400] == judged.separation[-1]) == (n > 3)


def test_clumps_that_fill_space_are_no_pieces():
    clump = np.random.default_rng(0).normal(size=(30, 3))
    for squeezed, one_thing in ((1, False), (0.01, True)):
        part = clump * [1, 1, squeezed] + [10, 10, 30]
        judged = company(with_rest(part, part + np.array([0, 0, 8])), 400)
        assert (judged.separation[400] == judged.separation[-1]) == one_thing


@pytest.mark.parametrize("height", [100, 200])
def test_pieces_are_as_near_as_their_lengths_and_how_far_they_hang_allow(height):
    """What is far off has nothing real beside it, and other errors about as far away."""
    reach = 5 * 2 * LENGTH * 0.5 * np.std(range(12))
    for share, one_thing in ((0.98, True), (1.02, False)):
        gap = share * reach**2 / height
        lines = line_at(5, 10 - gap / 2, height), line_at(5, 10 + gap / 2, height)
        judged = company(with_rest(*lines), 400)
        assert (judged.groups[0] == judged.groups[-1]) == one_thing


@pytest.mark.parametrize(("tilt", "one_thing"), [(0.0, True), (0.1, False)])
def test_pieces_in_one_plane_are_one_thing_whatever_is_nearer(tilt, one_thing):
    """As those of a wall that a depth camera measured in steps."""
    patch = lattice(4) * 0.7
    beside = patch + np.outer(patch[:, 0], [0, 0, tilt]) + np.array([8, 0, 0])
    judged = company(with_rest(patch + np.array([4, 4, 4]), beside + np.array([4, 4, 4])), 400)
    assert (judged.groups[0] == judged.groups[-1]) == one_thing


def test_points_in_a_row_keep_company_with_it_however_far_apart_they_are():
    rng = np.random.default_rng(0)
    row = [[1, 9, 20]] + np.outer(np.arange(12), [2, 0.5, 0.3]) * 2 + rng.normal(0, 0.1, (12, 3))
    judged = company(with_rest(row), 400)
    assert_array_equal(judged.groups, 0)
    assert (judged.isolation[400:] < 1).all()
    assert_allclose(judged.isolation[400:], judged.separation[400:])
    bent = row * [1, 1, 0] + np.outer(np.square(np.arange(12) - 5.5), [0, 0.7, 0.5])
    bent = company(with_rest(bent + np.array([0, 0, 20])), 400)
    assert len(np.unique(bent.groups)) == 12
    assert (bent.isolation[400:] > 3).all()


def test_copies_count_as_measurements():
    """Of its own company, and of the size of its group; not of what is usual."""
    X = with_rest([10, 10, 5], [10, 11, 5])
    counts = np.ones(402, dtype=int)
    counts[400] = 9
    judged = company(X, 400, least=10, counts=counts)
    assert judged.isolation[400] == 0
    assert judged.isolation[401] > 0
    assert_array_equal(judged.separation[400:], 0)
    assert company(X, 400, least=11, counts=counts).separation[400] > 0
    counts[:400] = 9
    assert_allclose(company(X, 400, least=10, counts=counts).usual, 1)


def test_groups_are_those_of_near_points_walked_by_brute_force():
    rng = np.random.default_rng(0)
    centers = rng.uniform([0, 0, 10], [100, 100, 110], (30, 3))
    clumps = np.vstack([rng.normal(center, 1, (m, 3)) for m, center in enumerate(centers, 2)])
    judged = company(with_rest(clumps), 400, least=10)
    gaps = np.linalg.norm(clumps[:, None] - clumps, axis=2)
    nearest = np.argsort(np.argsort(gaps, axis=1), axis=1) <= 16
    reach = 2.5 * np.minimum(judged.usual[:, None], judged.usual)
    _, groups = connected_components(csr_array(nearest & (gaps <= reach)), directed=False)
    pairs = np.unique(np.stack([groups, judged.groups]), axis=1)
    assert len(pairs[0]) == groups.max() + 1 > 20  # no group is divided


def test_without_a_surface_the_largest_group_is_real():
    clump = np.random.default_rng(0).normal(size=(30, 3))
    judged = company(np.vstack([clump, [[50.0, 0, 0]]]), 0, least=100)
    assert (judged.separation > 0).tolist() == [False] * 30 + [True]


# New points


def test_a_new_point_is_measured_as_if_it_alone_were_added():
    """Where it changes nothing else: no surface, no size of a group and no usual spacing."""
    rng = np.random.default_rng(0)
    flakes = rng.uniform([0, 0, 3], [20, 20, 9], (60, 3))
    fitted = company(with_rest(flakes), 400, least=70)
    queries = rng.uniform([-30, -30, 5], [50, 50, 60], (20, 3))
    for query in queries:
        added = company(with_rest(flakes, query), 400, least=70)
        spacing = spacing_of(with_rest(flakes, query), np.ones(461, dtype=int))[-1:]
        _, isolation, separation, _ = fitted.measure(query[None], spacing)
        assert_allclose(isolation, added.isolation[-1:], rtol=1e-12)
        gap = np.linalg.norm(flakes - query, axis=1).min()
        if gap > 2.5 * added.usual.max():  # a group of its own
            assert_allclose(separation, added.separation[-1:], rtol=1e-12)


@pytest.mark.parametrize("order", [1, -1])
@pytest.mark.parametrize(("pitch", "stands_off"), [(1.0, True), (2.5, False)])
def test_a_twig_stands_off_by_the_spacing_of_the_crown_it_hangs_in(order, pitch, stands_off):
    """Of a sparse crown, that is more than the spacing of the surfaces around, or its own size."""
    crown = [5, 5, 100] + pitch * np.stack(np.meshgrid(*[range(5)] * 3), -1).reshape(-1, 3)
    twig = crown[:, 0].max() + 6, 5, 100
    parts = [crown, twig + 0.5 * np.random.default_rng(0).random((6, 3))][::order]
    judged = company(with_rest(*parts), 400, least=30)
    of_twig = np.repeat([part is not crown for part in parts], [len(part) for part in parts])
    assert len(np.unique(judged.groups)) == 2
    assert ((judged.separation[400:][of_twig] > 3) == stands_off).all()
    # A single new point beside the crown is judged alike.
    _, _, separation, joined = judged.measure(crown[:1] - [6, 0, 0], np.array([5.0]))
    assert not joined
    assert (separation[0] > 3) == stands_off


def test_what_hangs_beside_a_small_flat_group_that_is_kept_is_beside_something_real():
    """A lamp above a mast that stands on the ground, or above a clump as near to it."""
    mast = np.arange(1.0, 13)[:, None] * [0, 0, 0.5] + np.array([5, 5, 0])
    clump = np.random.default_rng(0).normal(size=(40, 3))
    clump = 0.8 * clump / np.linalg.norm(clump, axis=1)[:, None] + np.array([5, 5, 3.2])
    lamp = 0.2 * np.stack(np.meshgrid(*[range(3)] * 3), -1).reshape(-1, 3)
    for host, stands_off in ((mast, False), (clump, True)):
        above = lamp + np.array([5, 5, host[:, 2].max() + 3.5])
        judged = company(with_rest(host, above), 400, least=90)
        assert len(np.unique(judged.groups)) == 2
        assert (judged.separation[400:-27] < 3).all()
        assert ((judged.separation[-27:] > 3) == stands_off).all()


def test_a_new_point_is_measured_where_all_points_are_on_surfaces():
    fitted = company(with_rest(), 400)
    assert_array_equal(fitted.isolation, 0)
    _, isolation, separation, _ = fitted.measure(np.array([[10, 10, 5.0]]), np.array([6.0]))
    extent = np.linalg.norm([19, 19, 5])
    assert_allclose(isolation, np.cbrt(extent**2 * 6) / LATTICE)
    assert_allclose(separation, 5 / LATTICE)


def test_a_point_away_from_a_cloud_of_one_place_stands_off_without_bounds():
    X = np.zeros((4, 3))
    counts, explained = np.ones(4, dtype=int), np.ones(4, dtype=bool)
    unexplained = Unexplained.of(index_of(X), counts, explained, np.zeros(4), np.zeros(4))
    fitted = judge_off_surface(unexplained, 2, None)
    _, isolation, separation, _ = fitted.measure(np.array([[5.0, 0, 0]]), np.array([5.0]))
    assert isolation >= 1e300
    assert separation >= 1e300


def ground(rng):
    return rng.random((4000, 3)) * [20, 20, 0] + rng.normal(0, 0.002, (4000, 3))


def flagged(X):
    detector = MCMDOutlierDetector(random_state=0)
    return detector.fit_predict(X)[4000:] == -1


@pytest.mark.parametrize("noise", [0, 0.003])
@pytest.mark.parametrize("apart", [3, 12])
def test_two_short_bits_that_point_elsewhere_are_no_wire(noise, apart):
    """Each is straight and nearest to the other; a wire as long as their gap would be kept."""
    rng, along = np.random.default_rng(0), np.linspace(-0.15, 0.15, 8)[:, None]
    bits = np.vstack([along * [1, 0, 0], along * [0, 0, 1] + np.array([apart, 0, 0])])
    bits += [5, 10, 15]
    assert flagged(np.vstack([ground(rng), bits + rng.normal(0, noise, bits.shape)])).all()


def test_plates_at_right_angles_are_no_pieces_of_one_thing():
    """Each reaches the line in which their planes cross, with a point that both planes explain."""
    rng = np.random.default_rng(0)
    level = [9.5, 7, 2.5] + rng.random((40, 3)) * [1, 1, 0] + rng.normal(0, 0.01, (40, 3))
    upright = [10, 12, 2] + rng.random((40, 3)) * [0, 1, 1] + rng.normal(0, 0.01, (40, 3))
    assert flagged(np.vstack([ground(rng), level, upright])).all()


@pytest.mark.parametrize("axis", [[0, 0, 1], [0, 1, 0], [0.6, 0.8, 0], [0.6, 0, 0.8]])
def test_points_on_a_line_have_no_plane_in_which_another_line_could_lie(axis):
    rng, along = np.random.default_rng(0), np.linspace(-0.1, 0.1, 5)[:, None] * axis
    lines = np.vstack([along, along + np.array([2, 0, 0])])
    assert flagged(np.vstack([ground(rng), lines + np.array([9, 10, 6])])).all()
