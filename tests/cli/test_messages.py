"""How a command ends: one clear line for users' errors, a traceback for the program's own."""

import os
import warnings

import numpy as np
import pytest

from commands import done, error_line, files_in, run
from sklearn_mcmd import MCMDOutlierDetector
from sklearn_mcmd._errors import ParameterError
from sklearn_mcmd.io import PointCloud, write_points
from sklearn_mcmd.planes import _base
from sklearn_mcmd.tiling import TilingError

# Words of the estimators that mean nothing to users of the command line.
PYTHON = ("n_samples", "n_neighbors=", "float64", "None", " X ", "n_features", "ndarray", "_rate")


@pytest.fixture
def failing(monkeypatch):
    """What makes the work of `mcmd denoise` end in an error."""

    def set_error(error):
        def fail(*args, **kwargs):
            raise error

        monkeypatch.setattr(MCMDOutlierDetector, "fit", fail)

    return set_error


@pytest.mark.parametrize(
    ("error", "code", "line"),
    [
        (MemoryError(), 1, "mcmd: error: {}: not enough memory; take fewer points or a smaller"),
        (KeyboardInterrupt(), 130, "mcmd: interrupted\n"),
        (ZeroDivisionError(), 1, ""),  # the program's own
    ],
)
def test_work_that_ends_in_an_error_keeps_the_old_file(error, code, line, failing, room_file):
    failing(error)
    before = room_file.read_bytes()
    result = run("denoise", room_file, room_file)
    assert result.exit_code == code
    assert result.stderr.startswith(line.format(room_file))
    assert isinstance(result.exception, ZeroDivisionError) == (line == "")
    assert room_file.read_bytes() == before
    assert files_in(room_file.parent) == ["room.laz"]


@pytest.mark.parametrize(
    ("verb", "option", "words"),
    [
        ("edges", ("--threshold", 30), "--threshold 30 is in spacings"),
        ("normals", ("--max-outlier-rate", 0.99), "--max-outlier-rate 0.99 in 3D asks for 9210336"),
        ("denoise", ("--false-positive-rate", 1e-5), "--false-positive-rate 1e-05 is less than"),
    ],
)
def test_values_out_of_reach_are_told_in_words_of_options(
    verb, option, words, room_file, tmp_path, monkeypatch
):
    monkeypatch.setattr(_base, "MAX_TRIALS", 100)  # to draw more takes seconds
    told = run(verb, room_file, tmp_path / "out.laz", *option).stderr
    assert words in told
    assert not any(word in told for word in PYTHON)


def test_deprecations_within_libraries_are_not_told_to_users(room_file, tmp_path, monkeypatch):
    # pyparsing's are of both kinds, and old versions of Matplotlib give them.
    class Deprecated(UserWarning, DeprecationWarning):
        pass

    fit = MCMDOutlierDetector.fit

    def warn(*args, **kwargs):
        warnings.warn("parseString is deprecated", Deprecated, stacklevel=2)
        warnings.warn("the scan is sparse", UserWarning, stacklevel=2)
        return fit(*args, **kwargs)

    monkeypatch.setattr(MCMDOutlierDetector, "fit", warn)
    result = run("denoise", room_file, tmp_path / "out.laz", "--quiet")
    assert result.stderr == "mcmd: warning: the scan is sparse\n"


@pytest.mark.parametrize("verb", ["denoise", "normals", "segment", "edges"])
def test_a_cloud_of_few_distinct_points_is_told_how_many_it_has(verb, tmp_path):
    n = 4
    X = np.random.default_rng(0).uniform(size=(n, 3))
    np.savetxt(tmp_path / "in.xyz", np.resize(X, (70, 3)))
    result = done(verb, tmp_path / "in.xyz", tmp_path / "out.xyz")
    size = 40 if verb == "edges" else 50  # the verb's own, not that of a step within
    assert f"--n-neighbors {size} is more than the number of distinct points" in result.stderr
    assert result.stderr.count("is more than") == 1
    assert f"points, {n} of 70 points:" in result.stderr
    assert not any(word in result.stderr for word in PYTHON)


def test_a_point_without_a_position_is_named_by_its_number(tmp_path):
    X = np.random.default_rng(0).uniform(size=(100, 3))
    X[7, 1] = 1e120
    np.savetxt(tmp_path / "in.xyz", X)
    line = error_line(run("denoise", tmp_path / "in.xyz", tmp_path / "out.xyz"))
    assert "in.xyz: the cloud has a coordinate beyond 1e+70 in point 8: [" in line


def test_what_a_run_repeats_of_its_cause_is_in_words_of_options(failing, room_file, tmp_path):
    cause = ParameterError("$memory=2MB is too little")
    error = TilingError(f"{cause}; what was done is kept")
    error.__cause__ = cause
    failing(error)
    line = error_line(run("denoise", room_file, tmp_path / "out.laz"))
    assert line.endswith(": --memory 2MB is too little; what was done is kept")


@pytest.mark.skipif(os.name != "posix", reason="no such names there")
@pytest.mark.parametrize("name", ["\x1b[2J\nmcmd: all is well", "\udcff", "\u202egnp", "-dash"])
def test_names_of_files_and_attributes_do_not_steer_the_terminal(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    xyz = np.random.default_rng(0).uniform(size=(300, 3)) * [1, 1, 0.01]
    write_points(f"{name}.npz", PointCloud(xyz, {"a\x1b\nb": np.arange(300)}))
    outcomes = [
        run("info", "--", f"{name}.npz"),
        run("denoise", "--report", f"{name}r", "--", f"{name}.npz", f"{name}.las"),
        run("denoise", "--", f"{name}.las", f"{name}.las"),  # a warning: done before
        run("plane", "--", f"{name}.las", f"{name}2.las"),
        run("view", "-o", f"{name}.html", "--", f"{name}.las"),
        run("info", "--", f"{name}none.npz"),
    ]
    assert [outcome.exit_code for outcome in outcomes] == [0, 0, 0, 0, 0, 1]
    for outcome in outcomes:
        assert outcome.output.replace("\n", "").isprintable()
        assert "\nmcmd: all is well" not in outcome.output
    assert outcomes[-1].stderr.count("\n") == 1
