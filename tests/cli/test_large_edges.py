"""mcmd edges on files larger than memory, and on folders."""

import shutil

import pytest

from commands import error_line, files_in, run
from sklearn_mcmd.io import read_points

ONE = ("--n-jobs", 1)


@pytest.mark.parametrize(
    "options",
    [
        ("--n-neighbors", 16, "--no-colors"),
        ("--n-neighbors", 16, "--criterion", "surface_variation", "--no-denoise"),
    ],
)
def test_a_file_larger_than_memory_gets_the_output_that_it_has_in_memory(
    options, small_machine, source, tmp_path
):
    a, b = tmp_path / "a.laz", tmp_path / "b.laz"
    in_memory = run("edges", source, a, *options)
    assert in_memory.exit_code == 0
    result = run("edges", source, b, *options, "--memory", "2MB", *ONE)
    assert result.exit_code == 0, result.output
    assert a.read_bytes() == b.read_bytes()
    assert "tiles" in result.stdout
    found = [
        line.split()
        for output in (in_memory.stdout, result.stdout)
        for line in output.splitlines()
        if line.split()[0] == "edges"
    ]
    assert len(found) == 2
    assert found[0] == found[1]
    assert files_in(tmp_path) == ["a.laz", "b.laz", "street.laz"]


def test_a_folder_becomes_a_folder(source, tmp_path):
    (tmp_path / "in").mkdir()
    for name in ("a.laz", "b.laz"):
        shutil.copy(source, tmp_path / "in" / name)
    options = ("--n-neighbors", 16, "--quiet", *ONE)
    result = run("edges", tmp_path / "in", tmp_path / "out", *options)
    assert result.exit_code == 0, result.output
    assert result.stdout == ""
    assert files_in(tmp_path / "out") == ["a.laz", "b.laz"]
    assert {"edge", "edge_score", "red"} <= read_points(
        tmp_path / "out" / "a.laz"
    ).attributes.keys()


def test_a_dry_run_shows_the_plan_and_writes_nothing(small_machine, source, tmp_path):
    result = run("edges", source, tmp_path / "b.laz", "--memory", "2MB", "--dry-run", *ONE)
    assert result.exit_code == 0, result.output
    for words in ("6,000", "tiles", "0.002 GB", "seconds"):
        assert words in result.stdout
    assert files_in(tmp_path) == ["street.laz"]


def test_too_little_memory_is_said_in_words_of_the_option(source, tmp_path):
    line = error_line(run("edges", source, tmp_path / "b.laz", "--memory", "10MB"))
    assert "--memory 10MB is too little" in line
