"""mcmd segment on files larger than memory, and on folders."""

import shutil

import pytest

from commands import error_line, files_in, run
from sklearn_mcmd.io import read_points

ONE = ("--n-jobs", 1)


@pytest.mark.parametrize(
    "options",
    [(), ("--no-colors", "--growth-neighbors", 20, "--max-angle", 8, "--no-refine")],
)
def test_a_file_larger_than_memory_gets_the_output_that_it_has_in_memory(
    options, small_machine, source, tmp_path
):
    a, b = tmp_path / "a.laz", tmp_path / "b.laz"
    in_memory = run("segment", source, a, *options)
    assert in_memory.exit_code == 0, in_memory.output
    result = run("segment", source, b, *options, "--memory", "2MB", *ONE)
    assert result.exit_code == 0, result.output
    assert a.read_bytes() == b.read_bytes()
    found = [
        [line.split() for line in output.splitlines() if line.split()[0] in words]
        for output in (in_memory.stdout, result.stdout)
        for words in [("regions", "inside", "largest")]
    ]
    assert len(found[0]) == 3
    assert found[0] == found[1]
    assert files_in(tmp_path) == ["a.laz", "b.laz", "street.laz"]


def test_a_folder_becomes_a_folder(source, tmp_path):
    (tmp_path / "in").mkdir()
    for name in ("a.laz", "b.laz"):
        shutil.copy(source, tmp_path / "in" / name)
    result = run("segment", tmp_path / "in", tmp_path / "out", *ONE, "--quiet")
    assert result.exit_code == 0, result.output
    assert result.stdout == ""
    assert files_in(tmp_path / "out") == ["a.laz", "b.laz"]
    assert "region" in read_points(tmp_path / "out" / "a.laz").attributes


def test_a_dry_run_shows_the_plan_and_writes_nothing(small_machine, source, tmp_path):
    result = run("segment", source, tmp_path / "b.laz", "--memory", "2MB", "--dry-run", *ONE)
    assert result.exit_code == 0, result.output
    for words in ("6,000", "tiles", "GB for temporary files", "seconds"):
        assert words in result.stdout
    assert files_in(tmp_path) == ["street.laz"]


def test_too_little_memory_is_said_in_words_of_the_option(source, tmp_path):
    line = error_line(run("segment", source, tmp_path / "b.laz", "--memory", "10MB"))
    assert "--memory 10MB is too little" in line


def test_a_table_of_regions_is_for_clouds_in_memory(small_machine, source, tmp_path):
    options = ("--memory", "2MB", *ONE, "--regions", tmp_path / "r.csv")
    result = run("segment", source, tmp_path / "b.laz", *options)
    assert result.exit_code != 0
    assert "for clouds in memory" in " ".join(result.output.split())
    assert files_in(tmp_path) == ["street.laz"]
