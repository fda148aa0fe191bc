"""MCMDOutlierDetector: the reference, invariances, new points, bad input."""

import pickle
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from sklearn.base import clone
from sklearn.model_selection import GridSearchCV

from reference import neighborhood, saliency
from sklearn_mcmd import MCMDOutlierDetector
from sklearn_mcmd.datasets import make_street
from sklearn_mcmd.planes._consistent_set import draw_trials

# The paper's one pass over neighborhoods that are their own rulers.
OWN = {"max_iter": 1, "noise_scale": "own", "borrow": False}


def wall_with_car(n=400, seed=0):
    rng = np.random.default_rng(seed)
    wall = rng.uniform(0, 2, (n, 3)) * [1, 0, 1] + rng.normal(0, 0.004, (n, 3))
    car = rng.uniform([0.5, -1.2, 0.5], [0.9, -0.8, 0.9], (n // 20, 3))
    return np.vstack([wall, car]), np.r_[np.ones(n), -np.ones(n // 20)]


@pytest.fixture(scope="module")
def street():
    return make_street(6000, random_state=0).data


@pytest.mark.parametrize("n", [300, 1500])  # NumPy and compiled
@pytest.mark.parametrize(("method", "cutoff"), [("mcmd_z", 2.5), ("mcmd_md", 3.0575159)])
def test_scores_equal_the_literal_algorithms(n, method, cutoff):
    X, _ = wall_with_car(n)
    detector = MCMDOutlierDetector(
        30, method=method, refine=None, outlier_rate=0.2, random_state=3, **OWN
    ).fit(X)
    trials = draw_trials(detector.n_trials_, 30, random_state=3)
    rows = np.r_[0:6, len(X) - 4 : len(X)]
    expected = [saliency(X, X[i], 30, trials, 15, method, cutoff)[0] for i in rows]
    assert_allclose(-detector.score_samples(X[rows]), expected, rtol=1e-9)


def test_points_before_a_wall_are_found_and_the_wall_is_kept():
    X, y = wall_with_car()
    labels = MCMDOutlierDetector(random_state=0).fit_predict(X)
    assert (labels[y == -1] == -1).mean() > 0.9
    assert (labels[y == 1] == 1).mean() > 0.95


def test_fit_predict_equals_predict_and_scores_agree(street):
    detector = MCMDOutlierDetector(random_state=0)
    labels = detector.fit_predict(street)
    assert_array_equal(labels, detector.predict(street))
    scores = detector.score_samples(street)
    assert_array_equal(detector.scores_, scores)
    assert_array_equal(detector.decision_function(street), scores - detector.offset_)
    assert_array_equal(labels, np.where(scores >= detector.offset_, 1, -1))
    assert detector.offset_ == -3


def test_a_new_point_is_scored_against_the_fitted_cloud():
    X, _ = wall_with_car()
    detector = MCMDOutlierDetector(random_state=0).fit(X)
    queries = np.array([[1.0, 0.0, 1.0], [1.0, 0.1, 1.0]])
    assert_array_equal(detector.predict(queries), [1, -1])
    # Its neighbors are points of the cloud, so any number of copies changes nothing.
    assert_allclose(detector.score_samples(np.tile(queries[1], (60, 1)))[0], -25, rtol=0.5)


def test_results_do_not_depend_on_threads_or_chunks(street, monkeypatch):
    expected = MCMDOutlierDetector(random_state=0).fit(street).score_samples(street)
    monkeypatch.setattr("sklearn_mcmd.planes._local_planes.CHUNK", {True: 97, False: 97})
    pieces = MCMDOutlierDetector(random_state=0, n_jobs=2).fit(street).score_samples(street)
    assert_array_equal(pieces, expected)


@pytest.mark.parametrize("n", [500, 15_000])  # as given, and in spatial order
def test_results_do_not_depend_on_the_order_of_rows(n):
    X = make_street(n, random_state=1).data
    order = np.random.default_rng(0).permutation(n)
    expected = MCMDOutlierDetector(random_state=0).fit(X).score_samples(X[:300])
    shuffled = MCMDOutlierDetector(random_state=0).fit(X[order]).score_samples(X[:300])
    assert_allclose(shuffled, expected, rtol=1e-12)


@pytest.mark.parametrize("n_neighbors", [30, None])
@settings(max_examples=15, deadline=None)
@given(
    shift=st.floats(-1e4, 1e4),
    scale=st.floats(1e-3, 1e3),
    angles=st.tuples(*[st.floats(0, 6.28)] * 3),
)
def test_scores_are_invariant_to_motion_and_units(n_neighbors, shift, scale, angles):
    X, _ = wall_with_car(150)
    cosine, sine = np.cos(angles), np.sin(angles)
    turn = np.eye(3)
    for (i, j), c, s in zip([(0, 1), (0, 2), (1, 2)], cosine, sine, strict=True):
        step = np.eye(3)
        step[[i, i, j, j], [i, j, i, j]] = c, -s, s, c
        turn = turn @ step
    moved = scale * (X @ turn.T) + shift
    expected = MCMDOutlierDetector(n_neighbors, random_state=0).fit(X).score_samples(X)
    scores = MCMDOutlierDetector(n_neighbors, random_state=0).fit(moved).score_samples(moved)
    # Rounding at the shifted coordinates against a noise of 0.004 * scale.
    assert_allclose(scores, expected, rtol=1e-7, atol=1e-7 + 1e-12 * abs(shift) / scale)


def test_float32_gives_the_answers_of_float64():
    X, _ = wall_with_car()
    X = X.astype(np.float32)
    single = MCMDOutlierDetector(random_state=0).fit(X).score_samples(X)
    double = MCMDOutlierDetector(random_state=0).fit(X.astype(float)).score_samples(X.astype(float))
    # The rounding of float32, 1e-6, joins a noise of 0.004 in borrowed planes, in squares.
    assert_allclose(single, double, rtol=1e-6)


@pytest.mark.parametrize("refine", ["reweight", None])
@pytest.mark.parametrize("method", ["mcmd_z", "mcmd_md"])
@pytest.mark.parametrize("n", [200, 1500])
def test_a_perfect_plane_has_no_outliers_but_those_off_it(n, method, refine):
    """MAD and least eigenvalue are zero: rounding of the coordinates takes their place."""
    rng = np.random.default_rng(0)
    X = rng.uniform(0, 1, (n, 3))
    X[:, 2] = 0.3 * X[:, 0] - 0.2 * X[:, 1] + 7
    X[0, 2] += 1e-3
    detector = MCMDOutlierDetector(20, method=method, refine=refine, random_state=0, **OWN)
    scores = detector.fit(X).score_samples(X)
    assert np.isfinite(scores).all()
    assert scores[0] < -1e6
    if method == "mcmd_z":  # MD also measures the distance within the plane
        assert (scores[1:] > -2.5).all()
    labels = detector.set_params(max_iter=3, noise_scale="local", borrow=True).fit_predict(X)
    assert labels[0] == -1
    assert (labels[1:] == 1).all()


@pytest.mark.parametrize("n", [120, 1200])
@pytest.mark.parametrize("kind", ["coincident", "collinear"])
def test_points_that_span_no_plane_have_no_outliers(n, kind):
    t = np.linspace(0, 1, n)[:, None]
    X = np.tile([[1.0, 2.0, 3.0]], (n, 1)) if kind == "coincident" else t * [[1.0, 2.0, 3.0]]
    for form in ({}, OWN):
        detector = MCMDOutlierDetector(20, random_state=0, **form)
        assert (detector.fit_predict(X) == 1).all()
        # A query away from the line or location has nothing that explains it.
        assert_array_equal(detector.predict([[5.0, 0.0, 0.0]]), [-1])
    assert_allclose(detector.score_samples(X), 0, atol=1e-6)


def test_thousands_of_points_in_one_place_do_not_slow_the_search():
    """A scanner's missing returns at the origin; quadratic work would take minutes."""
    rng = np.random.default_rng(0)
    X = np.vstack([np.zeros((50_000, 3)), rng.uniform(1, 2, (2_000, 3)) * [1, 1, 0]])
    detector = MCMDOutlierDetector(20, random_state=0).fit(X)
    assert (detector.predict(X[-2000:]) == 1).all()
    # As one location far from the others, however often it was returned.
    assert (detector.predict(X[:50]) == -1).all()


@pytest.mark.parametrize(
    ("n", "n_neighbors"), [(600, 50), (3000, 50), (800, None), (100_000, None)]
)
@pytest.mark.parametrize("d", [3, 4])
def test_collinear_clouds_do_not_slow_the_work(n, n_neighbors, d):
    """Completing every minimal subset point by point would take minutes, and hours for more."""
    X = np.linspace(0, 1, n)[:, None] * np.arange(1.0, d + 1)
    detector = MCMDOutlierDetector(n_neighbors, outlier_rate=0.2, random_state=0)
    assert (detector.fit(X).predict(X[:200]) == 1).all()


@pytest.mark.parametrize("copies", [2, 20])
def test_repeated_points_change_nothing(street, copies):
    street = street[:3000]
    expected = MCMDOutlierDetector(random_state=0).fit(street).score_samples(street)
    detector = MCMDOutlierDetector(random_state=0).fit(np.tile(street, (copies, 1)))
    assert_allclose(detector.score_samples(street), expected, rtol=1e-9)


def test_changing_the_input_after_fitting_changes_nothing(street):
    X = street.copy()
    detector = MCMDOutlierDetector(random_state=0).fit(X)
    expected = detector.score_samples(street)
    X *= 0
    assert_array_equal(detector.score_samples(street), expected)


def test_single_precision_queries_are_measured_with_their_own_rounding():
    X = np.random.default_rng(0).uniform(0, 9, (2000, 3))
    X[:, 2] = 0.3 * X[:, 0] - 0.2 * X[:, 1] + 7
    detector = MCMDOutlierDetector(20, random_state=0).fit(X)
    assert (detector.predict(X.astype(np.float32)) == 1).all()


@pytest.mark.parametrize("far", [1e4, 1e8, 1e12])
@pytest.mark.parametrize("n_neighbors", [50, None])
def test_one_gross_outlier_hides_nothing(far, n_neighbors):
    X, _ = wall_with_car()
    X[0] = far
    X[1] = [1.0, 0.5, 1.0]
    detector = MCMDOutlierDetector(n_neighbors, random_state=0).fit(X)
    assert_array_equal(detector.predict(X[:2]), [-1, -1])
    assert (detector.predict(X[2:400]) == 1).mean() > 0.95


def test_more_neighbors_than_points_means_all_points_with_a_warning():
    X, _ = wall_with_car(40)
    with pytest.warns(UserWarning, match="distinct points, 42 of n_samples=42"):
        detector = MCMDOutlierDetector(50, random_state=0).fit(X)
    assert detector.n_neighbors_ == 42
    assert detector.n_support_ == 21


def test_a_fixed_seed_repeats_and_seeds_differ(street):
    first, again, other = (
        MCMDOutlierDetector(random_state=seed).fit(street).score_samples(street)
        for seed in (0, 0, 1)
    )
    assert_array_equal(first, again)
    assert (first != other).mean() > 0.05


def test_it_survives_cloning_and_pickling(street):
    detector = MCMDOutlierDetector(random_state=0, cutoff=3).fit(street[:1500])
    copy = pickle.loads(pickle.dumps(detector))
    assert_array_equal(copy.score_samples(street), detector.score_samples(street))
    assert clone(detector).cutoff == 3


def test_it_can_be_searched_over_a_grid():
    X, y = wall_with_car()
    search = GridSearchCV(
        MCMDOutlierDetector(outlier_rate=0.2, random_state=0),
        {"n_neighbors": [10, 30], "method": ["mcmd_z", "mcmd_md"]},
        scoring="balanced_accuracy",
        cv=2,
    ).fit(X, y)
    assert search.best_score_ > 0.8


@pytest.mark.parametrize(
    ("parameters", "X", "message"),
    [
        ({}, [[0.0, 0, np.nan]] * 9, "NaN"),
        ({}, [[0.0, 0, np.inf]] * 9, "infinity"),
        ({}, [[0.0, 0, 1]], "n_samples=1 is too few for planes in 3D: at least 4"),
        ({}, [[0.0], [1]], "1 feature"),
        ({}, np.empty((0, 3)), "0 sample"),
        ({}, [["a", "b", "c"]] * 9, "could not convert|dtype"),
        ({}, [[0.0, 0, 1e300], *np.eye(3).tolist(), [1, 1, 1]], "beyond 1e.100 in row 0"),
        ({}, 1e-200 * np.eye(3).repeat(3, 0), "X spans no more than 1e-200"),
        ({"n_neighbors": 3}, np.eye(3).repeat(3, 0), "n_neighbors=3 is too few for planes in 3D"),
        ({"n_neighbors": 0}, np.zeros((9, 3)), "'n_neighbors' parameter"),
        ({"n_neighbors": 9.5}, np.zeros((9, 3)), "'n_neighbors' parameter"),
        ({"method": "pca"}, np.zeros((9, 3)), "'method' parameter"),
        ({"support_fraction": 0.0}, np.zeros((9, 3)), "'support_fraction' parameter"),
        ({"outlier_rate": 1.0}, np.zeros((9, 3)), "'outlier_rate' parameter"),
        ({"success_probability": 1.0}, np.zeros((9, 3)), "'success_probability' parameter"),
        ({"cutoff": -1}, np.zeros((9, 3)), "'cutoff' parameter"),
        ({"refine": "mm"}, np.zeros((9, 3)), "'refine' parameter"),
    ],
)
def test_bad_input_is_named(parameters, X, message):
    with pytest.raises(ValueError, match=message):
        MCMDOutlierDetector(**parameters).fit(X)


def test_points_of_another_dimension_are_refused():
    X, _ = wall_with_car(40)
    detector = MCMDOutlierDetector(20, random_state=0).fit(X)
    with pytest.raises(ValueError, match=r"2 features, but .* is expecting 3"):
        detector.predict(X[:, :2])


def test_queries_beyond_measure_are_refused():
    X, _ = wall_with_car(40)
    detector = MCMDOutlierDetector(20, random_state=0).fit(X)
    with pytest.raises(ValueError, match="in row 1"):
        detector.predict([[0, 0, 0], [1e200, 0, 0]])


def test_trials_beyond_space_are_limited_with_a_warning():
    X = np.random.default_rng(0).normal(size=(40, 8))
    with pytest.warns(UserWarning, match="outlier_rate=0.5 in 8D asks for 2354 trials; 300"):
        MCMDOutlierDetector(20, random_state=0).fit(X)


def test_a_small_cloud_needs_no_compiled_code():
    statement = (
        "import sys, numpy as np, sklearn_mcmd; X = np.random.default_rng(0).normal(size=(50, 3));"
        "sklearn_mcmd.MCMDOutlierDetector().fit_predict(X); sys.exit('numba' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", statement], check=False).returncode == 0


def test_without_numba_the_answers_are_the_same(street, monkeypatch):
    expected = MCMDOutlierDetector(random_state=0).fit(street).score_samples(street[:100])
    monkeypatch.setattr("sklearn_mcmd.planes._local_planes._compiled_driver", lambda: None)
    assert_allclose(
        MCMDOutlierDetector(random_state=0).fit(street).score_samples(street[:100]),
        expected,
        rtol=1e-9,
    )


def test_neighborhoods_are_those_of_sorting_all_distances(street):
    detector = MCMDOutlierDetector(random_state=0).fit(street)
    index = detector._model.index
    found, _ = index.query(street[:20])
    for query, row in zip(street[:20], found, strict=True):
        expected = street[neighborhood(street, query, 50)]
        assert_allclose(
            np.linalg.norm(index.points[row] - query, axis=1),
            np.linalg.norm(expected - query, axis=1),
        )


def test_a_borrowed_plane_is_no_wider_than_the_own_one():
    """A point is its own first neighbor: by its own plane, borrowed, it must score the same."""
    from sklearn_mcmd.outliers._judging import COMMON, Judge, judge
    from sklearn_mcmd.planes._explaining import Credibility
    from sklearn_mcmd.planes._record import Neighborhoods, Planes

    plane = Planes.empty(1, 3)
    for values, value in zip(plane, [0, [0, 0, 1.0], [0, 1, 1], 0.01, 1, 1, 0.5, 1], strict=True):
        values[:] = value
    around = Neighborhoods(np.zeros((1, 1), dtype=np.int32), np.array([1]))
    judge_ = Judge(COMMON, 0.01, 2.0, True, Credibility(1.0))
    for compiled in (False, True):
        scores, _, _ = judge(
            judge_, np.array([[0.1, 0, 0.035]]), plane, np.array([9.0]), np.array([0.01]),
            around, plane, np.array([True]), compiled,
        )  # fmt: skip
        np.testing.assert_allclose(scores, 0.035 / np.hypot(0.01, 0.01), rtol=1e-12)
