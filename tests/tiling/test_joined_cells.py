"""Surfaces and groups that run through many cells are whole, as in memory."""

from functools import partial

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from sklearn_mcmd import (
    MCMDOutlierDetector,
    RegionGrowing,
    RobustNormalEstimator,
    SharpFeatureDetector,
)
from sklearn_mcmd.datasets import make_crown_roof, make_street
from sklearn_mcmd.io import PointCloud, read_points
from sklearn_mcmd.segmentation import _region_division
from sklearn_mcmd.segmentation._region_cells import Points
from sklearn_mcmd.segmentation._region_division import VoteLimits
from sklearn_mcmd.tiling import _memory, _tiled_division, process_files
from sklearn_mcmd.tiling._stored_columns import CellColumns
from tiled import fit_in_memory, written

DETECTOR = MCMDOutlierDetector(16, random_state=0)


RNG = np.random.default_rng(0)


def ribbon(n=1_500):
    """A long and narrow surface, with some points that touch nothing."""
    X = RNG.uniform(0, 1, (n, 3)) * [60, 1, 0] + RNG.normal(0, 0.002, (n, 3))
    X[:20] += [0, 0, 5]
    return np.round(X, 3)


def scores_in_cells(by_tiles, folder, X, tile_size):
    """Scores by tiles and in memory, and the report of the former."""
    path = written(folder, X)
    values, _, report = by_tiles(path, DETECTOR, tile_size=tile_size)
    return values[:, 0], -fit_in_memory(read_points(path).xyz, DETECTOR).scores_, report


@pytest.mark.slow
def test_a_surface_that_runs_through_fifty_cells_is_one_surface(by_tiles, tmp_path):
    scores, expected, report = scores_in_cells(by_tiles, tmp_path, ribbon(1_100), 30)
    assert report.n_tiles >= 50
    assert_array_equal(scores, expected)
    assert (scores[20:] <= 3).mean() > 0.98


