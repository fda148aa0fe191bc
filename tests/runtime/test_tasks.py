"""Callbacks of scikit-learn: stages of a fit are tasks, and nothing is left when it ends."""

import pickle
import re
import textwrap
import time
import warnings
from pathlib import Path

import numpy as np
import pytest
from sklearn.base import BaseEstimator, OutlierMixin, clone
from sklearn.ensemble import RandomForestClassifier
from sklearn.model_selection import GridSearchCV
from sklearn.neighbors import LocalOutlierFactor
from sklearn.pipeline import make_pipeline

from sklearn_mcmd import (
    MCMDOutlierDetector,
    RegionGrowing,
    RobustNormalEstimator,
    SharpFeatureDetector,
)
from sklearn_mcmd.adjustment import BaardaPlaneDetector, FuzzyPlaneDetector
from sklearn_mcmd.baselines import PlaneOutlierDetector
from sklearn_mcmd.runtime._progress import current_span, listen_to_progress
from sklearn_mcmd.runtime._tasks import PARTS, _tasks

callback = pytest.importorskip("sklearn.callback", reason="callbacks come with scikit-learn 1.9")

ESTIMATORS = [
    MCMDOutlierDetector(random_state=0),
    MCMDOutlierDetector(strictness=None, random_state=0),
    MCMDOutlierDetector(false_positive_rate=0.05, random_state=0),
    MCMDOutlierDetector(n_neighbors=None, random_state=0),
    RobustNormalEstimator(random_state=0),
    RobustNormalEstimator("auto", features="all", random_state=0),
    RobustNormalEstimator(method="pca", features=["linearity"]),
    RegionGrowing(random_state=0),
    RegionGrowing(refine=False, random_state=0),
    SharpFeatureDetector(random_state=0),
    SharpFeatureDetector(criterion="eigenvalue", outlier_detector="passthrough"),
    PlaneOutlierDetector(method="pca", contamination=0.1),
    BaardaPlaneDetector(),
    FuzzyPlaneDetector(),
]


class Recorder:
    """Notes what it is called with, also by estimators within estimators."""

    max_propagation_depth = None

    def __init__(self, fail_at=None, error=ValueError):
        self.log, self.fail_at, self.error = [], fail_at, error

    def setup(self, estimator, context):
        self.log.append(("setup", type(estimator).__name__, ""))

    def teardown(self, estimator, context):
        self.log.append(("teardown", type(estimator).__name__, ""))

    def on_fit_task_begin(self, estimator, context):
        self.log.append(("begin", context.estimator_name, context.task_name))
        if context.task_name == self.fail_at:
            raise self.error("stop")

    def on_fit_task_end(self, estimator, context, *, fitted_estimator=None):
        self.log.append(("end", context.estimator_name, context.task_name))
        if fitted_estimator is not None:
            self.fitted = fitted_estimator

    def named(self, event="begin"):
        """Estimators and tasks, without parts of stages."""
        return [(who, what) for e, who, what in self.log if e == event and what != "part"]


@pytest.fixture
def xyz(room):
    return room.xyz


def state(estimator):
    return {name for name in vars(estimator) if "callback" in name or "_skl" in name}


@pytest.mark.parametrize("estimator", ESTIMATORS, ids=repr)
def test_every_task_that_begins_ends_and_nothing_is_left_or_changed(estimator, xyz):
    recorder = Recorder()
    plain, estimator = clone(estimator), clone(estimator).set_callbacks(recorder)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        plain.fit(xyz)
        estimator.fit(xyz)
    for name, value in vars(plain).items():
        if name.endswith("_") and isinstance(value, np.ndarray):
            for field in value.dtype.names or (...,):
                np.testing.assert_array_equal(value[field], getattr(estimator, name)[field])
    assert recorder.log[0][0] == "setup"
    assert recorder.log[-1][0] == "teardown"
    assert recorder.log[1][1:] == recorder.log[-2][1:] == (type(estimator).__name__, "fit")
    assert sorted(recorder.named("begin")) == sorted(recorder.named("end"))
    assert state(estimator) == {"_skl_callbacks"}
    assert (current_span(), _tasks.get()) == (None, None)


