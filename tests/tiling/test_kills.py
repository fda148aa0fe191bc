"""Runs that end at any place go on from there: killed, or with a tile that fails."""

import os
import shutil

import numpy as np
import pytest

from sklearn_mcmd.io import write_points
from sklearn_mcmd.tiling import Catalog, TilingError, _catalog, process_files
from sklearn_mcmd.tiling._verbs import TiledNormals
from tiled import (
    EDGES,
    OUTLIERS,
    PCA,
    REGIONS,
    TREE,
    but,
    goes_on,
    names_in,
    run_is_killed,
    street,
)

SHARE = but(OUTLIERS, contamination=0.05)
LIGHT = {"mode": "mark", "intensity": True}
# The place at which a run is killed, after so many calls, and how many tiles are resumed then.
FAST = [
    (PCA, {}, "_tasks.part_of_cell", 2, 2),
    (TREE, {}, "_verbs.sides_of_cells", 0, 4),
    (SHARE, {"mode": "mark"}, "_outliers.quantile_of", 0, 4),
    (REGIONS, {"regions": "r.csv"}, "_regions.write_regions", 0, 4),
    (EDGES, {}, "_folder.CellResults.keep", 3, 3),
]
SLOW = [
    (PCA, {}, "_run.WorkFolder.finish_cells", 0, 0),
    (PCA, {}, "_base.Results.take", 0, 4),
    (PCA, {}, "_folder.write_array", 1, 1),
    (TREE, {}, "_folder.CellResults.keep", 6, 4),
    (SHARE, LIGHT, "_outliers.keep_light", 2, 0),
    (SHARE, LIGHT, "_outliers.keep_scores", 2, 2),
    (REGIONS, {}, "_regions.join_regions", 0, 4),
    (REGIONS, {}, "_folder.CellResults.keep", 6, 4),
]


@pytest.mark.parametrize(
    ("estimator", "options", "place", "n_calls", "n_resumed"),
    [*FAST, *(pytest.param(*case, marks=pytest.mark.slow) for case in SLOW)],
)
def test_a_run_that_was_killed_goes_on(estimator, options, place, n_calls, n_resumed, tmp_path):
    source, target, cloud = tmp_path / "a.las", tmp_path / "b.las", street(1_200)
    ground = np.where(cloud.xyz[:, 2] < np.median(cloud.xyz[:, 2]), 2, 1)
    write_points(source, cloud.with_attributes(classification=ground))
    before, options = source.read_bytes(), {**options, "tile_size": 400, "n_jobs": 1}
    if "regions" in options:
        options["regions"] = str(tmp_path / options["regions"])
    assert run_is_killed(source, target, place, n_calls, estimator, **options)
    assert not target.exists()
    report = goes_on(source, target, estimator, **options)
    assert (report.n_resumed, report.n_tiles) == (n_resumed, 4)
    assert source.read_bytes() == before


def test_a_tile_that_fails_has_its_line_and_does_not_end_the_others(small_file, tmp_path, failing):
    target, told = tmp_path / "out.las", r"x 36200\d.*, y 515\d{4}.*\): MemoryError: too much of it"
    failing.add(1)
    with (
        pytest.warns(UserWarning, match=rf"tile 1 failed \({told}") as caught,
        pytest.raises(TilingError, match=r"1 of 4 tiles failed; .*out\.las\.tiles, and"),
    ):
        process_files(small_file, target, PCA, tile_size=800)
    assert [warning.filename for warning in caught] == [__file__]
    assert names_in(tmp_path) == ["out.las.tiles", "small.las"]
    failing.clear()
    report = goes_on(small_file, target, tile_size=800)
    assert (report.n_resumed, report.n_tiles) == (3, 4)


def change_a_byte(path, at, more=b"", replace=False):
    """Of a file whose time stays as it was."""
    status, content = path.stat(), bytearray(path.read_bytes())
    content[at] ^= 1
    (other := path.with_suffix(".other")).write_bytes(content + more)
    if replace:
        other.replace(path)
    else:
        path.write_bytes(other.read_bytes())
        other.unlink()
    os.utime(path, ns=(status.st_atime_ns, status.st_mtime_ns))


@pytest.mark.parametrize("change", ["parameters", "time", "replaced", "rewritten", "restart"])
def test_other_parameters_or_inputs_begin_anew(small_file, ended, change, monkeypatch):
    monkeypatch.setattr(_catalog, "END", 2**10)
    stamps, estimator = Catalog(small_file).stamps, PCA
    if change == "parameters":
        estimator = but(PCA, n_neighbors=20)
    elif change == "time":
        os.utime(small_file, (1, 1))
    elif change == "replaced":  # what only its inode tells
        change_a_byte(small_file, stamps[0][0] // 2, replace=True)
    elif change == "rewritten":
        change_a_byte(small_file, -1)
    assert (Catalog(small_file).stamps == stamps) is (change not in ("time", "rewritten"))
    restart = change == "restart"
    assert goes_on(small_file, ended, estimator, tile_size=800, restart=restart).n_resumed == 0


@pytest.mark.parametrize("change", ["size", "content", "vanishes"])
def test_an_input_that_changes_during_the_run_is_noticed(small_file, tmp_path, monkeypatch, change):
    """Also if its size and its time are as they were. If it vanishes, what was done is kept."""
    target, before = tmp_path / "out.las", tmp_path / "before.las"

    def find(verb, run, work=TiledNormals.find):
        work(verb, run)
        small_file.rename(before)
        if change != "vanishes":
            shutil.copy2(before, small_file)
            change_a_byte(small_file, -1, bytes(change == "size"))

    gone = r"cannot be read: no such file.*kept in .*out\.las\.tiles"
    told = gone if change == "vanishes" else "has changed since it was read$"
    monkeypatch.setattr(TiledNormals, "find", find)
    with pytest.raises(ValueError, match=rf"small\.las: {told}"):
        process_files(small_file, target, PCA, tile_size=800)
    assert not target.exists()
    assert (tmp_path / "out.las.tiles").exists() == (change == "vanishes")
    monkeypatch.undo()
    before.replace(small_file)
    report = goes_on(small_file, target, tile_size=800)
    assert report.n_resumed == (report.n_tiles if change == "vanishes" else 0)
