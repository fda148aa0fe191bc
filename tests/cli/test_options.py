"""Options that several verbs share: wrong values are wrong usage, threads change nothing."""

import shutil

import numpy as np
import pytest
from typer.main import get_command

from commands import error_line, files_in, run
from sklearn_mcmd.cli import app
from sklearn_mcmd.io import PointCloud, read_points, write_points
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


LENGTHS = {
    "denoise": ("--noise-scale", "--above", "--below"),
    "normals": ("--radius",),
    "segment": ("--max-distance", "--max-gap"),
    "plane": ("--sigma0", "--tolerance"),
    "plan": ("--sigma0", "--width", "--height"),
}


@pytest.mark.parametrize(("verb", "option"), [(v, o) for v in LENGTHS for o in LENGTHS[v]])
def test_a_length_may_have_a_unit_where_that_of_the_file_is_given(verb, option):
    files = [] if verb == "plan" else ["in.las", "out.las"]
    name = option[2:].replace("-", "_")

    def value(*options):
        command = get_command(app).commands[verb]
        return command.make_context(verb, [*files, *options]).params[name]

    assert value(option, "40mm", "--unit", "m") == pytest.approx(0.04, rel=1e-15)
    assert value("--unit", "mm", option, "1 in") == pytest.approx(25.4, rel=1e-15)
    assert value(option, "4e-2") == value(option, "4e-2", "--unit", "chain") == 0.04
    for text, unit, words in (
        ("40mm", (), "40mm: say the unit of the file as well, such as --unit m"),
        ("40mm", ("--unit", "chain"), "40mm is no number. With a unit, it needs --unit"),
        ("40chain", (), "40chain is no number. With a unit, it needs --unit"),
    ):
        result = run(verb, *files, option, text, *unit)
        assert result.exit_code == 2
        told = " ".join(result.stderr.replace("│", "").split())
        assert f"'{option}': {words}" in told


@pytest.mark.parametrize("unit", [(), ("--unit", "m")])
@pytest.mark.parametrize(
    ("option", "words"), [("--sigma0", "auto or a number above 0"), ("--tolerance", "a number abo")]
)
def test_the_sign_of_a_length_is_its_fault_whatever_the_unit(option, words, unit):
    result = run("plane", "in.las", "out.las", option, "-4mm", *unit)
    assert result.exit_code == 2
    assert f"'{option}': -4 is not {words}" in " ".join(result.stderr.replace("│", "").split())


def test_a_height_may_lie_below_the_ground_and_is_finite(tmp_path):
    command = get_command(app).commands["denoise"]
    context = command.make_context("a", ["a.las", "b.las", "--below", "-50cm", "--unit", "m"])
    assert context.params["below"] == -0.5
    result = run("denoise", "a.las", "b.las", "--above", "nan")
    assert result.exit_code == 2
    assert "nan is not a height, such as 2.0" in " ".join(result.stderr.split())


@pytest.mark.parametrize(
    ("verb", "option"),
    [
        *((verb, "--n-neighbors") for verb in ("denoise", "normals", "segment", "edges")),
        ("segment", "--growth-neighbors"),
    ],
)
def test_far_more_neighbors_than_points_are_refused_by_the_name_of_the_option(
    verb, option, tmp_path
):
    path = tmp_path / "in.npy"
    np.save(path, np.random.default_rng(0).uniform(size=(5_000, 3)))
    line = error_line(run(verb, path, tmp_path / "out.npy", option, 10**6))
    assert f"in.npy: {option} 1000000 is more than there are points, 5,000" in line


@pytest.mark.parametrize("verb", ["denoise", "normals", "segment", "edges"])
def test_tiles_refuse_too_many_neighbors_before_any_work(verb, tmp_path, small_machine):
    cloud = PointCloud(np.random.default_rng(0).uniform(size=(5_000, 3)))
    write_points(tmp_path / "in.las", cloud)
    asked = verb, tmp_path / "in.las", tmp_path / "out.las", "--memory", "2MB", "--n-neighbors"
    line = error_line(run(*asked, 10**6))
    assert "--n-neighbors 1000000 is more than there are points, 5,000" in line
    assert files_in(tmp_path) == ["in.las"]
    told = run(*asked, 4_000).stderr.splitlines()
    assert "2MB is too little" in told[-1]
    assert "is needed with --n-neighbors 4000" in told[-1]
    assert [line for line in told[:-1] if "compiling" not in line] == [
        "mcmd: warning: --n-neighbors 4000 takes at least 6,400 times as long as 50."
    ] * (verb == "edges")


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
    unknown = survey(tmp_path / "unknown.csv", "point,north of,east of,level")
    columns = ("--columns", "x=east of,y=north of,z=level")
    for out, options in (("a.csv", (known,)), ("b.csv", (unknown, *columns))):
        result = run(verb, *options[:1], tmp_path / out, *options[1:], "-q")
        assert result.exit_code == 0, result.output
    first, second = (read_points(tmp_path / name) for name in ("a.csv", "b.csv"))
    assert (first.xyz == second.xyz).all()
    assert (first.xyz.min(axis=0) // 1 == [500_000, 5_000_000, 90]).all()
    assert "point" in first.attributes
    line = error_line(run(verb, unknown, tmp_path / "c.csv"))
    assert (
        "no x, y, z among the columns point, north of, east of, level: say which they are" in line
    )
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