@pytest.mark.parametrize(
    ("estimator", "tasks"),
    [
        (MCMDOutlierDetector(random_state=0), ["planes", "outliers"]),
        (
            MCMDOutlierDetector(false_positive_rate=0.05, random_state=0),
            ["cutoff by simulation", "planes", "outliers"],
        ),
        (
            RobustNormalEstimator("auto", features="all", random_state=0),
            ["sizes of neighborhoods", "normals", "normals next to edges", "curvatures"],
        ),
    ],
    ids=repr,
)
def test_stages_are_tasks_in_their_order_and_have_parts(estimator, tasks, xyz):
    recorder = Recorder()
    clone(estimator).set_callbacks(recorder).fit(xyz)
    assert [what for _, what in recorder.named()] == ["fit", *tasks]
    parts = [what for event, _, what in recorder.log if event == "end" and what == "part"]
    assert len(parts) == PARTS * len(tasks)


def test_estimators_within_estimators_are_tasks_with_their_own(xyz):
    recorder = Recorder()
    SharpFeatureDetector(random_state=0).set_callbacks(recorder).fit(xyz)
    assert recorder.named() == [
        ("SharpFeatureDetector", "fit"),
        ("MCMDOutlierDetector", "fit"),
        ("MCMDOutlierDetector", "planes"),
        ("MCMDOutlierDetector", "outliers"),
        ("RobustNormalEstimator", "fit"),
        ("RobustNormalEstimator", "normals"),
        ("RobustNormalEstimator", "normals next to edges"),
        ("SharpFeatureDetector", "creases"),
    ]
    assert len(recorder.named("setup")) == 1


def test_a_callback_that_goes_no_deeper_sees_these_as_one_task(xyz):
    recorder = Recorder()
    recorder.max_propagation_depth = 0
    RegionGrowing(random_state=0).set_callbacks(recorder).fit(xyz)
    assert recorder.named()[:3] == [
        ("RegionGrowing", "fit"),
        ("RegionGrowing", "normals"),
        ("RegionGrowing", "links of neighbors"),
    ]


def test_an_estimator_within_that_knows_no_callbacks_is_one_task(xyz):
    class Plain(OutlierMixin, BaseEstimator):
        def fit(self, X, y=None):
            return self

        def predict(self, X):
            return np.ones(len(X))

    recorder = Recorder()
    detector = SharpFeatureDetector(outlier_detector=Plain(), random_state=0)
    with pytest.warns(UserWarning, match="does not support callbacks"):
        detector.set_callbacks(recorder).fit(xyz)
    assert recorder.named()[1] == ("SharpFeatureDetector", "outliers")
    assert not hasattr(LocalOutlierFactor(), "set_callbacks")


@pytest.mark.parametrize(
    ("fail_at", "error", "n_jobs"),
    [
        ("fit", ValueError, 1),
        ("planes", KeyboardInterrupt, 2),
        ("part", KeyboardInterrupt, 1),
        ("part", ValueError, 2),
        ("part", KeyboardInterrupt, 2),
        ("outliers", ValueError, 2),
    ],
)
def test_a_callback_that_raises_ends_the_fit_and_leaves_nothing(fail_at, error, n_jobs, xyz):
    recorder = Recorder(fail_at, error)
    detector = MCMDOutlierDetector(random_state=0, n_jobs=n_jobs).set_callbacks(recorder)
    with pytest.raises(error):
        detector.fit(xyz)
    assert recorder.log[-1][0] == "teardown"
    assert state(detector) == {"_skl_callbacks"}
    assert (current_span(), _tasks.get()) == (None, None)
    recorder.fail_at = None
    detector.fit(xyz)  # and again as if nothing had been


def test_a_callback_that_raises_within_leaves_nothing_in_either(xyz):
    recorder = Recorder("normals next to edges")
    growing = RegionGrowing(random_state=0).set_callbacks(recorder)
    with pytest.raises(ValueError, match="stop"):
        growing.fit(xyz)
    assert state(growing) == {"_skl_callbacks"}
    assert state(growing.normal_estimator_) == set()


def test_wrong_parameters_are_refused_as_ever(xyz):
    recorder = Recorder()
    detector = MCMDOutlierDetector(cutoff=3, contamination=0.1).set_callbacks(recorder)
    with pytest.raises(ValueError, match="exclude each other"):
        detector.fit(xyz)
    assert recorder.log[-1][0] == "teardown"
    assert state(detector) == {"_skl_callbacks"}