@pytest.mark.parametrize(("seed", "k", "tile_size"), [(134, 8, 900), (206, 16, 350)])
def test_a_link_to_a_place_that_links_to_nobody_is_that_of_memory(
    seed, k, tile_size, by_tiles, tmp_path
):
    """On a lattice a place may be as far as another's last neighbor, and be none of them."""
    rng = np.random.default_rng(seed)
    m = rng.integers(8, 40)
    plane = rng.integers(0, m, (1_500, 3)) * [2, 2, 0] + [0, 0, m // 2]
    X = np.unique(np.vstack([plane, rng.integers(0, 2 * m, (900, 3))]), axis=0) * 0.25
    path, detector = written(tmp_path, X), MCMDOutlierDetector(k, random_state=0)
    values = by_tiles(path, detector, tile_size=tile_size)[0]
    assert_array_equal(values[:, 0], -fit_in_memory(read_points(path).xyz, detector).scores_)


def test_a_group_on_the_corner_of_eight_cells_is_one_group(by_tiles, tmp_path):
    """Cuts are at medians: so eight clumps of a lattice of them, and one where these cuts meet."""
    corners = np.array(np.meshgrid(*[[-1, 1]] * 3)).reshape(3, -1).T
    walls = RNG.uniform(-4, 4, (8, 400, 3)) * [1, 1, 0.0005] + 10 * corners[:, None]
    ghost = RNG.normal(0, 0.1, (24, 3))
    X = np.round(np.vstack([*walls, ghost]), 4)
    scores, expected, report = scores_in_cells(by_tiles, tmp_path, X, 500)
    assert report.n_tiles >= 8
    assert_array_equal(scores, expected)
    assert (scores[-24:] > 3).all()


def test_the_nearest_real_point_may_be_a_kilometer_and_many_cells_away(by_tiles, tmp_path):
    clump = RNG.normal([0, 0, 1_000], 0.1, (20, 3))
    lost = np.array([0, 0, 3e3]) + RNG.uniform(-1e3, 1e3, (300, 3))
    X = np.round(np.vstack([ribbon(), clump, lost]), 3)
    scores, expected, _ = scores_in_cells(by_tiles, tmp_path, X, 200)
    assert_array_equal(scores, expected)
    assert (scores[1_500:] > 100).all()


def test_a_wire_whose_points_lie_in_many_cells_keeps_company_with_itself(by_tiles, tmp_path):
    wire = np.column_stack([np.linspace(0, 60, 50), np.full(50, 0.5), np.full(50, 4.0)])
    X = np.round(np.vstack([ribbon(), wire + RNG.normal(0, 0.005, wire.shape)]), 3)
    scores, expected, report = scores_in_cells(by_tiles, tmp_path, X, 100)
    assert report.n_tiles > 15
    assert_array_equal(scores, expected)
    assert (scores[1_500:] <= 3).all()


@pytest.mark.parametrize("level", ["groups", "surfaces"])
def test_a_cloud_of_nothing_but_surfaces_has_no_points_to_join(level, by_tiles, tmp_path):
    X = np.round(ribbon()[20:] * [1, 1, 0], 3)
    detector = MCMDOutlierDetector(16, strictness=level, random_state=0)
    path = written(tmp_path, X)
    values, _, _ = by_tiles(path, detector, tile_size=300)
    assert_array_equal(values[:, 0], -fit_in_memory(read_points(path).xyz, detector).scores_)
    assert (values[:, 0] <= 3).all()


@pytest.mark.parametrize("what", ["PART_OR_LINK", "SMALL_POINT", "LEVEL"])
def test_what_one_process_joins_is_refused_where_it_is_more_than_the_memory(
    what, tmp_path, monkeypatch
):
    X = ribbon()
    path = written(tmp_path, PointCloud(X, {"intensity": np.arange(len(X), dtype=np.uint16)}))
    monkeypatch.setattr(_memory, what, 1e15)
    with pytest.raises(ValueError, match=r"which .*take.* about .*MB, more than memory=.*MB"):
        process_files(path, tmp_path / "b.las", DETECTOR, tile_size=300, intensity=True)


@pytest.mark.parametrize("outliers", [pytest.param(0, marks=pytest.mark.slow), 40])
def test_an_edge_that_runs_through_many_cells_is_as_long_as_in_memory(outliers, by_tiles, tmp_path):
    """Two walls meet in a line of ten meters; what was removed may be nearest to another cell."""
    floor = RNG.uniform(0, 1, (2_400, 3)) * [10, 1, 0] + RNG.normal(0, 0.002, (2_400, 3))
    floor[::2] = floor[::2][:, [0, 2, 1]]
    X = np.round(np.vstack([floor, RNG.uniform(0, 1, (outliers, 3)) * [10, 3, 3]]), 4)
    detector = SharpFeatureDetector(16, random_state=0)
    path = written(tmp_path, X)
    values, verb, report = by_tiles(path, detector, tile_size=300)
    fitted = fit_in_memory(read_points(path).xyz, detector)
    assert report.n_tiles >= 8
    assert_array_equal(values[:, 0], fitted.scores_)
    along = X[:2_400][values[:2_400, 0] < verb.limit][:, 0]
    assert (np.histogram(along, 20, (0, 10))[0] > 0).all()


GROWING = RegionGrowing(normal_estimator=RobustNormalEstimator(16, random_state=0))


def test_small_cells_and_patches_of_regions_cross_tiles(by_tiles, monkeypatch, tmp_path):
    path, seen = written(tmp_path, make_crown_roof(4_000, random_state=0).data), []

    def divide(points, rules, begins, patch, own, last, *others, of=_tiled_division.divided):
        starts = points.index._near._whole.starts
        rows = np.flatnonzero(points.cell[:] >= 0)
        tiles = (np.searchsorted(starts, of, side="right") for of in (rows, points.cell[rows]))
        n_crossing = np.count_nonzero(np.not_equal(*tiles))
        tiles = (np.searchsorted(starts, of, side="right") for of in (begins, last[patch]))
        seen.append((n_crossing, np.count_nonzero(np.not_equal(*tiles))))
        assert_array_equal(own[begins], patch)
        return of(points, rules, begins, patch, own, last, *others)

    monkeypatch.setattr(_tiled_division, "divided", divide)
    values, _, report = by_tiles(path, GROWING, tile_size=300)
    assert_array_equal(values[:, 0], fit_in_memory(read_points(path).xyz, GROWING).labels_)
    ((n_points, n_cells),) = seen
    assert report.n_tiles > 13
    assert report.n_regions > 2
    assert n_points > 100
    assert n_cells > 20


def known_of_division(monkeypatch, module, work):
    """What is known by places when groups are sought, in an order that depends on no rows."""
    seen, of = [], module.divided

    def divide(points, rules, begins, patch, own, last, sums, borders, *others, **parts):
        xyz, patches = np.array(points.index.points[:]), points.index.points[last]
        order, rows = np.lexsort(points.index.points[begins].T), np.lexsort(xyz.T)
        pairs = np.column_stack([patches[borders[:, 0]], patches[borders[:, 1]]])
        cells = points.index.points[begins][order]
        known = cells, patch[order], np.array(own[:])[rows], patches, *sums
        seen.append((*known, pairs[np.lexsort(pairs.T)]))
        return of(points, rules, begins, patch, own, last, sums, borders, *others, **parts)

    with monkeypatch.context() as changed:
        changed.setattr(module, "divided", divide)
        work()
    return seen[0]


@pytest.mark.parametrize("rings", [1, 3])
def test_cells_patches_and_their_borders_are_those_of_memory(rings, monkeypatch, tmp_path):
    """Not only labels, which few of them decide; small blocks end amid regions."""
    monkeypatch.setattr(VoteLimits.__new__, "__defaults__", (VoteLimits().blunt, rings))
    X = np.round(make_street(4_000, outlier_share=0.03, tree=True, random_state=0).data, 4)
    path, target = written(tmp_path, X), tmp_path / "b.las"
    work = partial(fit_in_memory, read_points(path).xyz, GROWING)
    expected = known_of_division(monkeypatch, _region_division, work)
    work = partial(process_files, path, target, GROWING, tile_size=300, n_jobs=1)
    found = known_of_division(monkeypatch, _tiled_division, work)
    assert len(expected[3]) > 20
    for some, others in zip(found, expected, strict=True):
        assert_array_equal(some, others)


def test_cells_of_an_exact_plane_are_found_in_a_few_sweeps(by_tiles, monkeypatch, tmp_path):
    X, seen, finish = np.indices((50, 50, 1)).reshape(3, -1).T * 0.1, set(), CellColumns.finish
    path = written(tmp_path, X)

    def finish_and_count(columns, cell, sweep, **report):
        seen.add(sweep)
        finish(columns, cell, sweep, **report)

    monkeypatch.setattr(CellColumns, "finish", finish_and_count)
    values, _, report = by_tiles(path, GROWING, tile_size=300)
    assert_array_equal(values[:, 0], fit_in_memory(read_points(path).xyz, GROWING).labels_)
    assert report.n_tiles > 8
    assert 2 <= sum(sweep.startswith("gathered0") for sweep in seen) <= 5


def test_cells_of_regions_may_be_found_while_a_tile_asks_for_them(by_tiles, monkeypatch, tmp_path):
    """As by other processes: all other tiles gather theirs after this one has looked at them."""
    X = np.round(make_street(2_500, outlier_share=0.03, tree=True, random_state=0).data, 4)
    asking, gather, in_order = [], _tiled_division._gather, Points.in_order

    def gather_meanwhile(tile, job, level, step):
        asking.append(partial(gather, job=job, level=level, step=step))
        found = gather(tile, job, level, step)
        asking.clear()
        return found

    def in_order_when_others_have_gathered(points, rows):
        while asking:
            work = asking.pop()
            job = work.keywords["job"]
            for tile in np.flatnonzero(job.cells.counts):
                job.columns.keep(tile, "meanwhile", work(tile))
        return in_order(points, rows)

    monkeypatch.setattr(_tiled_division, "_gather", gather_meanwhile)
    monkeypatch.setattr(Points, "in_order", in_order_when_others_have_gathered)
    path = written(tmp_path, X)
    values, _, _ = by_tiles(path, GROWING, tile_size=300)
    assert_array_equal(values[:, 0], fit_in_memory(read_points(path).xyz, GROWING).labels_)


def test_parts_of_regions_that_take_more_than_the_memory_are_refused(monkeypatch, tmp_path):
    path = written(tmp_path, make_crown_roof(2_000, random_state=0).data)
    monkeypatch.setattr(_memory, "CELL_OF_REGION", 1e9)
    with pytest.raises(ValueError, match=r"small parts of regions have .* give more memory"):
        process_files(path, tmp_path / "b.las", GROWING, tile_size=500)
