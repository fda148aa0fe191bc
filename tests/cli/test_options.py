"""Options: they reach the estimators, wrong values are wrong usage, threads change nothing."""

import inspect

import numpy as np
import pytest
from typer.main import get_command

import sklearn_mcmd
from commands import done, error_line, files_in, run, usage_error
from sklearn_mcmd.cli import app
from sklearn_mcmd.io import read_points, write_points
from sklearn_mcmd.io._formats import WITH_COLUMNS

COMMANDS = {name: verb.loaded for name, verb in get_command(app).commands.items()}
ESTIMATORS = {
    "denoise": sklearn_mcmd.MCMDOutlierDetector,
    "normals": sklearn_mcmd.RobustNormalEstimator,
    "segment": sklearn_mcmd.RegionGrowing,
    "edges": sklearn_mcmd.SharpFeatureDetector,
    "plane": sklearn_mcmd.BaardaPlaneDetector,
}
# Options that stand for a parameter of the same name but have another default.
OTHER_DEFAULTS = {
    ("segment", "n_neighbors"),  # of normals; --growth-neighbors is that of growth
    ("plane", "sigma0"),
    ("plane", "surface"),
}


def test_version_is_printed():
    result = run("--version")
    assert (result.exit_code, result.stdout) == (0, f"mcmd {sklearn_mcmd.__version__}\n")


@pytest.mark.parametrize("verb", COMMANDS)
def test_every_verb_has_help(verb):
    result = done(verb, "--help")
    assert "Usage: mcmd" in result.stdout


@pytest.mark.parametrize("columns", [100, 120])
def test_the_help_of_denoise_fits_two_screens(columns, monkeypatch):
    monkeypatch.setenv("COLUMNS", str(columns))
    assert len(run("denoise", "--help").stdout.splitlines()) <= 48


@pytest.mark.parametrize("verb", ESTIMATORS)
def test_help_all_shows_the_options_that_help_leaves_out(verb):
    few, every = (run(verb, name).stdout for name in ("--help", "--help-all"))
    assert "--random-state" not in few
    options = {name for option in COMMANDS[verb].params for name in option.opts if "--" in name}
    assert [name for name in options if f"{name} " not in every] == []


@pytest.mark.parametrize("verb", ESTIMATORS)
def test_the_default_of_every_option_is_the_estimators(verb):
    parameters = inspect.signature(ESTIMATORS[verb]).parameters
    for option in COMMANDS[verb].params:
        if option.name in parameters and (verb, option.name) not in OTHER_DEFAULTS:
            default = parameters[option.name].default
            if option.name in ("random_state", "n_jobs", "orientation"):  # None in Python
                assert default is None
            elif option.default is not None:  # what None stands for is in words
                assert option.default == default


@pytest.mark.parametrize(
    ("verb", "option", "values"),
    [
        ("denoise", "--noise-scale", ["local", "-0.01", "0", "nan", "inf"]),
        ("denoise", "--n-neighbors", ["3"]),
        ("denoise", "--cutoff", ["-1", "0"]),
        ("denoise", "--false-positive-rate", ["0", "0.5"]),
        ("denoise", "--max-outlier-rate", ["1", "-0.1", "nan", "half"]),
        ("denoise", "--strictness", ["none"]),
        ("denoise", "--contamination", ["0", "0.51", "nan", "5%"]),
        ("denoise", "--ignore-class", ["a", "3,256"]),
        ("denoise", "--sensor", ["1,2", "1,2,x", "0,0,nan", "", "origin"]),
        ("denoise", "--n-jobs", ["0", "one"]),
        ("normals", "--memory", ["lots", "0GB", "-1GB"]),
        ("normals", "--n-neighbors", ["3", "12.5", "many", "nan", "-50"]),
        ("normals", "--features", ["planarity,flatness"]),
        ("normals", "--radius", ["0"]),
        ("segment", "--max-angle", ["0", "91"]),
        ("segment", "--max-distance", ["0"]),
        ("segment", "--max-gap", ["0"]),
        ("segment", "--min-region-size", ["0"]),
        ("segment", "--growth-neighbors", ["1"]),
        ("edges", "--threshold", ["0"]),
        ("edges", "--min-angle", ["0", "90"]),
        ("change", "--reach", ["0"]),
        ("change", "--alpha", ["0", "1"]),
        ("plane", "--sigma0", ["0", "-1", "nan", "5mm"]),
        ("plane", "--toward", ["2,-10", "up"]),
        ("plane", "--alpha", ["0", "1"]),
        ("plane", "--tolerance", ["0", "-1", "nan"]),
        ("info", "--columns", ["x=a,y=b,z", "a=x", "x=1,x=2,y=3"]),
    ],
)
def test_values_out_of_range_are_wrong_usage_before_a_file_is_read(verb, option, values, tmp_path):
    files = {"info": ["in.xyz"], "change": ["in.xyz", "later.xyz", tmp_path / "out.xyz"]}
    files = files.get(verb, ["in.xyz", tmp_path / "out.xyz"])
    for value in values:
        error = usage_error(run(verb, *files, f"{option}={value}"))
        assert option in error
        assert not any(word in error for word in (" None", "str among"))
    assert files_in(tmp_path) == []


