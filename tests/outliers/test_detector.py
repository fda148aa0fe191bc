"""MCMDOutlierDetector: the paper's form, the interface, new points, odd clouds, bad input."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from sklearn_mcmd import MCMDOutlierDetector
from sklearn_mcmd._choices import Strictness, choices_of
from sklearn_mcmd.datasets import make_street
from sklearn_mcmd.outliers._model import LEVELS

ZEROS = np.zeros((9, 3))
STRICTNESSES = ["isolated", "groups", "surfaces", None]


def wall_with_car(n=400, seed=0):
    rng = np.random.default_rng(seed)
    wall = rng.uniform(0, 2, (n, 3)) * [1, 0, 1] + rng.normal(0, 0.004, (n, 3))
    car = rng.uniform([0.5, -1.2, 0.5], [0.9, -0.8, 0.9], (n // 20, 3))
    return np.vstack([wall, car]), np.r_[np.ones(n), -np.ones(n // 20)]


@pytest.fixture(scope="module")
def street():
    return make_street(6000, random_state=0).data


@pytest.mark.parametrize(
    ("parameters", "cutoff"),
    [
        ({}, 3),
        ({"method": "mcmd_md"}, 3),
        ({"strictness": None}, 2.5),
        ({"strictness": None, "method": "mcmd_md"}, 3.0575159),
        ({"n_neighbors": None}, 2.5),
        ({"cutoff": 7}, 7),
    ],
)
def test_the_cutoff_is_the_documented_one(parameters, cutoff):
    X, _ = wall_with_car(100)
    fitted = MCMDOutlierDetector(random_state=0).set_params(**parameters).fit(X)
    assert_allclose(fitted.offset_, -cutoff)


def test_the_papers_form_measures_each_point_by_its_own_plane(street):
    paper = MCMDOutlierDetector(reweight=False, strictness=None, random_state=0).fit(street)
    assert_array_equal(paper.plane_index_, np.arange(len(street)))
    planes, distances = paper._model.evaluate(street)
    assert_array_equal(-paper.scores_, distances)
    by_scale = MCMDOutlierDetector(
        reweight=False, strictness=None, noise_scale=0.02, random_state=0
    ).fit(street)
    assert_allclose(-by_scale.scores_, distances * planes.scale / 0.02)


@pytest.mark.parametrize("copies", [False, True])
@pytest.mark.parametrize("strictness", STRICTNESSES)
def test_fit_predict_equals_predict_and_scores_agree(street, strictness, copies):
    if copies:
        street = np.vstack([street, street[::7], street[::11]])
    detector = MCMDOutlierDetector(strictness=strictness, random_state=0)
    labels = detector.fit_predict(street)
    assert_array_equal(labels, detector.predict(street))
    scores = detector.score_samples(street)
    assert_array_equal(detector.scores_, scores)
    assert_array_equal(detector.decision_function(street), scores - detector.offset_)
    assert_array_equal(labels, np.where(scores >= detector.offset_, 1, -1))
    moved = detector.score_samples(
        street[:50] + np.array([0, 0, 0.5])
    )  # at x and y of the fitted ones
    assert (moved != scores[:50]).mean() > 0.9


@pytest.mark.parametrize("n", [500, 15_000])  # as given, and in spatial order
def test_groups_are_numbered_in_the_order_of_rows_and_planes_named_by_it(n):
    X = make_street(n, random_state=1).data
    order = np.random.default_rng(0).permutation(n)
    expected = MCMDOutlierDetector(random_state=0).fit(X)
    shuffled = MCMDOutlierDetector(random_state=0).fit(X[order])
    assert_array_equal(order[shuffled.plane_index_], expected.plane_index_[order])
    group, numbers = shuffled.group_index_, expected.group_index_[order]
    assert_array_equal(group == -1, expected.on_surface_[order])
    pairs = np.unique([group, numbers], axis=1)  # numbers differ, groups do not
    assert pairs.shape[1] == len(np.unique(group)) == len(np.unique(numbers))
    _, first = np.unique(group[group >= 0], return_index=True)
    assert (np.diff(first) > 0).all()
    assert (np.diff(np.unique(group)) == 1).all()


@pytest.mark.parametrize("reweight", [True, False])
@pytest.mark.parametrize("method", ["mcmd_z", "mcmd_md"])
@pytest.mark.parametrize("n", [200, 1500])
def test_a_perfect_plane_has_no_outliers_but_those_off_it(n, method, reweight):
    """MAD and least eigenvalue are zero: rounding of the coordinates takes their place."""
    rng = np.random.default_rng(0)
    X = rng.uniform(0, 1, (n, 3))
    X[:, 2] = 0.3 * X[:, 0] - 0.2 * X[:, 1] + 7
    X[0, 2] += 1e-3
    detector = MCMDOutlierDetector(20, method=method, reweight=reweight, random_state=0)
    scores = detector.set_params(strictness=None).fit(X).score_samples(X)
    assert np.isfinite(scores).all()
    assert scores[0] < -1e6
    if method == "mcmd_z":  # MD also measures the distance within the plane
        assert (scores[1:] > -2.5).all()
    for strictness in ("groups", "surfaces"):
        labels = detector.set_params(strictness=strictness).fit_predict(X)
        assert labels[0] == -1
        assert (labels[1:] == 1).all()


@pytest.mark.parametrize("strictness", ["isolated", "groups", "surfaces"])
@pytest.mark.parametrize("d", [2, 3, 5])
@pytest.mark.filterwarnings("ignore:n_neighbors=50 is more than", "ignore:strictness=.* in 5D")
def test_the_fewest_points_have_no_outliers_and_judge_new_ones(d, strictness):
    X = np.random.default_rng(0).normal(size=(d + 1, d))
    detector = MCMDOutlierDetector(strictness=strictness, max_outlier_rate=0.2, random_state=0).fit(
        X
    )
    assert (detector.predict(X) == 1).all()
    assert_array_equal(detector.predict(np.full((1, d), 1e3)), [-1])


def test_thousands_of_points_in_one_place_do_not_slow_the_search():
    """A scanner's missing returns at the origin; quadratic work would take minutes.

    That place keeps company with itself: it is no isolated point. As a group it stands off, but
    is of 50,000 measurements. It is no surface.
    """
    rng = np.random.default_rng(0)
    X = np.vstack([np.zeros((50_000, 3)), rng.uniform(1, 2, (2_000, 3)) * [1, 1, 0]])
    for strictness, label in (("isolated", 1), ("groups", 1), ("surfaces", -1)):
        detector = MCMDOutlierDetector(20, strictness=strictness, random_state=0).fit(X)
        assert (detector.predict(X[-2000:]) == 1).all()
        assert (detector.predict(X[:50]) == label).all()


@pytest.mark.parametrize(("n", "n_neighbors"), [(600, 50), (3000, 50), (100_000, None)])
@pytest.mark.parametrize("d", [3, 4])
@pytest.mark.filterwarnings("ignore:X has 4 columns")
def test_collinear_clouds_do_not_slow_the_work(n, n_neighbors, d):
    """Completing every minimal subset point by point would take minutes, and hours for more."""
    X = np.linspace(0, 1, n)[:, None] * np.arange(1.0, d + 1)
    detector = MCMDOutlierDetector(n_neighbors, max_outlier_rate=0.2, random_state=0)
    assert (detector.fit(X).predict(X[:200]) == 1).all()


def test_single_precision_queries_are_measured_with_their_own_rounding():
    X = np.random.default_rng(0).uniform(0, 9, (2000, 3))
    X[:, 2] = 0.3 * X[:, 0] - 0.2 * X[:, 1] + 7
    detector = MCMDOutlierDetector(20, random_state=0).fit(X)
    assert (detector.predict(X.astype(np.float32)) == 1).all()


@pytest.mark.parametrize(
    ("parameters", "X", "message"),
    [
        ({}, [["a", "b", "c"]] * 9, "could not convert|dtype"),
        ({"n_neighbors": 3}, np.eye(3).repeat(3, 0), "n_neighbors=3 is too few for planes in 3D"),
        (
            {"cutoff": 3, "contamination": 0.1},
            ZEROS,
            r"cutoff=3 and contamination=0\.1 exclude each other: leave all but one",
        ),
        (
            {"false_positive_rate": 0.01, "contamination": 0.1},
            ZEROS,
            r"false_positive_rate=0\.01 and contamination=0\.1 exclude",
        ),
        ({"support_fraction": 0.0}, ZEROS, "'support_fraction' parameter"),
        ({"success_probability": 1.0}, ZEROS, "'success_probability' parameter"),
    ],
)
def test_bad_input_is_named(parameters, X, message):
    with pytest.raises(ValueError, match=message):
        MCMDOutlierDetector(**parameters).fit(X)


def test_each_level_that_the_parameter_takes_is_judged_by_and_no_other(monkeypatch):
    assert choices_of(Strictness) == LEVELS.keys()
    monkeypatch.setitem(MCMDOutlierDetector._parameter_constraints, "strictness", [str])
    with pytest.raises(KeyError, match="Groups"):
        MCMDOutlierDetector(strictness="Groups").fit(wall_with_car(100)[0])


@pytest.mark.filterwarnings("ignore:strictness=.* in 8D")
def test_trials_beyond_space_are_limited_with_a_warning():
    X = np.random.default_rng(0).normal(size=(40, 8))
    with pytest.warns(UserWarning, match="max_outlier_rate=0.5 in 8D asks for 2354 trials; 300"):
        MCMDOutlierDetector(20, random_state=0).fit(X)


def test_contamination_auto_is_the_cutoff_and_excludes_no_other_way():
    X = np.random.default_rng(0).normal(size=(80, 3)) * [1, 1, 0.01]
    one, auto = (MCMDOutlierDetector(contamination=c).fit(X) for c in (None, "auto"))
    assert auto.offset_ == one.offset_
    assert MCMDOutlierDetector(contamination="auto", cutoff=5).fit(X).offset_ == -5


def test_company_warns_in_five_dimensions_and_distances_from_planes_find_all():
    rng = np.random.default_rng(0)
    X = rng.normal(size=(400, 5)) * [1, 1, 1, 1, 0.01]
    X[:40, 4] = rng.uniform(1, 5, 40)
    detector = MCMDOutlierDetector(max_outlier_rate=0.2, random_state=0)
    with pytest.warns(UserWarning, match="in 5D finds few outliers"):
        detector.fit(X)
    labels = detector.set_params(strictness="surfaces").fit_predict(X)
    assert (labels[:40] == -1).all()
    assert (labels[40:] == 1).mean() > 0.98


def profile(n_off=100):
    rng = np.random.default_rng(0)
    along = np.sort(rng.uniform(0, 10, 1000))
    X = np.c_[along, np.where(along < 5, 0, 2) + rng.normal(0, 0.01, 1000)]
    X[:n_off, 1] += rng.uniform(1, 3, n_off)
    return X


@pytest.mark.parametrize("strictness", ["isolated", "groups", "surfaces"])
def test_a_plan_of_two_columns_is_warned_of(strictness):
    street = make_street(3000, outlier_share=0.1, random_state=0).data
    detector = MCMDOutlierDetector(strictness=strictness, random_state=0)
    with pytest.warns(UserWarning, match="% of the points are outliers in 2D. If X is a plan"):
        detector.fit(street[:, :2])


@pytest.mark.parametrize("strictness", STRICTNESSES)
def test_profiles_and_blobs_of_two_columns_are_silent(strictness):
    detector = MCMDOutlierDetector(strictness=strictness, random_state=0)
    for X in (profile(), np.random.default_rng(0).normal(size=(300, 2))):
        detector.fit(X)


def test_who_asks_for_many_outliers_of_a_plan_gets_them_in_silence():
    street = make_street(1000, random_state=0).data[:, :2]
    labels = MCMDOutlierDetector(contamination=0.4, random_state=0).fit_predict(street)
    assert (labels == -1).mean() == pytest.approx(0.4, abs=0.01)
