"""mcmd on files larger than memory, and on folders."""

import json
import shutil

import numpy as np
import pytest

from commands import error_line, files_in, run
from sklearn_mcmd.io import read_points, write_points
from sklearn_mcmd.tiling import _plane_sweeps
from tiled import street

ONE = ("--n-jobs", 1)


def test_a_file_larger_than_memory_gets_the_output_that_it_has_in_memory(
    small_machine, source, tmp_path
):
    a, b = tmp_path / "a.laz", tmp_path / "b.laz"
    options = ("--features", "roughness,mean_curvature", "--orientation", "up")
    assert run("normals", source, a, *options).exit_code == 0
    result = run("normals", source, b, *options, "--memory", "2MB", *ONE)
    assert result.exit_code == 0, result.output
    assert "tiles" in result.stdout
    assert a.read_bytes() == b.read_bytes()
    assert files_in(tmp_path) == ["a.laz", "b.laz", "street.laz"]


@pytest.mark.parametrize("size", ["lots", "a lot", "0GB"])
def test_what_is_no_size_of_memory_is_shown(size, source, tmp_path):
    result = run("normals", source, tmp_path / "b.laz", "--memory", size)
    assert result.exit_code == 2
    words = " ".join(result.stderr.replace("│", "").split())
    assert f"Invalid value for '--memory': '{size}' is no size: write it like 2GB" in words


def test_a_file_that_fits_into_memory_has_no_tiles(source, tmp_path):
    result = run("normals", source, tmp_path / "b.laz", "--memory", "4GB")
    assert result.exit_code == 0, result.output
    assert "tiles" not in result.stdout


def test_a_folder_becomes_a_folder(source, tmp_path):
    (tmp_path / "in").mkdir()
    for name in ("a.laz", "b.laz"):
        shutil.copy(source, tmp_path / "in" / name)
    result = run("normals", tmp_path / "in", tmp_path / "out", *ONE)
    assert result.exit_code == 0, result.output
    assert files_in(tmp_path / "out") == ["a.laz", "b.laz"]
    assert "normal_x" in read_points(tmp_path / "out" / "b.laz").attributes


def test_a_folder_that_is_missing_is_said(tmp_path):
    line = error_line(run("normals", f"{tmp_path}/nofolder/", f"{tmp_path}/out/"))
    assert line.endswith("nofolder: no such file or folder")


def test_an_index_becomes_one_file_or_a_folder(source, tmp_path):
    shutil.copy(source, tmp_path / "b.laz")
    features = [{"assets": {"data": {"href": name}}} for name in ("street.laz", "b.laz")]
    (tmp_path / "drive.vpc").write_text(json.dumps({"features": features}))
    for target in ("out.laz", "out"):
        result = run("normals", tmp_path / "drive.vpc", tmp_path / target, *ONE)
        assert result.exit_code == 0, result.output
    assert len(read_points(tmp_path / "out.laz")) == 12_000
    assert files_in(tmp_path / "out") == ["b.laz", "street.laz"]


def test_a_dry_run_shows_the_plan_and_writes_nothing(small_machine, source, tmp_path):
    result = run("normals", source, tmp_path / "b.laz", "--memory", "2MB", "--dry-run", *ONE)
    assert result.exit_code == 0, result.output
    for words in ("6,000", "about 3 of at most 3,076 points", "0.002 GB", "seconds"):
        assert words in result.stdout
    assert files_in(tmp_path) == ["street.laz"]


def test_a_dry_run_of_what_fits_into_memory_says_so(source, tmp_path):
    result = run("normals", source, tmp_path / "b.laz", "--memory", "4GB", "--dry-run")
    assert "without tiles" in result.stdout
    assert files_in(tmp_path) == ["street.laz"]


@pytest.mark.parametrize("options", [("--sensor", "auto"), ("--trajectory", "path.csv")])
def test_a_dry_run_reads_no_positions(options, source, tmp_path):
    asked = ("--memory", "4GB", "--orientation", "sensor", *options, "--dry-run")
    result = run("normals", source, tmp_path / "b.laz", *asked)
    assert result.exit_code == 0, result.output


def test_normals_look_along_a_trajectory_by_tiles_too(small_machine, source, tmp_path):
    cloud = read_points(source)
    times = np.linspace(10, 20, len(cloud))
    write_points(tmp_path / "in.laz", cloud.with_attributes(gps_time=times))
    path = "time,x,y,z\n10,362000,5157002,101\n20,362009,5157002,101\n"
    (tmp_path / "path.csv").write_text(path)
    asked = ("--orientation", "sensor", "--trajectory", tmp_path / "path.csv")
    a, b = tmp_path / "a.laz", tmp_path / "b.laz"
    assert run("normals", tmp_path / "in.laz", a, *asked).exit_code == 0
    result = run("normals", tmp_path / "in.laz", b, *asked, "--memory", "2MB", *ONE)
    assert result.exit_code == 0, result.output
    assert "tiles" in result.stdout
    assert a.read_bytes() == b.read_bytes()


