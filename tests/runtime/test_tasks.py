"""Callbacks of scikit-learn: stages of a fit are tasks, and nothing is left when it ends."""

import pickle
import warnings

import numpy as np
import pytest
from sklearn.base import clone
from sklearn.ensemble import RandomForestClassifier
from sklearn.model_selection import GridSearchCV
from sklearn.pipeline import make_pipeline

from sklearn_mcmd import (
    MCMDOutlierDetector,
    RegionGrowing,
    RobustNormalEstimator,
    SharpFeatureDetector,
)
from sklearn_mcmd.adjustment import BaardaPlaneDetector, FuzzyPlaneDetector
from sklearn_mcmd.baselines import PlaneOutlierDetector
from sklearn_mcmd.runtime._progress import current_span
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
    again = pickle.loads(pickle.dumps(estimator))
    if hasattr(again, "predict"):
        np.testing.assert_array_equal(again.predict(xyz), plain.predict(xyz))
        np.testing.assert_array_equal(recorder.fitted.predict(xyz), plain.predict(xyz))


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
        (
            RobustNormalEstimator(features=["planarity"], random_state=0),
            ["normals", "normals next to edges"],
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
