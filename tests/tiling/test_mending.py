"""Where hardly anything was read around a tile, results are mended and equal those in memory."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial import cKDTree

from sklearn_mcmd import RobustNormalEstimator
from sklearn_mcmd.datasets import make_street
from sklearn_mcmd.io import write_points
from sklearn_mcmd.tiling import _cells, _tile, process_files
from tiled import in_memory

CORNER = np.array([362e3, 5157e3, 100.0])


@pytest.fixture
def narrow(monkeypatch):
    """Halos of few points; points mended in small groups; and coarse grids."""
    for name, value in {"SMALL": 30, "HALO": 0.0, "MENDED": 200}.items():
        monkeypatch.setattr(_tile, name, value)
    for name, value in {"VOXELS": 8, "KEPT": 300}.items():
        monkeypatch.setattr(_cells, name, value)


@pytest.mark.parametrize(
    "params",
    [
        {},
        {"neighbor_planes": False, "features": ["roughness", "mean_curvature"]},
        {"reweight": False, "radius": 0.15},
        {"radius": 0.1, "orientation": [1.0, 2.0, 3.0]},
    ],
    ids=lambda params: "-".join(params) or "default",
)
def test_mended_results_are_those_of_memory(small_file, tmp_path, narrow, params):
    estimator = RobustNormalEstimator(16, random_state=0, **params)
    expected = in_memory(small_file, tmp_path / "expected.las", estimator)
    report = process_files(small_file, tmp_path / "out.las", estimator, tile_size=2_000)
    assert report.n_proved < 0.95 * report.n_points
    assert (tmp_path / "out.las").read_bytes() == expected.read_bytes()


def test_many_outliers_are_mended(tmp_path, narrow):
    xyz = np.round(make_street(5_000, outlier_share=0.2, random_state=2).data, 2)
    write_points(tmp_path / "a.las", xyz)
    estimator = RobustNormalEstimator(12, random_state=0)
    expected = in_memory(tmp_path / "a.las", tmp_path / "expected.las", estimator)
    report = process_files(tmp_path / "a.las", tmp_path / "out.las", estimator, tile_size=1_500)
    assert report.n_proved < 0.7 * report.n_points
    assert (tmp_path / "out.las").read_bytes() == expected.read_bytes()


@pytest.mark.parametrize("k", [1, 20])
def test_searches_with_grids_find_all_neighbors(tmp_path, narrow, k):
    rng = np.random.default_rng(0)
    floor, others = rng.uniform(0, 9, (4_000, 3)) * [1, 1, 0], rng.normal(size=(200, 3))
    xyz = np.round(np.vstack([floor, others]), 3)
    writer = _cells.CellWriter(tmp_path, 1_500)
    writer.add(xyz, 0)
    cells = writer.close()
    distinct = np.unique(xyz, axis=0)
    queries = distinct[rng.choice(len(distinct), 60)]
    distances = cKDTree(distinct).query(queries, np.arange(1, k + 1))[0]
    for bounds in (np.full(60, np.inf), 2 * distances[:, -1] + 1e-9):
        found, reach = cells.neighbors(queries, k, bounds)
        again = cKDTree(found).query(queries, np.arange(1, k + 1))[0]
        assert_array_equal(again, distances)
        assert_allclose(reach, distances[:, -1], rtol=1e-9, atol=1e-300)


def test_copies_are_no_neighbors_where_voxels_are_counted(tmp_path, narrow):
    rng = np.random.default_rng(1)
    xyz = np.vstack([np.round(rng.uniform(0, 9, (300, 3)), 1), np.full((900, 3), 4.5)])
    writer = _cells.CellWriter(tmp_path, 1_000)
    writer.add(xyz, 0)
    cells = writer.close()
    distinct = np.unique(xyz, axis=0)
    distances = cKDTree(distinct).query(distinct, np.arange(1, 31))[0]
    for _ in range(2):  # the second finds the files of the first
        found, reach = cells.neighbors(distinct, 30, np.full(len(distinct), np.inf))
        assert_array_equal(cKDTree(found).query(distinct, np.arange(1, 31))[0], distances)
        assert_allclose(reach, distances[:, -1], rtol=1e-9)
    assert len(list(tmp_path.glob("*.voxels*"))) == len(cells)


@pytest.mark.parametrize("flat", [(), (2,), (1, 2)], ids=["volume", "plane", "line"])
def test_a_radius_that_voxels_bound_holds_enough_points(tmp_path, flat):
    points = np.random.default_rng(2).uniform(CORNER, CORNER + 3.0, (5_000, 3))
    points[:, flat] = 7.0
    _cells._Grid.write(tmp_path / "0.voxels", points)
    grid = _cells._Grid(tmp_path / "0.voxels")
    queries = points[::50] + 0.1
    exact = cKDTree(points).query(queries, [20])[0][:, 0]
    bounds = grid.bounds(queries, np.full(len(queries), np.inf), 20)
    assert (bounds >= exact).all()
    assert (bounds <= exact + 3 * grid.half).all()
    near = grid.near(queries, bounds)
    assert_array_equal(cKDTree(near).query(queries, [20])[0][:, 0], exact)
    assert_array_equal(grid.bounds(queries, exact, 5_001), exact)
