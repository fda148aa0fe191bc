"""Runs that end at any place go on from there: killed, with a tile that fails, amid a step."""

import os
import signal
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from sklearn.base import clone

from sklearn_mcmd import (
    MCMDOutlierDetector,
    RegionGrowing,
    RobustNormalEstimator,
    SharpFeatureDetector,
)
from sklearn_mcmd.io import PointCloud, PointFileError, read_points, write_points
from sklearn_mcmd.runtime import _interrupts
from sklearn_mcmd.segmentation._cylinder_parts import CylinderParts
from sklearn_mcmd.tiling import (
    TilingError,
    _run,
    _sweeps,
    _tiled_normals,
    _tiled_sizes,
    process_files,
)
from sklearn_mcmd.tiling._catalog import stamp_of
from sklearn_mcmd.tiling._stored_columns import ALL, CellColumns, StoredColumns
from tiled import ESTIMATOR, in_memory, names_in, run_is_killed, street

OUTLIERS = MCMDOutlierDetector(16, random_state=0)
AUTO = RobustNormalEstimator("auto", random_state=0)
REGIONS = RegionGrowing(20, normal_estimator=RobustNormalEstimator(24, random_state=0))
EDGES = SharpFeatureDetector(12, random_state=0)
MARK = {"mode": "mark"}
HEIGHTS = {"mode": "mark", "above": -30.0, "below": 40.0, "low_groups": True}
# The place at which a run is killed, after so many calls, and how many tiles are resumed then.
FAST = [
    (ESTIMATOR, {}, "_tiled_normals._fit_own", 2, 2),
    (AUTO, {}, "_tiled_normals.find_larger", 2, 0),
    (OUTLIERS, MARK, "_tiled_outliers._find_planes", 2, 2),
    (OUTLIERS, HEIGHTS, "_tiled_outliers._find_verdicts", 2, 4),
    (REGIONS, {}, "_tiled_regions._keep_planes", 2, 2),
    (REGIONS, {}, "_tiled_growing._grow", 2, 4),
    (EDGES, {}, "_tiled_normals._keep_fitted", 2, 2),
]
SLOW = [
    (ESTIMATOR, {}, "_run.WorkFolder.finish_cells", 0, 0),
    (ESTIMATOR, {}, "_result_files.Results.take", 0, 4),
    (AUTO, {}, "_tiled_normals._bend", 2, 4),
    (AUTO, {}, "_tiled_sizes.CellFinder", 9, 0),
    (OUTLIERS, MARK, "_stored_index.find_places", 2, 0),
    (OUTLIERS, MARK, "_tiled_judging._find_groups", 2, 4),
    (OUTLIERS, MARK, "_tiled_judging._judge_small", 0, 4),
    (OUTLIERS, MARK, "_tiled_judging._find_scores", 2, 4),
    (OUTLIERS, HEIGHTS, "_tiled_outliers._find_heights", 2, 0),
    (REGIONS, {}, "_tiled_growing._find_links", 2, 4),
    (REGIONS, {}, "_tiled_growing.GrownParts.write_seeds", 0, 4),
    (REGIONS, {}, "_tiled_growing._number_regions", 0, 4),
    (REGIONS, {}, "_tiled_division._find_noise", 2, 4),
    (REGIONS, {}, "_tiled_division._gather", 6, 4),
    (REGIONS, {}, "_tiled_division._find_sums", 2, 4),
    (REGIONS, {}, "_tiled_division._join_blocks", 2, 4),
    (REGIONS, {}, "_tiled_division.divided", 0, 4),
    (REGIONS, {}, "_tiled_regions.write_results_of_places", 0, 4),
    (REGIONS, {}, "_tiled_regions.finish_regions", 0, 4),
    (EDGES, {}, "_tiled_edges._find_kept", 2, 0),
    (EDGES, {}, "_tiled_edges._constants_of", 0, 0),
    (EDGES, {}, "_tiled_edges._fill", 22, 4),
]


