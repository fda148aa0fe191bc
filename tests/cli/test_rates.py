"""Rates on the command line: they reach the estimators, and wrong ones are named."""

import inspect

import numpy as np
import pytest
from typer.testing import CliRunner

from sklearn_mcmd import MCMDOutlierDetector, RegionGrowing, RobustNormalEstimator
from sklearn_mcmd.cli import _denoise, app
from sklearn_mcmd.outliers._calibration import LEAST_EXPECTED, MOST

VERBS = {
    "denoise": MCMDOutlierDetector,
    "normals": RobustNormalEstimator,
    "segment": RegionGrowing,
}


@pytest.fixture(scope="module")
def room():
    """A floor and a wall with stray points in the air."""
    rng = np.random.default_rng(0)
    floor = rng.uniform(0, 2, (450, 3)) * [1, 1, 0]
    wall = rng.uniform(0, 2, (450, 3)) * [1, 0, 1] + [0, 2, 0]
    stray = rng.uniform(0.3, 1.7, (30, 3))
    return np.vstack([np.vstack([floor, wall]) + rng.normal(0, 0.003, (900, 3)), stray])


@pytest.fixture
def room_file(tmp_path, room):
    np.save(tmp_path / "room.npy", room)
    return tmp_path / "room.npy"


def run(*args):
    return CliRunner().invoke(app, [str(a) for a in args], prog_name="mcmd")


def usage_error(result):
    """What is in the box of wrong usage, its lines joined."""
    assert result.exit_code == 2, result.output
    lines = [line.strip("│╭╮╰╯─ ") for line in result.stderr.splitlines()]
    return " ".join(" ".join(lines).split())


# ---- --false-positive-rate ------------------------------------------------------------------


@pytest.mark.parametrize("strictness", ["groups", "paper"])
def test_the_false_positive_rate_reaches_the_detector(strictness, room, room_file, tmp_path):
    result = run(
        *("denoise", room_file, tmp_path / "out.npy", "--mode", "mark"),
        *("--false-positive-rate", 0.05, "--strictness", strictness),
    )
    assert result.exit_code == 0, result.output
    form = {"strictness": None if strictness == "paper" else strictness, "random_state": 0}
    detector = MCMDOutlierDetector(false_positive_rate=0.05, **form)
    labels = detector.fit_predict(room)
    np.testing.assert_array_equal(np.load(tmp_path / "out.npy")["outlier"], labels == -1)
    usual = MCMDOutlierDetector(**form).fit_predict(room)
    assert (labels == -1).sum() > (usual == -1).sum()


@pytest.mark.parametrize("rate", ["0", "1e-5", "0.5", "-0.1", "nan", "few", "1%"])
def test_a_false_positive_rate_out_of_range_is_named_with_the_range(rate, room_file, tmp_path):
    result = run("denoise", room_file, tmp_path / "out.npy", "--false-positive-rate", rate)
    error = usage_error(result)
    assert "'--false-positive-rate'" in error
    assert f"{rate} is not a number from 0.0001 to below 0.5" in error
    assert not (tmp_path / "out.npy").exists()


def test_the_least_rate_is_what_the_simulation_resolves():
    assert LEAST_EXPECTED / MOST[True] == _denoise.LEAST_RATE
    constraint, _ = MCMDOutlierDetector._parameter_constraints["false_positive_rate"]
    assert constraint.right == _denoise.LARGEST_RATE


@pytest.mark.parametrize("share", ["0", "0.51", "-0.1", "nan", "inf", "auto", "5%"])
def test_a_contamination_out_of_range_is_named_with_the_range(share, room_file, tmp_path):
    result = run("denoise", room_file, tmp_path / "out.npy", "--contamination", share)
    error = usage_error(result)
    assert "'--contamination'" in error
    assert f"{share} is not a number above 0 and up to 0.5" in error
    assert not (tmp_path / "out.npy").exists()


