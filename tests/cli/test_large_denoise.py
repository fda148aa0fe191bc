"""mcmd denoise on files larger than memory, and on folders."""

import re
import shutil

import numpy as np
import pytest

from commands import error_line, files_in, run
from sklearn_mcmd.io import PointCloud, read_points, write_points
from tiled import street

ONE = ("--n-jobs", 1)


@pytest.mark.parametrize(
    "options",
    [
        ("--mode", "mark"),
        ("--contamination", 0.05, "--strictness", "surfaces"),
        ("--false-positive-rate", 0.02),
        ("--strictness", "paper", "--n-neighbors", 20),
    ],
)
def test_a_file_larger_than_memory_gets_the_output_that_it_has_in_memory(
    options, small_machine, source, tmp_path
):
    a, b = tmp_path / "a.laz", tmp_path / "b.laz"
    in_memory = run("denoise", source, a, *options)
    assert in_memory.exit_code == 0
    result = run("denoise", source, b, *options, "--memory", "2MB", *ONE)
    assert result.exit_code == 0, result.output
    assert a.read_bytes() == b.read_bytes()
    assert "tiles" in result.stdout
    found = [
        line
        for output in (in_memory.stdout, result.stdout)
        for line in output.splitlines()
        if line.split()[0] in ("removed", "marked")
    ]
    assert len(found) == 2
    assert found[0].split() == found[1].split()
    assert files_in(tmp_path) == ["a.laz", "b.laz", "street.laz"]


def test_a_folder_becomes_a_folder(source, tmp_path):
    (tmp_path / "in").mkdir()
    for name in ("a.laz", "b.laz"):
        shutil.copy(source, tmp_path / "in" / name)
    result = run("denoise", tmp_path / "in", tmp_path / "out", *ONE, "--quiet")
    assert result.exit_code == 0, result.output
    assert result.stdout == ""
    assert files_in(tmp_path / "out") == ["a.laz", "b.laz"]
    assert 5_000 < len(read_points(tmp_path / "out" / "a.laz")) < 6_000


def test_a_dry_run_shows_the_plan_and_writes_nothing(small_machine, source, tmp_path):
    result = run("denoise", source, tmp_path / "b.laz", "--memory", "2MB", "--dry-run", *ONE)
    assert result.exit_code == 0, result.output
    for words in ("6,000", "tiles", "0.002 GB", "seconds"):
        assert words in result.stdout
    assert files_in(tmp_path) == ["street.laz"]


def test_a_dry_run_of_another_format_is_refused(tmp_path):
    write_points(tmp_path / "a.xyz", street(50))
    line = error_line(run("denoise", tmp_path / "a.xyz", tmp_path / "b.las", "--dry-run"))
    assert "a.xyz: --dry-run is for LAS and LAZ" in line


def test_rates_that_exclude_each_other_are_wrong_usage_of_large_files_too(source, tmp_path):
    options = ("--memory", "2MB", "--cutoff", 3, "--contamination", 0.1)
    assert run("denoise", source, tmp_path / "b.laz", *options).exit_code == 2


def test_outliers_off_exact_planes_are_warned_of(small_machine, tmp_path):
    rng = np.random.default_rng(0)
    floor = np.round(rng.uniform(0, 30, (4_000, 3)), 3) * [1, 1, 0]
    floor[:200, 2] = 0.6 * rng.choice([1, 2], 200)
    write_points(tmp_path / "floor.las", floor)
    options = ("--strictness", "paper", "--memory", "2MB", *ONE)
    result = run("denoise", tmp_path / "floor.las", tmp_path / "b.las", *options)
    assert result.exit_code == 0, result.output
    in_memory = run("denoise", tmp_path / "floor.las", tmp_path / "c.las", *options[:2])
    assert in_memory.stderr == result.stderr


def test_too_little_memory_is_said_in_words_of_the_option(source, tmp_path):
    line = error_line(run("denoise", source, tmp_path / "b.laz", "--memory", "10MB"))
    assert "--memory 10MB is too little" in line


def test_a_sparse_ball_that_is_lost_before_a_dense_wall_is_told_in_memory_and_by_tiles(tmp_path):
    rng = np.random.default_rng(0)
    directions = rng.normal(size=(800, 3))
    directions *= np.cbrt(rng.random((800, 1))) / np.linalg.norm(directions, axis=1)[:, None]
    ball = [0.6, -1.5, 0.6] + 0.4 * directions  # its spacing is six times that of the wall
    wall = rng.uniform([0, 0, 0], [1.2, 0.004, 1.2], (11_000, 3))
    (tmp_path / "in").mkdir()
    path, out, told = tmp_path / "in" / "a.las", tmp_path / "b.las", []
    write_points(path, PointCloud(np.vstack([wall, ball])))
    for source, name in ((path, "memory"), (path.parent, "tiles")):
        report = tmp_path / name
        result = run("denoise", source, out, "--report", report, *ONE)
        assert result.exit_code == 0, result.output
        (line,) = [line for line in result.stderr.splitlines() if "together" in line]
        told.append(line)
        page = (report / "index.html").read_text()
        assert page.count(line[len("mcmd: warning: ") :]) == 1
    assert told[0] == told[1]
    assert re.match(
        r"mcmd: warning: \d{3} outliers lie together, of \d{3} points at x 0.\d", told[0]
    )
    kept = run("denoise", path, out, "--keep", "surfaces")
    assert "together" not in kept.stderr  # which is to take all that is no surface


@pytest.mark.parametrize("extension", ["las", "laz", "ply", "folder"])
def test_denoising_again_warns_and_denoising_once_does_not(extension, tmp_path):
    if extension == "ply":
        pytest.importorskip("plyfile")
    suffix = "las" if extension == "folder" else extension
    source = tmp_path / "in"
    source.mkdir()
    write_points(source / f"a.{suffix}", street(1500))
    first, again = tmp_path / "first", tmp_path / "again"
    if extension != "folder":
        source, first, again = (
            path.with_suffix(f".{suffix}") for path in (source / "a", first, again)
        )
    once = run("denoise", source, first, *ONE)
    assert once.exit_code == 0, once.output
    assert "before" not in once.stderr
    twice = run("denoise", first, again, *ONE)
    assert twice.exit_code == 0, twice.output
    assert f"first{'/a.las' if extension == 'folder' else '.' + suffix}: outliers were removed" in (
        twice.stderr
    )
    marked = run("denoise", source, again, "--mode", "mark", *ONE)
    assert marked.exit_code == 0  # which removes nothing