@pytest.mark.parametrize(
    ("estimator", "options", "place", "n_calls", "n_resumed"),
    [*FAST, *(pytest.param(*case, marks=pytest.mark.slow) for case in SLOW)],
)
def test_a_run_that_was_killed_goes_on(estimator, options, place, n_calls, n_resumed, tmp_path):
    source, target, expected = (tmp_path / name for name in ("a.las", "b.las", "c.las"))
    cloud = street(5_000)
    ground = np.where(cloud.xyz[:, 2] < np.median(cloud.xyz[:, 2]), 2, 1)
    write_points(source, cloud.with_attributes(classification=ground))
    before, options = source.read_bytes(), {**options, "tile_size": 1_500}
    process_files(source, expected, estimator, **options)
    assert run_is_killed(source, target, place, n_calls, estimator, **options)
    assert not target.exists()
    report = process_files(source, target, estimator, **options)
    assert (report.n_resumed, report.n_tiles) == (n_resumed, 4)
    assert target.read_bytes() == expected.read_bytes()
    assert source.read_bytes() == before
    assert not (tmp_path / "b.las.tiles").exists()


def test_a_tile_that_fails_has_its_line_and_does_not_end_the_others(small_file, tmp_path, failing):
    target = tmp_path / "out.las"
    failing.add(1)
    with (
        pytest.warns(
            UserWarning, match=r"tile 1 failed \(x 36200\d.*, y 515\d{4}.*\): MemoryError: too m"
        ) as of,
        pytest.raises(TilingError, match=r"1 of 4 tiles failed; .*out\.las\.tiles, and"),
    ):
        process_files(small_file, target, ESTIMATOR, tile_size=2_000)
    assert [warning.filename for warning in of] == [__file__]
    assert names_in(tmp_path) == ["out.las.tiles", "small.las"]
    failing.clear()
    report = process_files(small_file, target, ESTIMATOR, tile_size=2_000)
    assert (report.n_resumed, report.n_tiles) == (3, 4)
    assert target.read_bytes() == in_memory(small_file, tmp_path / "e.las").read_bytes()


def test_a_run_along_a_tree_that_failed_goes_on(small_file, tmp_path, monkeypatch):
    estimator = RobustNormalEstimator(16, orientation="mst", random_state=0)
    expected = in_memory(small_file, tmp_path / "expected.las", estimator).read_bytes()
    with monkeypatch.context() as patch:
        patch.setattr(_tiled_normals, "signs_along", lambda *_: 1 / 0)
        with pytest.raises(TilingError, match="goes on from there"):
            process_files(small_file, tmp_path / "out.las", estimator, tile_size=2_000)
    report = process_files(small_file, tmp_path / "out.las", estimator, tile_size=2_000)
    assert report.n_resumed == report.n_tiles
    assert (tmp_path / "out.las").read_bytes() == expected


def test_a_run_that_fails_where_intensity_proves_to_tell_nothing_goes_on(tmp_path, monkeypatch):
    """It differs between copies alone, and the largest of each place are all the same."""
    source, target, expected = (tmp_path / name for name in ("a.las", "b.las", "c.las"))
    light = np.where(np.arange(3_000) < 2_950, 9, 7).astype(np.uint16)  # the last are copies
    write_points(source, PointCloud(street(3_000).xyz, {"intensity": light}))
    options, remove = {**MARK, "intensity": True, "tile_size": 1_000}, StoredColumns.remove
    process_files(source, expected, OUTLIERS, **options)

    def remove_and_fail(whole, *names):
        remove(whole, *names)
        if names == ("light",):
            raise MemoryError("enough")

    with monkeypatch.context() as patch:
        patch.setattr(StoredColumns, "remove", remove_and_fail)
        with pytest.raises(TilingError, match="enough"):
            process_files(source, target, OUTLIERS, **options)
    process_files(source, target, OUTLIERS, **options)
    assert target.read_bytes() == expected.read_bytes()


