"""Verbs on files larger than memory and on folders: the output of one tile is that of memory."""

import csv
import json
import re
import shutil

import numpy as np
import pytest

from commands import done, error_line, files_in, run
from sklearn_mcmd.io import PointCloud, read_points, write_points
from sklearn_mcmd.tiling import _memory, _run, _tasks
from sklearn_mcmd.tiling._memory import plan_run
from tiled import shining_street, street

ONE = ("--n-jobs", 1)
TILES = ("--memory", "2MB", *ONE)
FAST = {"edges": ("--n-neighbors", 16)}
RESULTS = {"denoise": "intensity", "normals": "normal_x", "segment": "region", "edges": "red"}
FOUND = ("removed", "marked", "judged", "regions", "inside", "largest", "edges")  # of summaries


def rows_of(result):
    assert result.exit_code == 0, result.output
    rows = [line.split() for line in result.stdout.splitlines()[1:]]
    return {row[0]: row[1:] for row in rows}


def same_by_tiles(verb, source, *options):
    """A run over a folder of one file is by tiles; one tile has the output and the summary of
    memory to the bit. Returns the output."""
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
    return b / source.name


@pytest.mark.parametrize(
    ("verb", "options"),
    [
        ("denoise", ("--mode", "mark")),
        ("denoise", ("--contamination", 0.05, "--strictness", "surfaces")),
        ("normals", ("--features", "roughness,mean_curvature", "--orientation", "mst")),
        ("segment", ("--no-colors", "--growth-neighbors", 20, "--max-angle", 8)),
        ("edges", ("--n-neighbors", 16, "--no-colors")),
    ],
)
def test_one_tile_gets_the_output_that_it_has_in_memory(verb, options, source):
    same_by_tiles(verb, source, *options)


@pytest.mark.parametrize("verb", RESULTS)
def test_a_file_larger_than_memory_is_worked_on_in_tiles(verb, small_machine, source, tmp_path):
    rows = rows_of(run(verb, source, tmp_path / "b.laz", *FAST.get(verb, ()), *TILES))
    assert int(rows["tiles"][0].strip(",")) > 1
    assert RESULTS[verb] in read_points(tmp_path / "b.laz").attributes
    assert files_in(tmp_path) == ["b.laz", "street.laz"]


def test_intensity_is_evidence_by_tiles_as_in_memory(tmp_path):
    """Of the points that are judged."""
    cloud, rng = shining_street(4_000), np.random.default_rng(0)
    classes = 1 + (rng.random(4_000) < 0.1)
    write_points(tmp_path / "in.las", cloud.with_attributes(classification=classes))
    options = ("--mode", "mark", "--only-class", 1, "--n-neighbors", 16)
    found = same_by_tiles("denoise", tmp_path / "in.las", "--intensity", *options)
    done("denoise", tmp_path / "in.las", tmp_path / "without.las", *options)
    assert (tmp_path / "without.las").read_bytes() != found.read_bytes()


def test_the_table_of_regions_by_one_tile_is_that_of_memory(source, tmp_path):
    """But for the digits of outlines."""
    tables = [tmp_path / f"{name}.csv" for name in ("memory", "tiles")]
    (tmp_path / "in").mkdir()
    shutil.copy(source, tmp_path / "in")
    done("segment", source, tmp_path / "a.laz", "--regions", tables[0])
    done("segment", tmp_path / "in", tmp_path / "b.laz", "--regions", tables[1], *ONE)
    rows = [list(csv.DictReader(table.read_text().splitlines())) for table in tables]
    assert len(rows[0]) == len(rows[1]) > 3
    for one, other in zip(*rows, strict=True):
        assert {**one, "outline": ""} == {**other, "outline": ""}


def test_an_index_becomes_one_file_or_a_folder(source, tmp_path):
    shutil.copy(source, tmp_path / "b.laz")
    features = [{"assets": {"data": {"href": name}}} for name in ("street.laz", "b.laz")]
    (tmp_path / "drive.vpc").write_text(json.dumps({"features": features}))
    for target in ("out.laz", "out"):
        result = done("normals", tmp_path / "drive.vpc", tmp_path / target, *ONE, "--quiet")
        assert result.stdout == ""
    assert len(read_points(tmp_path / "out.laz")) == 12_000
    assert files_in(tmp_path / "out") == ["b.laz", "street.laz"]


