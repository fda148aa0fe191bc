"""What estimators say is said again in the words of the command line."""

import numpy as np
import pytest

from commands import error_line, run
from sklearn_mcmd.cli._wording import in_words_of_options


@pytest.mark.parametrize(
    ("said", "heard"),
    [
        ("n_neighbors=50 is too few", "--n-neighbors 50 is too few"),
        ("use surface='orthogonal'.", "use --surface orthogonal."),
        ("Check sigma0=0.5 against", "Check --sigma0 0.5 against"),
        ("raise n_neighbors.", "raise --n-neighbors."),
        (
            "n_samples=1 is too few to test a plane in 3D: at least 4",
            "too few points to test a plane (1): at least 4",
        ),
        (
            "X has 3 distinct point(s) in n_samples=9, which is too few to test a plane in 3D: at",
            "too few distinct points to test a plane (3 of 9): at",
        ),
        ("The 500 points of X lie on one line", "the 500 points lie on one line"),
        ("--n-neighbors 5 of a file", "--n-neighbors 5 of a file"),
        ("/data/n_neighbors=5/in.laz: no such file", "/data/n_neighbors=5/in.laz: no such file"),
    ],
)
def test_parameters_are_named_as_options(said, heard):
    assert in_words_of_options(said) == heard


PYTHON = ("n_samples", "n_neighbors=", "float64", "None", " X ", "n_features", "ndarray", "_rate")


@pytest.mark.parametrize("verb", ["denoise", "normals", "segment", "edges"])
@pytest.mark.parametrize("n", [1, 4, 30])
def test_a_cloud_of_few_distinct_points_is_told_how_many_it_has(verb, n, tmp_path):
    X = np.random.default_rng(0).uniform(size=(n, 3))
    np.savetxt(tmp_path / "in.xyz", np.resize(X, (70, 3)))
    result = run(verb, tmp_path / "in.xyz", tmp_path / "out.xyz")
    assert result.exit_code == 0, result.output
    points = "point," if n == 1 else "points,"
    assert f"only {n} distinct {points}" in result.stderr
    assert not any(word in result.stderr for word in PYTHON)


def test_values_out_of_reach_are_refused_in_words_of_options(room_file, tmp_path):
    line = error_line(run("edges", room_file, tmp_path / "out.laz", "--threshold", 30))
    assert "--threshold 30 is in spacings" in line
    assert not any(word in line for word in PYTHON)


def test_a_point_without_a_position_is_named_by_its_number(tmp_path):
    X = np.random.default_rng(0).uniform(size=(100, 3))
    X[7, 1] = 1e120
    np.savetxt(tmp_path / "in.xyz", X)
    line = error_line(run("denoise", tmp_path / "in.xyz", tmp_path / "out.xyz"))
    assert "in.xyz: point 8 has a coordinate beyond 1e+100" in line


def test_more_trials_than_are_made_are_told_of_the_option(room_file, tmp_path):
    result = run("normals", room_file, tmp_path / "out.laz", "--max-outlier-rate", 0.99)
    assert result.exit_code == 0
    assert "--max-outlier-rate 0.99 asks for 9210336 trials; 10000 are made" in result.stderr
    assert not any(word in result.stderr for word in PYTHON)