def test_a_file_that_tells_no_position_is_named_by_tiles_too(small_machine, source, tmp_path):
    asked = ("--memory", "2MB", "--orientation", "sensor", "--sensor", "auto", *ONE)
    line = error_line(run("normals", source, tmp_path / "b.laz", *asked))
    assert f"{source.name}: no position of the sensor is known" in line
    assert files_in(tmp_path) == ["street.laz"]


def test_records_beyond_those_that_a_header_counts_are_told_once(small_machine, tmp_path):
    write_points(tmp_path / "in.las", street(8_000).xyz)
    raw = bytearray((tmp_path / "in.las").read_bytes())
    raw[247:255] = (7_000).to_bytes(8, "little")
    (tmp_path / "in.las").write_bytes(raw)
    for verb in (["info"], ["normals"], ["normals", "--memory", "2MB", *ONE]):
        target = [tmp_path / "out.las"] * (verb != ["info"])
        result = run(verb[0], tmp_path / "in.las", *target, *verb[1:])
        assert result.exit_code == 0, result.output
        assert result.stderr.count("in.las: holds 1,000 records more than its header counts") == 1
        assert ("tiles" in result.stdout) == ("2MB" in verb)


@pytest.mark.parametrize("verb", ["denoise", "normals", "segment", "edges"])
def test_rays_without_a_return_are_left_out_by_tiles_too(small_machine, tmp_path, verb):
    xyz = street(8_000).xyz
    xyz = np.round(xyz - xyz.mean(axis=0), 3)
    xyz[::4] = 0.0
    write_points(tmp_path / "in.las", xyz)
    a, b = tmp_path / "a.las", tmp_path / "b.las"
    for target, options in ((a, ()), (b, ("--memory", "2MB", *ONE))):
        result = run(verb, tmp_path / "in.las", target, *options)
        assert result.exit_code == 0, result.output
        assert "2,000 of 8,000 points are 0, 0, 0, the first is point 1" in result.stderr
        assert result.stderr.count("left out") == 1
        assert ("tiles" in result.stdout) == (target == b)
    assert a.read_bytes() == b.read_bytes()
    assert 5_500 < len(read_points(a)) <= 6_000


def test_sizes_of_neighborhoods_are_found_by_tiles_too(small_machine, source, tmp_path):
    a, b = tmp_path / "a.laz", tmp_path / "b.laz"
    assert run("normals", source, a, "--n-neighbors", "auto").exit_code == 0
    result = run("normals", source, b, "--n-neighbors", "auto", "--memory", "2MB", *ONE)
    assert result.exit_code == 0, result.output
    assert "tiles" in result.stdout
    assert a.read_bytes() == b.read_bytes()


def test_too_little_memory_is_said_in_words_of_the_option(source, tmp_path):
    line = error_line(run("normals", source, tmp_path / "b.laz", "--memory", "10MB"))
    assert "--memory 10MB is too little" in line


@pytest.mark.parametrize("size", ["much", "0GB", "-1GB"])
def test_a_wrong_size_is_wrong_usage(source, tmp_path, size):
    result = run("normals", source, tmp_path / "b.laz", f"--memory={size}")
    assert result.exit_code == 2
    assert "2GB" in result.stderr


def test_each_tile_that_failed_has_a_line_and_the_rest_is_kept(
    small_machine, source, tmp_path, monkeypatch
):
    def fail(cell, job):
        raise MemoryError

    with monkeypatch.context() as patch:
        patch.setattr(_plane_sweeps, "_fit_own", fail)
        args = ("normals", source, tmp_path / "b.laz", "--memory", "2MB", *ONE)
        result = run(*args)
    assert result.exit_code == 1
    *tiles, error = result.stderr.splitlines()
    assert [line.split("(")[0] for line in sorted(tiles)] == [
        f"mcmd: warning: tile {i} failed " for i in range(len(tiles))
    ]
    assert error.startswith(f"mcmd: error: {len(tiles)} of {len(tiles)} tiles failed; ")
    assert "b.laz.tiles" in error
    assert run(*args, "--restart").exit_code == 0
    assert files_in(tmp_path) == ["b.laz", "street.laz"]


def test_single_precision_that_is_too_coarse_is_refused_unless_allowed(tmp_path, small_machine):
    rng = np.random.default_rng(0)
    write_points(tmp_path / "coarse.las", rng.integers(0, 60, (6_000, 3)) + 16_000_000.0)
    args = ("normals", tmp_path / "coarse.las", tmp_path / "b.las", *ONE)
    in_memory = error_line(run(*args))
    assert "single precision" in in_memory
    assert "single precision" in run(*args, "--memory", "2MB").stderr
    assert run(*args, "--memory", "2MB", "--allow-coarse").exit_code == 0


def test_a_memory_of_bytes_and_one_that_text_cannot_heed_are_told(tmp_path):
    folder = tmp_path / "in"
    folder.mkdir()
    write_points(folder / "a.las", street(300))
    line = error_line(run("denoise", folder, tmp_path / "b.las", "--memory", 4))
    assert "--memory 4 bytes is too little: at least 430MB is needed" in line
    write_points(tmp_path / "a.csv", street(300))
    result = run("denoise", tmp_path / "a.csv", tmp_path / "b.csv", "--memory", "2GB")
    assert result.exit_code == 0
    assert "a.csv: is read as a whole, whatever --memory is" in result.stderr
