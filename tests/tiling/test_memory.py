"""Plans stay within the memory."""

import numpy as np
import pytest

from sklearn_mcmd import (
    MCMDOutlierDetector,
    RegionGrowing,
    RobustNormalEstimator,
    SharpFeatureDetector,
)
from sklearn_mcmd.tiling import _run, process_files
from sklearn_mcmd.tiling._catalog import Catalog
from sklearn_mcmd.tiling._memory import PROCESS, parse_memory, plan_run, usual_memory, work_of
from sklearn_mcmd.tiling._stored_columns import CellColumns
from sklearn_mcmd.tiling._tiled_regions import TiledRegions
from tiled import street, written

SEED = {"random_state": 0}
NORMALS = RobustNormalEstimator(40, **SEED)
POSITIONS = np.array([362_000, 5_157_000, 130]) + np.linspace(0, 1, 36_000).reshape(-1, 3)


@pytest.mark.parametrize(
    ("text", "size"),
    [("2GB", 2e9), ("500 MB", 5e8), ("1.5g", 1.5e9), ("1GiB", 2**30), ("700", 700), (5e8, 5e8)],
)
def test_sizes_are_read_as_people_write_them(text, size):
    assert parse_memory(text) == size


@pytest.mark.parametrize("text", ["much", "", "-2GB", "2XB", "0GB"])
def test_what_is_no_size_is_refused(text):
    with pytest.raises(ValueError, match="write it like 2GB"):
        parse_memory(text)


def test_the_usual_memory_is_a_share_of_the_machines():
    assert 1e8 < usual_memory() < 1e14


@pytest.mark.parametrize("n_jobs", [1, 2, 64])
@pytest.mark.parametrize("memory", [1e9, 2e9, 64e9])
def test_all_processes_together_stay_within_the_memory(n_jobs, memory):
    plan = plan_run(10**9, memory, n_jobs, n_features=3)
    assert 1 <= plan.n_workers * plan.n_threads <= n_jobs
    assert plan.memory <= memory
    assert plan.n_tiles * plan.tile_size >= 10**9


def test_regions_of_many_points_need_memory_however_small_tiles_are():
    with pytest.raises(ValueError, match=r"at least 1280MB .*regions of all 100,000,000 points"):
        plan_run(10**8, 1.27e9, 4, work="regions")
    plan = plan_run(10**8, 4e9, 2, work="regions")
    assert plan.n_workers == 2
    assert plan.memory <= 4e9
    assert plan_run(10**8, 1.6e9, 2, work="regions").n_workers == 1


def test_a_table_of_regions_needs_memory_for_each_point(tmp_path):
    """Of one plane the process that makes the table holds all points."""
    with pytest.raises(ValueError, match=r"at least 13480MB .* describes the regions of all"):
        plan_run(10**8, 1e10, work=work_of("regions", table=True))
    catalog = Catalog(written(tmp_path, street(2_000).xyz))
    for table, asked in ((None, False), (tmp_path / "regions.csv", True)):
        verb = TiledRegions(RegionGrowing(16, **SEED), None, table)
        assert ("table" in verb.prepare(catalog)[0]) == asked


@pytest.mark.parametrize("work", ["outliers", "outliers, rays", "normals, auto"])
def test_a_hundred_million_points_are_judged_within_a_gigabyte(work):
    assert plan_run(10**8, 1e9, 2, work=work).memory <= 1e9


def test_too_little_memory_is_refused_with_what_is_needed():
    with pytest.raises(ValueError, match="at least 4"):
        plan_run(10**6, PROCESS, 1)


@pytest.mark.parametrize(
    ("estimator", "options"),
    [
        (NORMALS, {}),
        (RobustNormalEstimator(40, orientation="mst", **SEED), {}),
        (MCMDOutlierDetector(40, **SEED), {}),
        (MCMDOutlierDetector(40, sensor_origin=[0.0, 0.0, 5_000.0], **SEED), {}),
        (MCMDOutlierDetector(40, **SEED), {"sensor_origin": POSITIONS, "intensity": True}),
        (RegionGrowing(30, normal_estimator=NORMALS), {}),
        (SharpFeatureDetector(40, **SEED), {}),
    ],
    ids=["normals", "tree", "outliers", "rays", "positions", "regions", "edges"],
)
def test_temporary_files_take_the_disk_that_was_planned(estimator, options, tmp_path, monkeypatch):
    planned, taken, finish = [], [], CellColumns.finish

    def plan(*args, **kwargs):
        planned.append(plan_run(*args, **kwargs))
        return planned[-1]

    def finish_and_measure(*args, **kwargs):
        finish(*args, **kwargs)
        files = (tmp_path / "b.las.tiles").rglob("*.*")
        taken.append(sum(path.stat().st_size for path in files if path.is_file()))

    monkeypatch.setattr(_run, "plan_run", plan)
    monkeypatch.setattr(CellColumns, "finish", finish_and_measure)
    path, options = written(tmp_path, street(12_000)), {"tile_size": 4_000, **options}
    process_files(path, tmp_path / "b.las", estimator, **options)
    assert 0.75 * planned[0].disk < max(taken) < 1.02 * planned[0].disk
