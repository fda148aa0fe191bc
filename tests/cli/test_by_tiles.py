"""Verbs on files larger than memory and on folders: the output of one tile is that of memory."""

import json
import re
import shutil

import numpy as np
import pytest

from commands import done, error_line, files_in, run
from sklearn_mcmd.io import PointCloud, read_points, write_points
from sklearn_mcmd.tiling import _memory, _run, _tasks
from sklearn_mcmd.tiling._memory import plan_run
from tiled import street

ONE = ("--n-jobs", 1)
TILES = ("--memory", "2MB", *ONE)
FOUND = ("removed", "marked", "judged", "regions", "inside", "largest", "edges")  # of summaries


def rows_of(result):
    assert result.exit_code == 0, result.output
    rows = [line.split() for line in result.stdout.splitlines()[1:]]
    return {row[0]: row[1:] for row in rows}


def same_by_tiles(verb, source, *options):
    """A run over a folder of one file is by tiles; one tile has the output and the summary of
    memory to the bit."""
    (source.parent / "in").mkdir()
    shutil.copy(source, source.parent / "in" / source.name)
    a, b = source.with_name(f"a{source.suffix}"), source.with_name("out")
    whole = rows_of(run(verb, source, a, *options))
    tiles = rows_of(run(verb, source.with_name("in"), b, *options, *ONE))
    assert "tiles" in tiles
    assert a.read_bytes() == (b / source.name).read_bytes()
    for name in whole.keys() & set(FOUND) - ({"removed"} if verb == "normals" else set()):
        assert whole[name] == tiles[name]
    assert not list(source.parent.glob("*.tiles"))


@pytest.mark.parametrize(
    ("verb", "options"),
    [
        ("denoise", ("--mode", "mark")),
        ("denoise", ("--contamination", 0.05, "--only-class", "1,2")),
        ("denoise", ("--intensity", "--ignore-class", 3)),
        ("normals", ("--features", "roughness,mean_curvature", "--orientation", "mst")),
        ("segment", ("--no-colors", "--growth-neighbors", 20, "--max-angle", 8)),
        ("edges", ("--n-neighbors", 16, "--no-colors")),
    ],
)
def test_one_tile_gets_the_output_that_it_has_in_memory(verb, options, source, monkeypatch):
    monkeypatch.setattr(_run, "bytes_of_point", lambda *_: 3_000.0)  # to measure it takes longer
    same_by_tiles(verb, source, *options)


def test_an_index_becomes_a_folder(source, tmp_path):
    shutil.copy(source, tmp_path / "b.laz")
    features = [{"assets": {"data": {"href": name}}} for name in ("street.laz", "b.laz")]
    (tmp_path / "drive.vpc").write_text(json.dumps({"features": features}))
    result = done("normals", tmp_path / "drive.vpc", tmp_path / "out", *ONE, "--quiet")
    assert result.stdout == ""
    assert files_in(tmp_path / "out") == ["b.laz", "street.laz"]


def test_a_tile_that_failed_has_a_line_and_restart_begins_anew(
    small_machine, source, tmp_path, monkeypatch
):
    begun, work = [], _tasks.part_of_cell

    def fail_after_the_first(*arguments):
        begun.append(arguments)
        if len(begun) > 1:
            raise MemoryError
        return work(*arguments)

    args = ("normals", source, tmp_path / "b.laz", *TILES)
    with monkeypatch.context() as patch:
        patch.setattr(_tasks, "part_of_cell", fail_after_the_first)
        result = run(*args)
    assert result.exit_code == 1
    *tiles, error = result.stderr.splitlines()
    assert all(re.match(r"mcmd: warning: tile \d+ failed", line) for line in tiles)
    n_tiles = len(tiles) + 1
    assert error.startswith(f"mcmd: error: {len(tiles)} of {n_tiles} tiles failed; ")
    rows = rows_of(run(*args, "--restart"))
    assert rows["tiles"][:4] == f"{n_tiles}, of which 0".split()
    assert "normal_x" in read_points(tmp_path / "b.laz").attributes
    assert files_in(tmp_path) == ["b.laz", "street.laz"]


def test_a_dry_run_shows_the_plan_reads_no_positions_and_writes_nothing(
    small_machine, source, tmp_path
):
    asked = ("normals", source, tmp_path / "b.laz", "--dry-run")
    result = done(*asked, *TILES)
    for words in ("3,000", "tiles", "GB for temporary files", "about 0:"):
        assert words in result.stdout
    path = ("--orientation", "sensor", "--trajectory", "path.csv")
    fits = done(*asked, *path, "--memory", "4GB")
    assert "without tiles" in fits.stdout
    assert files_in(tmp_path) == ["street.laz"]


