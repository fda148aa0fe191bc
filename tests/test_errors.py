"""Errors name parameters, and whoever shows them may have other names for them."""

import pickle
import re
from pathlib import Path

import numpy as np
import pytest
import typer

import sklearn_mcmd
from sklearn_mcmd import (
    MCMDOutlierDetector,
    RegionGrowing,
    RobustNormalEstimator,
    SharpFeatureDetector,
)
from sklearn_mcmd._errors import ParameterError, ParameterWarning, counted
from sklearn_mcmd.cli import app

TOO_FEW = ParameterError("$n_samples is less than $n_neighbors=4: lower $n_neighbors.", n_samples=2)


def test_an_error_and_its_copy_from_another_process_have_names_of_parameters():
    for error in (TOO_FEW, pickle.loads(pickle.dumps(TOO_FEW))):
        assert str(error) == "n_samples=2 is less than n_neighbors=4: lower n_neighbors."
        assert isinstance(error, ValueError)


def test_names_and_fields_are_worded_by_whoever_shows_them():
    words = TOO_FEW.worded(lambda name, value: f"<{name}{value or ''}>")
    assert words == "<n_samples2> is less than <n_neighbors=>4: lower <n_neighbors>."


def test_a_message_may_have_signs_that_are_no_names():
    assert str(ParameterWarning("5 % or 3 $ of $row", row=7)) == "5 % or 3 $ of row 7"


def test_one_thing_is_no_plural():
    assert [counted(n, "point") for n in (0, 1, 2, 3000)] == [
        "0 points", "1 point", "2 points", "3,000 points",
    ]  # fmt: skip


def test_no_message_leaves_the_plural_open():
    paths = Path(sklearn_mcmd.__file__).parent.rglob("*.py")
    assert not [path for path in paths if re.search(r"\w\(e?s\)[ ;,:.]", path.read_text("utf-8"))]


def test_parameters_in_messages_are_options_of_a_verb():
    verbs = typer.main.get_command(app).commands.values()
    options = {option for verb in verbs for param in verb.params for option in param.opts}
    package = Path(sklearn_mcmd.__file__).parent
    sources = [path.read_text(encoding="utf-8") for path in package.rglob("*.py")]
    named = {
        name
        for source in sources
        if "_errors import" in source
        for name in re.findall(r"\$(\w+)", source)
    }
    fields = {"X", "n_samples", "row", "sensor_origin"}
    assert fields < named
    assert {f"--{name.replace('_', '-')}" for name in named - fields} <= options


@pytest.mark.parametrize(
    "estimator",
    [
        MCMDOutlierDetector(random_state=0),
        RobustNormalEstimator(random_state=0),
        RegionGrowing(random_state=0),
        SharpFeatureDetector(outlier_detector="passthrough", random_state=0),
    ],
)
@pytest.mark.parametrize("method", ["fit", "fit_predict", "fit_transform"])
def test_warnings_point_at_the_line_that_called(estimator, method):
    if not hasattr(estimator, method):
        pytest.skip(f"no {method}")
    X = np.random.default_rng(0).normal(size=(30, 3)) * [1, 1, 0.01]
    with pytest.warns(UserWarning, match="is more than the number of distinct points") as told:
        getattr(estimator, method)(X)
    assert {one.filename for one in told} == {__file__}