@pytest.mark.parametrize(
    ("verb", "options"),
    [
        ("normals", ("--orientation", "sensor", "--sensor", "auto")),
        ("normals", ("--orientation", "sensor", "--trajectory", "path.csv")),
        ("denoise", ("--sensor", "0,0,0")),
        ("segment", ()),
        ("edges", ()),
    ],
)
def test_a_dry_run_shows_the_plan_reads_no_positions_and_writes_nothing(
    verb, options, small_machine, source, tmp_path
):
    result = done(verb, source, tmp_path / "b.laz", "--dry-run", *TILES)
    for words in ("6,000", "tiles", "GB for temporary files", "seconds"):
        assert words in result.stdout
    fits = done(verb, source, tmp_path / "b.laz", *options, "--dry-run", "--memory", "4GB")
    assert "without tiles" in fits.stdout
    assert files_in(tmp_path) == ["street.laz"]


@pytest.mark.parametrize(
    ("verb", "options"),
    [
        ("normals", ("--features", "all", "--n-neighbors", "auto")),
        ("denoise", ("--sensor", "0,0,0", "--n-neighbors", 60)),
        ("segment", ()),
        ("segment", ("--n-neighbors", 60, "--regions", "table.csv")),
        ("edges", ("--n-neighbors", 60)),
    ],
)
def test_a_dry_run_plans_as_the_run_does(verb, options, source, tmp_path, monkeypatch):
    plans = []

    def planned(*args, **known):
        plans.append(plan_run(*args, **known))
        return plans[-1]

    for module in (_memory, _run):
        monkeypatch.setattr(module, "plan_run", planned)
    monkeypatch.chdir(tmp_path)
    for more in (("--dry-run",), ()):
        done(verb, source.parent, tmp_path / "out", *options, *ONE, *more)
    assert len(plans) == 2
    assert plans[0] == plans[1]


def test_too_little_memory_is_told_by_the_name_of_the_option(source, tmp_path):
    line = error_line(run("denoise", source, tmp_path / "b.laz", "--memory", "10MB"))
    assert "--memory 10MB is too little" in line


def test_sources_that_cannot_be_divided_are_told(tmp_path, source):
    line = error_line(run("normals", f"{tmp_path}/nofolder/", f"{tmp_path}/out/"))
    assert line.endswith("nofolder: no such file or folder")
    write_points(tmp_path / "a.xyz", street(300))
    line = error_line(run("denoise", tmp_path / "a.xyz", tmp_path / "b.las", "--dry-run"))
    assert "a.xyz: --dry-run is for LAS and LAZ" in line
    result = done("denoise", tmp_path / "a.xyz", tmp_path / "b.csv", "--memory", "2GB")
    assert "a.xyz: is read as a whole, whatever --memory is" in result.stderr


def test_each_tile_that_failed_has_a_line_and_the_rest_is_kept(
    small_machine, source, tmp_path, monkeypatch
):
    def fail(*_):
        raise MemoryError

    args = ("normals", source, tmp_path / "b.laz", *TILES)
    with monkeypatch.context() as patch:
        patch.setattr(_tasks, "part_of_cell", fail)
        result = run(*args)
    assert result.exit_code == 1
    *tiles, error = result.stderr.splitlines()
    assert [line.split("(")[0] for line in sorted(tiles)] == [
        f"mcmd: warning: tile {i} failed " for i in range(len(tiles))
    ]
    assert error.startswith(f"mcmd: error: {len(tiles)} of {len(tiles)} tiles failed; ")
    done(*args, "--restart")
    assert files_in(tmp_path) == ["b.laz", "street.laz"]


def test_single_precision_that_is_too_coarse_is_refused_unless_allowed(tmp_path, small_machine):
    rng = np.random.default_rng(0)
    write_points(tmp_path / "coarse.las", rng.integers(0, 60, (6_000, 3)) + 16_000_000.0)
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
        result = done("denoise", source, tmp_path / "b.las", "--report", report, *ONE)
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