@pytest.mark.parametrize(
    ("verb", "options"),
    [
        ("normals", ("--n-neighbors", "auto")),
        ("denoise", ("--sensor", "0,0,0", "--n-neighbors", 60)),
        ("segment", ("--n-neighbors", 60, "--regions", "table.csv")),
    ],
)
def test_a_dry_run_plans_as_the_run_does(verb, options, source, tmp_path, monkeypatch):
    plans = []

    def planned(*args, **kwargs):
        plans.append(plan_run(*args, **kwargs))
        return plans[-1]

    for module in (_memory, _run):
        monkeypatch.setattr(module, "plan_run", planned)
    monkeypatch.chdir(tmp_path)
    for more in (("--dry-run",), ()):
        done(verb, source.parent, tmp_path / "out", *options, *ONE, *more)
    assert len(plans) == 2
    assert plans[0] == plans[1]
    assert (tmp_path / "table.csv").exists() == ("table.csv" in options)


def test_sources_that_cannot_be_divided_are_told(tmp_path, source):
    line = error_line(run("normals", f"{tmp_path}/nofolder/", f"{tmp_path}/out/"))
    assert line.endswith("nofolder: no such file or folder")
    write_points(tmp_path / "a.xyz", street(300))
    line = error_line(run("denoise", tmp_path / "a.xyz", tmp_path / "b.las", "--dry-run"))
    assert "a.xyz: --dry-run is for LAS and LAZ" in line
    result = done("denoise", tmp_path / "a.xyz", tmp_path / "b.csv", "--memory", "2GB")
    assert "a.xyz: is read as a whole, whatever --memory is" in result.stderr


def test_single_precision_that_is_too_coarse_is_refused_unless_allowed(tmp_path, small_machine):
    rng = np.random.default_rng(0)
    write_points(tmp_path / "coarse.las", rng.integers(0, 40, (3_000, 3)) + 16_000_000.0)
    args = ("normals", tmp_path / "coarse.las", tmp_path / "b.las", *TILES)
    assert "single precision" in run(*args).stderr
    done(*args, "--allow-coarse")


def test_outliers_off_exact_planes_are_warned_of(small_machine, tmp_path):
    rng = np.random.default_rng(0)
    xyz = rng.uniform(0, 30, (4_000, 3)) * [1, 1, 0]
    xyz[:200, 2] = 0.6 * rng.choice([1, 2], 200)
    write_points(tmp_path / "floor.las", xyz)
    told = [
        run("denoise", tmp_path / "floor.las", tmp_path / "b.las", "--strictness", "paper", *tiles)
        for tiles in ((), TILES)
    ]
    assert "exactly in one plane" in told[0].stderr
    assert told[0].stderr == told[1].stderr


def test_a_sparse_ball_that_is_lost_before_a_dense_wall_is_told_in_memory_and_by_tiles(tmp_path):
    rng = np.random.default_rng(0)
    directions = rng.normal(size=(800, 3))
    directions *= np.cbrt(rng.random((800, 1))) / np.linalg.norm(directions, axis=1)[:, None]
    ball = [0.6, -1.5, 0.6] + 0.4 * directions  # its spacing is six times that of the wall
    wall = rng.uniform([0, 0, 0], [1.2, 0.004, 1.2], (11_000, 3))
    (tmp_path / "in").mkdir()
    path, told = tmp_path / "in" / "a.las", []
    write_points(path, PointCloud(np.vstack([wall, ball])))
    for source, name in ((path, "memory"), (path.parent, "tiles")):
        report = tmp_path / name
        target = tmp_path / ("b.las" if source == path else "out")
        result = done("denoise", source, target, "--report", report, *ONE)
        (line,) = [line for line in result.stderr.splitlines() if "together" in line]
        told.append(line.removeprefix("mcmd: warning: "))
        assert (report / "index.html").read_text().count(told[-1]) == 1
    assert told[0] == told[1]
    assert re.match(r"\d{3} outliers lie together, of \d{3} points at x 0.\d", told[0])


@pytest.mark.parametrize("name", ["", "a.las"], ids=["folder", "file"])
def test_denoising_again_warns_and_denoising_once_does_not(name, tmp_path):
    source, first, again = (tmp_path / folder for folder in ("in", "first", "again"))
    for folder in (source, first, again):
        folder.mkdir()
    write_points(source / "a.las", street(1_500))
    assert "before" not in run("denoise", source / name, first / name, *ONE).stderr
    warned = run("denoise", first / name, again / name, *ONE).stderr
    assert f"{first / 'a.las'}: outliers were removed" in warned
    done("denoise", source / name, again / name, "--mode", "mark", *ONE)