RULERS = {"--cutoff": "2.8", "--false-positive-rate": "0.01", "--contamination": "0.1"}


@pytest.mark.parametrize(
    "given",
    [
        ("--cutoff", "--false-positive-rate"),
        ("--cutoff", "--contamination"),
        ("--false-positive-rate", "--contamination"),
        tuple(RULERS),
    ],
)
def test_cutoff_rate_and_contamination_exclude_each_other(given, room_file, tmp_path):
    options = [word for name in reversed(given) for word in (name, RULERS[name])]
    error = usage_error(run("denoise", room_file, tmp_path / "out.npy", *options))
    named = " and ".join(f"{name} {RULERS[name]}" for name in given)
    assert f"{named} exclude each other: leave all but one out." in error
    assert not (tmp_path / "out.npy").exists()


def test_a_rate_beyond_the_noise_of_the_planes_is_reached(room, room_file, tmp_path):
    target = tmp_path / "out.npy"
    result = run(
        *("denoise", room_file, target, "--mode", "mark", "--false-positive-rate", 0.4),
    )
    assert result.exit_code == 0, result.output
    assert 0.3 < np.load(target)["outlier"][:900].mean() < 0.5


# ---- --max-outlier-rate -------------------------------------------------------------------------


@pytest.mark.parametrize(("given", "parsed"), [("0", 0.0), ("0.99", 0.99)])
@pytest.mark.parametrize("verb", VERBS)
def test_the_ends_of_the_range_are_parsed(verb, given, parsed, room_file, tmp_path, monkeypatch):
    asked = []

    def work(self, *args, **kwargs):
        asked.append(getattr(self, "normal_estimator", self).max_outlier_rate)
        raise ValueError("enough is known")

    monkeypatch.setattr(VERBS[verb], "fit", work)
    assert run(verb, room_file, tmp_path / "out.npy", "--max-outlier-rate", given).exit_code == 1
    assert asked == [parsed]


@pytest.mark.parametrize("rate", ["1", "-0.1", "nan", "half", "auto"])
@pytest.mark.parametrize("verb", VERBS)
def test_an_outlier_rate_out_of_range_is_named_with_the_range(verb, rate, room_file, tmp_path):
    error = usage_error(run(verb, room_file, tmp_path / "out.npy", "--max-outlier-rate", rate))
    assert "'--max-outlier-rate'" in error
    assert f"{rate} is not a number from 0 to 0.99" in error
    assert not (tmp_path / "out.npy").exists()


# ---- numbers of other options, parsed in the same place -------------------------------------


@pytest.mark.parametrize(
    ("verb", "option", "value", "expected"),
    [
        ("denoise", "--cutoff", "3 sigma", "a number above 0"),
        ("denoise", "--noise-scale", "local", "a number above 0"),
        ("normals", "--radius", "inf", "a number above 0"),
        ("segment", "--max-angle", "0", "a number above 0 and up to 90"),
        ("edges", "--threshold", "0", "a number above 0"),
        ("plane", "--sigma0", "-5", "auto or a number above 0"),
        ("plane", "--alpha", "1", "a number between 0 and 1"),
    ],
)
def test_what_is_no_number_or_out_of_range_is_named(
    verb, option, value, expected, room_file, tmp_path
):
    error = usage_error(run(verb, room_file, tmp_path / "out.npy", option, value))
    assert f"'{option}'" in error
    assert f"{value} is not {expected}" in error
    assert not (tmp_path / "out.npy").exists()


def test_the_default_of_every_option_is_the_estimators():
    estimator = inspect.signature(MCMDOutlierDetector).parameters
    verb = inspect.signature(_denoise.denoise).parameters
    shared = ("contamination", "cutoff", "false_positive_rate", "noise_scale", "max_outlier_rate")
    for name in (*shared, "n_neighbors", "method", "strictness"):
        assert verb[name].default == estimator[name].default
