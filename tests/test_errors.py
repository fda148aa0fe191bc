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
from sklearn_mcmd._errors import ParameterError, ParameterWarning, agreed, counted
from sklearn_mcmd._validation import check_work
from sklearn_mcmd.baselines import PlaneOutlierDetector
from sklearn_mcmd.cli import app
from sklearn_mcmd.planes._neighborhoods import NeighborIndex

TOO_FEW = ParameterError("$n_samples is less than $n_neighbors=4: lower $n_neighbors.", n_samples=2)


def test_an_error_and_its_copy_from_another_process_have_names_of_parameters():
    for error in (TOO_FEW, pickle.loads(pickle.dumps(TOO_FEW))):
        assert str(error) == "n_samples=2 is less than n_neighbors=4: lower n_neighbors."
        assert isinstance(error, ValueError)


def test_names_and_fields_are_worded_by_whoever_shows_them():
    words = TOO_FEW.worded(lambda name, value: f"<{name}{value or ''}>")
    assert words == "<n_samples2> is less than <n_neighbors=>4: lower <n_neighbors>."


def test_noun_and_verb_agree_with_their_number():
    assert [counted(n, "point") for n in (0, 1, 2_000)] == ["0 points", "1 point", "2,000 points"]
    assert counted(1, "point", "are", of=6_001) == "1 of 6,001 points is"
    assert counted(2, "point", "are", of=6_001) == "2 of 6,001 points are"
    assert counted(1, "point", "lie", of=1) == "1 of 1 point lies"
    assert counted(1, "point", "are outliers", of=9) == "1 of 9 points is an outlier"
    assert [agreed(n, "have") for n in (0, 1, 2)] == ["have", "has", "have"]


def test_a_message_may_have_signs_that_are_no_names():
    assert str(ParameterWarning("5 % or 3 $ of $row", row=7)) == "5 % or 3 $ of row 7"


@pytest.mark.parametrize(
    "estimator",
    [
        MCMDOutlierDetector(10**6, random_state=0),
        MCMDOutlierDetector(10**6, strictness=None, random_state=0),
        RobustNormalEstimator(10**6, random_state=0),
        RegionGrowing(10**6),
        SharpFeatureDetector(10**6),
        SharpFeatureDetector(10**6, criterion="surface_variation"),
        PlaneOutlierDetector(10**6),
    ],
)
def test_far_more_neighbors_than_there_are_points_are_refused_at_once(estimator, monkeypatch):
    X = np.random.default_rng(0).uniform(size=(23_000, 3))
    monkeypatch.setattr(NeighborIndex, "query_own", None)  # no neighborhood is asked for
    with pytest.raises(ValueError, match=r"n_neighbors=1000000 is more than .* 23,000"):
        estimator.fit(X)


@pytest.mark.parametrize("n_neighbors", [300, 10**6])
def test_neighborhoods_of_all_points_of_a_small_cloud_are_taken_with_a_warning(n_neighbors):
    X = np.random.default_rng(0).uniform(size=(200, 3)) * [1, 1, 0.01]
    whole = MCMDOutlierDetector(200, random_state=0).fit(X)
    with pytest.warns(UserWarning, match="neighborhoods of all of them are used"):
        bounded = MCMDOutlierDetector(n_neighbors, random_state=0).fit(X)
    assert (bounded.n_neighbors_, bounded.n_support_) == (200, 100)
    np.testing.assert_array_equal(bounded.scores_, whole.scores_)


def test_large_neighborhoods_are_told_with_their_cost_and_usual_ones_are_not():
    for estimator, n_neighbors in ((RobustNormalEstimator, 5_000), (SharpFeatureDetector, 500)):
        with pytest.warns(UserWarning, match=f"n_neighbors={n_neighbors} takes at least 100 times"):
            check_work(estimator(n_neighbors), 10_000)
        check_work(estimator(n_neighbors // 2), 10**9)


def test_parameters_in_messages_are_options_of_a_verb():
    verbs = typer.main.get_command(app).commands.values()
    options = {option for verb in verbs for param in verb.loaded.params for option in param.opts}
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