def test_fitted_estimators_are_pickled_and_cloned_with_callbacks(xyz):
    detector = MCMDOutlierDetector(random_state=0).set_callbacks(Recorder()).fit(xyz)
    again = pickle.loads(pickle.dumps(detector))
    np.testing.assert_array_equal(again.predict(xyz), detector.predict(xyz))
    assert clone(detector)._skl_callbacks == detector._skl_callbacks


def test_the_end_of_a_fit_gives_an_estimator_that_predicts(xyz):
    recorder = Recorder()
    detector = MCMDOutlierDetector(random_state=0).set_callbacks(recorder)
    labels = detector.fit_predict(xyz)
    np.testing.assert_array_equal(recorder.fitted.predict(xyz), labels)


def test_pipelines_hold_the_tasks_of_their_steps(xyz):
    recorder = Recorder()
    pipeline = make_pipeline(
        RobustNormalEstimator(random_state=0), RegionGrowing(normals="precomputed")
    )
    labels = pipeline.fit_predict(xyz)
    np.testing.assert_array_equal(pipeline.set_callbacks(recorder).fit_predict(xyz), labels)
    assert [who for who, what in recorder.named() if what == "fit"] == [
        "RobustNormalEstimator",
        "RegionGrowing",
    ]
    assert ("RegionGrowing", "growing regions") in recorder.named()


@pytest.mark.filterwarnings("ignore:The estimator RandomForestClassifier does not support callback")
@pytest.mark.parametrize("n_jobs", [1, 2])
def test_a_grid_search_with_a_progress_bar_finds_what_it_finds_without(n_jobs, xyz, capsys):
    pytest.importorskip("rich")
    y = np.arange(len(xyz)) % 2
    model = make_pipeline(RobustNormalEstimator(random_state=0), RandomForestClassifier(3))
    grid = {"robustnormalestimator__n_neighbors": [10, 20]}
    search = GridSearchCV(model, grid, cv=2, n_jobs=n_jobs)
    search.set_callbacks(callback.ProgressBar(max_propagation_depth=None)).fit(xyz, y)
    assert len(search.cv_results_["params"]) == 2
    assert "RobustNormalEstimator" in capsys.readouterr().out


def test_the_progress_bar_shows_each_stage(xyz, capsys):
    pytest.importorskip("rich")
    SharpFeatureDetector(random_state=0).set_callbacks(callback.ProgressBar()).fit(xyz)
    shown = capsys.readouterr().out
    for words in ("SharpFeatureDetector - fit", "MCMDOutlierDetector - ", "creases"):
        assert words in shown
    assert "100%" in shown


def test_the_callback_in_the_docs_prints_stages(xyz, capsys):
    page = Path(__file__).parents[2] / "docs" / "pipelines.rst"
    if not page.is_file():
        pytest.skip("a checkout is needed")
    code = re.search(r"( +from time import perf_counter.*?fit\(xyz\))", page.read_text(), re.S)[1]
    exec(textwrap.dedent(code), {"xyz": xyz, "RobustNormalEstimator": RobustNormalEstimator})
    lines = capsys.readouterr().out.splitlines()
    assert [line.split(":")[0] for line in lines] == [
        f"[RobustNormalEstimator] {what}" for what in ("normals", "normals next to edges", "fit")
    ]


def test_who_listens_otherwise_hears_the_same_with_callbacks(xyz):
    def heard(detector):
        told = []
        with listen_to_progress(told.append):
            detector.fit(xyz)
        return [(t.stage, round(t.share, 9)) for t in told if t.share is not None and t.stage]

    plain = heard(SharpFeatureDetector(random_state=0))
    watched = heard(SharpFeatureDetector(random_state=0).set_callbacks(Recorder()))
    assert list(dict.fromkeys(watched)) == list(dict.fromkeys(plain))


def test_without_callbacks_none_of_it_costs_time(xyz):
    """What a fit does more than before: two looks for an attribute, below a microsecond each."""
    from sklearn_mcmd.runtime._tasks import fit_in_tasks

    class Nothing:
        def fit(self, X, y=None):
            return self

    class Watched(Nothing):
        fit = fit_in_tasks(Nothing.fit)

    watched, n = Watched(), 2000
    begin = time.process_time()
    for _ in range(n):
        watched.fit(xyz)
    assert (time.process_time() - begin) / n < 1e-4