RULERS = {"--cutoff": "2.8", "--false-positive-rate": "0.01", "--contamination": "0.1"}


@pytest.mark.parametrize("left_out", ["--cutoff", ""])
def test_cutoff_rate_and_contamination_exclude_each_other(left_out):
    asked = {name: value for name, value in RULERS.items() if name != left_out}
    options = [f"{name}={value}" for name, value in asked.items()]
    error = usage_error(run("denoise", "in.las", "out.las", *options))
    named = " and ".join(f"{name} {value}" for name, value in asked.items())
    assert f"{named} exclude each other: leave all but one out." in error


LENGTHS = {
    "denoise": ("--noise-scale",),
    "normals": ("--radius",),
    "segment": ("--max-distance", "--max-gap"),
    "plane": ("--sigma0", "--tolerance"),
}


@pytest.mark.parametrize(("verb", "option"), [(v, o) for v in LENGTHS for o in LENGTHS[v]])
def test_a_length_may_have_a_unit_where_that_of_the_file_is_given(verb, option):
    name = option[2:].replace("-", "_")

    def value(*options):
        return COMMANDS[verb].make_context(verb, ["in.las", "out.las", *options]).params[name]

    assert value(option, "40mm", "--unit", "m") == pytest.approx(0.04, rel=1e-15)
    assert value("--unit", "mm", option, "1 in") == pytest.approx(25.4, rel=1e-15)
    assert value(option, "4e-2") == value(option, "4e-2", "--unit", "chain") == 0.04
    for text, unit in (("40mm", ()), ("40mm", ("--unit", "chain")), ("40MM", ("--unit", "m"))):
        words = f"'{option}': {text} is no number. With a unit, it needs --unit, the unit of the"
        assert words in usage_error(run(verb, "in.las", "out.las", option, text, *unit))


def test_tiles_refuse_too_many_neighbors_before_any_work(tmp_path, small_machine):
    write_points(tmp_path / "in.las", np.random.default_rng(0).uniform(size=(5_000, 3)))
    asked = "denoise", tmp_path / "in.las", tmp_path / "out.las", "--memory", "2MB", "--n-neighbors"
    line = error_line(run(*asked, 10**6))
    assert "--n-neighbors 1000000 is more than there are points, 5,000" in line
    assert files_in(tmp_path) == ["in.las"]
    told = run(*asked, 4_000).stderr.splitlines()[-1]
    assert "2MB is too little" in told
    assert "is needed with --n-neighbors 4000" in told


def survey(path, names):
    rng = np.random.default_rng(0)
    table = np.c_[np.arange(200), rng.uniform(size=(200, 3)) * [9, 9, 0.01] + [5e6, 5e5, 90]]
    np.savetxt(path, table, fmt="%.3f", delimiter=",", header=names, comments="")
    return path


@pytest.mark.parametrize("verb", ["denoise", "plane"])
def test_coordinates_are_found_by_their_names_and_where_columns_says(verb, tmp_path):
    named = survey(tmp_path / "known.csv", "point,northing,easting,elevation")
    unknown = survey(tmp_path / "unknown.csv", "point,north of,east of,level")
    columns = ("--columns", "x=east of,y=north of,z=level")
    for out, options in (("a.csv", (named,)), ("b.csv", (unknown, *columns))):
        done(verb, *options[:1], tmp_path / out, *options[1:], "-q")
    first, second = (read_points(tmp_path / name) for name in ("a.csv", "b.csv"))
    assert (first.xyz == second.xyz).all()
    assert (first.xyz.min(axis=0) // 1 == [500_000, 5_000_000, 90]).all()
    line = error_line(run(verb, unknown, tmp_path / "c.csv"))
    assert "no x, y, z among the columns point, north of, east of, level" in line
    assert "--columns x=easting" in line


def test_info_and_view_take_columns_too(tmp_path):
    path = survey(tmp_path / "a.csv", "a,b,c,d")
    columns = ("--columns", "x=3,y=2,z=d")
    assert "  z            90.0" in run("info", path, *columns).stdout
    done("view", path, "-o", tmp_path / "a.html", *columns)


def test_columns_of_files_that_name_their_own_are_refused(source, tmp_path):
    for verb, path in (("normals", source), ("plane", source), ("normals", tmp_path)):
        line = error_line(run(verb, path, tmp_path / "out.laz", "--columns", "x=1,y=2"))
        assert f"{path}: --columns x=1,y=2 is for {WITH_COLUMNS}" in line
