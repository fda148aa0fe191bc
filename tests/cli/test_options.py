"""Options that several verbs share: wrong values are wrong usage, threads change nothing."""

import shutil

import numpy as np
import pytest

from commands import error_line, files_in, run
from sklearn_mcmd.io import read_points
from sklearn_mcmd.io._formats import WITH_COLUMNS
from sklearn_mcmd.tiling._folder import WorkFolder


@pytest.mark.parametrize("value", ["local", "-0.01", "0", "nan", "inf"])
def test_a_noise_scale_that_is_no_positive_number_is_wrong_usage(value, room_file, tmp_path):
    result = run("denoise", room_file, tmp_path / "out.laz", "--noise-scale", value)
    assert result.exit_code == 2
    assert "--noise-scale" in result.stderr
    assert files_in(tmp_path) == ["room.laz"]


@pytest.mark.parametrize(
    "option",
    [("--n-neighbors", 3), ("--max-outlier-rate", 1), ("--mode", "x"), ("--strictness", "none")],
)
def test_options_out_of_range_are_wrong_usage(option, room_file, tmp_path):
    result = run("denoise", room_file, tmp_path / "out.laz", *option)
    assert result.exit_code == 2
    assert option[0] in result.stderr
    assert files_in(tmp_path) == ["room.laz"]


@pytest.mark.parametrize("option", ["--radius", "--cutoff"])
@pytest.mark.parametrize("value", ["0", "-1", "nan"])
def test_numbers_that_must_be_positive_are_wrong_usage(tmp_path, option, value):
    result = run("normals", tmp_path / "in.xyz", tmp_path / "out.xyz", option, value)
    assert result.exit_code == 2
    assert option in result.stderr


def test_zero_threads_are_wrong_usage(tmp_path):
    result = run("denoise", tmp_path / "in.xyz", tmp_path / "out.xyz", "--n-jobs", "0")
    assert result.exit_code == 2


@pytest.mark.parametrize("verb", ["denoise", "normals"])
def test_the_same_seed_gives_the_same_bytes_on_any_number_of_threads(verb, room_file, tmp_path):
    for name, n_jobs in (("a", 1), ("b", 2)):
        run(verb, room_file, tmp_path / f"{name}.csv", "--n-jobs", n_jobs)
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()


def survey(path, names):
    rng = np.random.default_rng(0)
    table = np.c_[np.arange(200), rng.uniform(size=(200, 3)) * [9, 9, 0.01] + [5e6, 5e5, 90]]
    np.savetxt(path, table, fmt="%.3f", delimiter=",", header=names, comments="")
    return path


@pytest.mark.parametrize("verb", ["denoise", "normals", "edges", "segment", "plane"])
def test_coordinates_are_found_by_their_names_and_where_columns_says(verb, tmp_path):
    known = survey(tmp_path / "known.csv", "point,northing,easting,elevation")
    unknown = survey(tmp_path / "unknown.csv", "point,nord,ost,level")
    columns = ("--columns", "x=ost,y=nord,z=level")
    for out, options in (("a.csv", (known,)), ("b.csv", (unknown, *columns))):
        result = run(verb, *options[:1], tmp_path / out, *options[1:], "-q")
        assert result.exit_code == 0, result.output
    first, second = (read_points(tmp_path / name) for name in ("a.csv", "b.csv"))
    assert (first.xyz == second.xyz).all()
    assert (first.xyz.min(axis=0) // 1 == [500_000, 5_000_000, 90]).all()
    assert "point" in first.attributes
    line = error_line(run(verb, unknown, tmp_path / "c.csv"))
    assert "no x, y, z among the columns point, nord, ost, level: say which they are" in line
    assert "--columns x=easting" in line


def test_info_and_view_take_columns_too(tmp_path):
    path = survey(tmp_path / "a.csv", "a,b,c,d")
    columns = ("--columns", "x=3,y=2,z=d")
    assert "z           90.0" in run("info", path, *columns).stdout
    page = tmp_path / "a.html"
    assert run("view", path, "-o", page, *columns).exit_code == 0


@pytest.mark.parametrize("value", ["x=a,y=b,z", "a=x", "1,2,3"])
def test_columns_of_no_axes_are_wrong_usage(value, tmp_path):
    result = run("info", tmp_path / "a.csv", "--columns", value)
    assert result.exit_code == 2
    assert "--columns" in result.stderr


def test_columns_of_files_that_name_their_own_are_refused(source, tmp_path):
    out = tmp_path / "out.laz"
    for verb in ("normals", "plane"):
        line = error_line(run(verb, source, out, "--columns", "x=1,y=2"))
        assert f"street.laz: --columns x=1,y=2 is for {WITH_COLUMNS}" in line
    assert f"is for {WITH_COLUMNS}" in error_line(run("normals", tmp_path, out, "--columns", "x=1"))


@pytest.mark.parametrize("verb", ["denoise", "normals", "edges", "segment", "plane", "view"])
def test_no_clobber_keeps_what_is_there(verb, room_file, tmp_path):
    outputs = {"plane": ["a.laz", "a_report.txt", "a_report.png"], "view": ["a.html"]}
    reports = [] if verb == "view" else ["report/index.html"]
    for name in [*outputs.get(verb, ["a.laz"]), *reports]:
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_text("old")
        target = ("-o", tmp_path / "a.html") if verb == "view" else (tmp_path / "a.laz",)
        options = ("--report", tmp_path / "report") if name in reports else ()
        line = error_line(run(verb, room_file, *target, *options, "--no-clobber"))
        assert f"{path}: is there already" in line
        assert path.read_text() == "old"
        path.unlink()


def test_no_clobber_of_the_demo_keeps_an_earlier_one(tmp_path):
    (tmp_path / "clean.laz").write_text("old")
    assert "clean.laz: is there" in error_line(run("demo", tmp_path, "--force", "--no-clobber"))


def test_no_clobber_lets_a_run_go_on_and_keeps_what_others_wrote(tmp_path, source, monkeypatch):
    (tmp_path / "in").mkdir()
    for name in "ab":
        shutil.copy(source, tmp_path / "in" / f"{name}.laz")
    asked = ("normals", tmp_path / "in", tmp_path / "out", "--n-jobs", "1", "--no-clobber", "-q")
    mark = WorkFolder.mark_written

    def mark_and_end(*args):
        mark(*args)
        raise OSError("the end")

    monkeypatch.setattr(WorkFolder, "mark_written", mark_and_end)
    assert "the end" in error_line(run(*asked))
    monkeypatch.undo()
    assert files_in(tmp_path / "out") == ["a.laz"]
    (tmp_path / "out" / "b.laz").write_text("old")
    assert "b.laz: is there already" in error_line(run(*asked))
    (tmp_path / "out" / "b.laz").unlink()
    assert run(*asked).exit_code == 0
    assert files_in(tmp_path / "out") == ["a.laz", "b.laz"]
    assert "a.laz: is there already" in error_line(run(*asked))
