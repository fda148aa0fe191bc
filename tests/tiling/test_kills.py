"""Runs that end at any place go on from there: killed, or with a tile that fails."""

import os

import numpy as np
import pytest

from sklearn_mcmd import (
    MCMDOutlierDetector,
    RegionGrowing,
    RobustNormalEstimator,
    SharpFeatureDetector,
)
from sklearn_mcmd.io import PointFileError, read_points, write_points
from sklearn_mcmd.tiling import TilingError, process_files
from sklearn_mcmd.tiling._catalog import stamp_of
from sklearn_mcmd.tiling._verbs import TiledNormals
from tiled import ESTIMATOR, names_in, run_is_killed, street

OUTLIERS = MCMDOutlierDetector(16, contamination=0.05, random_state=0)
TREE = RobustNormalEstimator(16, orientation="mst", random_state=0)
REGIONS = RegionGrowing(20, normal_estimator=RobustNormalEstimator(24, random_state=0))
EDGES = SharpFeatureDetector(12, random_state=0)
HEIGHTS = {"mode": "mark", "above": -30.0, "below": 40.0, "low_groups": True}
LIGHT = {"mode": "mark", "intensity": True}
# The place at which a run is killed, after so many calls, and how many tiles are resumed then.
FAST = [
    (ESTIMATOR, {}, "_tasks.part_of_cell", 2, 2),
    (TREE, {}, "_verbs.sides_of_cells", 0, 4),
    (OUTLIERS, HEIGHTS, "_outliers.judge_groups", 0, 0),
    (REGIONS, {"regions": "r.csv"}, "_regions.write_regions", 0, 4),
    (EDGES, {}, "_files.CellResults.keep", 3, 3),
]
SLOW = [
    (ESTIMATOR, {}, "_run.WorkFolder.finish_cells", 0, 0),
    (ESTIMATOR, {}, "_base.Results.take", 0, 4),
    (ESTIMATOR, {}, "_files.write_array", 1, 1),
    (TREE, {}, "_files.CellResults.keep", 6, 4),
    (OUTLIERS, HEIGHTS, "_heights.Cells.points", 3, 0),
    (OUTLIERS, LIGHT, "_outliers.keep_light", 2, 0),
    (OUTLIERS, LIGHT, "_outliers.keep_scores", 2, 2),
    (OUTLIERS, {}, "_outliers.quantile_of", 0, 4),
    (REGIONS, {}, "_regions.join_regions", 0, 4),
    (REGIONS, {}, "_files.CellResults.keep", 6, 4),
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
    before, options = source.read_bytes(), {**options, "tile_size": 1_500, "n_jobs": 1}
    if "regions" in options:
        options["regions"] = str(tmp_path / options["regions"])
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
    process_files(small_file, tmp_path / "e.las", ESTIMATOR, tile_size=2_000)
    assert target.read_bytes() == (tmp_path / "e.las").read_bytes()


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
    process_files(small_file, tmp_path / "e.las", estimator, tile_size=2_000)
    assert (tmp_path / "out.las").read_bytes() == (tmp_path / "e.las").read_bytes()


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
    def find(verb, run, work=TiledNormals.find):
        work(verb, run)
        status, content = small_file.stat(), bytearray(small_file.read_bytes())
        content[-1] ^= 1
        small_file.write_bytes(content)
        os.utime(small_file, ns=(status.st_atime_ns, status.st_mtime_ns))

    monkeypatch.setattr(TiledNormals, "find", find)
    with pytest.raises(PointFileError, match=r"small\.las: has changed since it was read$"):
        process_files(small_file, tmp_path / "out.las", ESTIMATOR, tile_size=2_000)
    assert names_in(tmp_path) == ["small.las"]