def test_planes_that_were_bent_in_part_are_found_anew(small_file, tmp_path, monkeypatch):
    """Planes are changed in place, and a run may end amid that."""
    expected = in_memory(small_file, tmp_path / "expected.las").read_bytes()
    bend, bent = _tiled_normals._bend, []

    def bend_twice(cell, job):
        bend(cell, job)
        bent.append(job.columns.read(cell, "changes"))
        bend(cell, job)
        assert_array_equal(job.columns.read(cell, "changes"), bent[-1])

    monkeypatch.setattr(_tiled_normals, "_bend", bend_twice)
    process_files(small_file, tmp_path / "out.las", ESTIMATOR, tile_size=2_000)
    assert len(bent) == 4
    assert (tmp_path / "out.las").read_bytes() == expected


def test_sizes_that_are_found_twice_are_the_same_and_leave_no_fits(tmp_path, monkeypatch):
    """As two workers do that dask gives one tile."""
    source, largest, left = tmp_path / "a.las", [], []
    X = np.random.default_rng(0).uniform(0, 4, (2_200, 3)) * [1, 1, 0]
    X[:, 2] = np.random.default_rng(1).normal(0, np.where(X[:, 0] < 2, 0.05, 0.005))
    X[1_600:] = np.random.default_rng(2).uniform(9, 12, (600, 3))  # of no surface
    write_points(source, np.round(X, 4))
    expected = in_memory(source, tmp_path / "expected.las", AUTO).read_bytes()

    def find_twice(cell, job, find=_tiled_sizes._find, **known):
        job.columns.keep(cell, "once", find(cell, job, **known))
        return find(cell, job, **known)

    def find_larger(cell, job, find=_tiled_normals.find_larger):
        largest.append(job.columns.report(ALL, "numbers")["largest"])
        left.extend(path for path in job.found.iterdir() if ".errors" in path.name)
        find(cell, job)

    monkeypatch.setattr(_tiled_sizes, "_find", find_twice)
    monkeypatch.setattr(_tiled_normals, "find_larger", find_larger)
    process_files(source, tmp_path / "out.las", AUTO, tile_size=500)
    assert (tmp_path / "out.las").read_bytes() == expected
    assert max(largest) == 256
    assert not left


@pytest.mark.filterwarnings("ignore")  # threads share their filters, and leave them in any order
@pytest.mark.skipif(os.name != "posix", reason="locks")
def test_a_tile_that_is_given_to_several_workers_is_computed_once(tmp_path, monkeypatch):
    """Two at once, and one that has lost its result: each leaves files that another needs."""
    write_points(source := tmp_path / "a.las", street(3_000))
    estimator = SharpFeatureDetector(12, normal_estimator=AUTO, random_state=0)
    options, attempt = {"tile_size": 1_000, "n_jobs": 1}, _sweeps._attempt
    process_files(source, tmp_path / "b.las", estimator, **options)

    def attempt_thrice(*given):
        with ThreadPoolExecutor(2) as pool:
            found = [task.result() for task in [pool.submit(attempt, *given) for _ in range(2)]]
        assert {*found, attempt(*given)} == {(given[1], None, None)}
        return found[0]

    monkeypatch.setattr(_sweeps, "_attempt", attempt_thrice)
    process_files(source, tmp_path / "c.las", estimator, **options)
    assert (tmp_path / "c.las").read_bytes() == (tmp_path / "b.las").read_bytes()


@pytest.mark.parametrize("change", ["parameters", "input", "replaced", "rewritten", "restart"])
def test_other_parameters_or_inputs_begin_anew(small_file, tmp_path, failing, change):
    failing.add(1)
    with pytest.warns(match="tile 1 failed"), pytest.raises(TilingError):
        process_files(small_file, tmp_path / "out.las", ESTIMATOR, tile_size=2_000)
    failing.clear()
    k = 20 if change == "parameters" else 16
    if change == "input":
        os.utime(small_file, (1, 1))
    elif change in ("replaced", "rewritten"):
        give_other_points(small_file, replace=change == "replaced")
    estimator = RobustNormalEstimator(k, random_state=0)
    options = {"tile_size": 2_000, "restart": change == "restart"}
    report = process_files(small_file, tmp_path / "out.las", estimator, **options)
    assert report.n_resumed == 0
    expected = in_memory(small_file, tmp_path / "e.las", estimator)
    assert (tmp_path / "out.las").read_bytes() == expected.read_bytes()


def give_other_points(path, replace):
    """Change the order of points in a LAS file, whose size and time are as they were."""
    cloud, before, rows = read_points(path), path.stat(), np.arange(5_000)
    stamp = stamp_of(path)
    at = slice(2_300, 2_700) if replace else slice(100)  # which the hash of its ends has, or not
    rows[at] = rows[at][::-1]
    write_points(other := path.with_suffix(".other.las"), cloud.subset(rows))
    if replace:
        other.replace(path)
    else:
        path.write_bytes(other.read_bytes())
        other.unlink()
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))
    assert stamp[:2] == stamp_of(path)[:2]
    assert (stamp == stamp_of(path)) is replace


def test_an_input_that_was_replaced_during_the_run_by_one_of_its_size_and_time_is_named(
    small_file, tmp_path, monkeypatch
):
    def find(verb, run, work=_tiled_normals.TiledNormals.find):
        work(verb, run)
        status, content = small_file.stat(), bytearray(small_file.read_bytes())
        content[-1] ^= 1
        small_file.write_bytes(content)
        os.utime(small_file, ns=(status.st_atime_ns, status.st_mtime_ns))

    monkeypatch.setattr(_tiled_normals.TiledNormals, "find", find)
    with pytest.raises(PointFileError, match=r"small\.las: has changed since it was read$"):
        process_files(small_file, tmp_path / "out.las", ESTIMATOR, tile_size=2_000)
    assert names_in(tmp_path) == ["small.las"]


def test_ctrl_c_while_temporary_files_are_removed_comes_too_late(small_file, tmp_path, monkeypatch):
    def remove_late(folder, remove=_run.WorkFolder.remove):
        signal.raise_signal(signal.SIGINT)
        remove(folder)

    monkeypatch.setattr(_interrupts, "_program", "mcmd")
    monkeypatch.setattr(_run.WorkFolder, "remove", remove_late)
    estimator = RobustNormalEstimator(method="pca", random_state=0)
    process_files(small_file, tmp_path / "out.las", estimator)
    assert names_in(tmp_path) == ["out.las", "small.las"]


def test_regions_that_were_divided_are_not_divided_again(monkeypatch, tmp_path):
    source, target = tmp_path / "a.las", tmp_path / "b.las"
    write_points(source, street(5_000))
    seen, finish, grow = [], CellColumns.finish, CylinderParts.grow

    def finish_and_note(columns, cell, sweep, **report):
        seen.append(sweep)
        finish(columns, cell, sweep, **report)

    def fail_by_tiles(parts, labels):
        if "divided" in seen:
            raise OSError("no cylinders")
        return grow(parts, labels)

    monkeypatch.setattr(CellColumns, "finish", finish_and_note)
    monkeypatch.setattr(CylinderParts, "grow", fail_by_tiles)
    with pytest.raises(TilingError, match="goes on from there"):
        process_files(source, target, REGIONS, tile_size=1_000, n_jobs=1)
    assert {"noise", "divided"} <= set(seen)
    seen.clear()
    monkeypatch.setattr(CylinderParts, "grow", grow)
    process_files(source, target, REGIONS, tile_size=1_000, n_jobs=1)
    assert "regions" in seen
    assert "noise" not in seen
    labels = clone(REGIONS).fit(read_points(source).xyz).labels_
    assert_array_equal(read_points(target).attributes["region"], labels)
