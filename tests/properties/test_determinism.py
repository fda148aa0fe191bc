"""Threads, chunks, backends and processes change no bit of any result."""

import multiprocessing
import pickle
import sys
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from itertools import pairwise

import joblib
import numpy as np
import pytest

from public import CLOUDS, ESTIMATORS, cloud_for, expected_results, fitted, results
from sklearn_mcmd import RegionGrowing, RobustNormalEstimator, SharpFeatureDetector
from sklearn_mcmd.baselines import PlaneOutlierDetector

# How many rows are worked on at once, wherever a module says so; and from how many in order.
CHUNKS = {
    "CHUNK": 97,
    "AT_ONCE": 2_000,
    "ROWS_AT_ONCE": 53,
    "POINTS_AT_ONCE": 61,
    "ORDER_FROM": 100,
}

# Modules whose chunks are of neighbors: ten times as many are those of some 20 points.
OF_NEIGHBORS = ("_local_planes", "_crease_distance", "_assign_points", "_narrow_faces")
RANSAC = repr(PlaneOutlierDetector(random_state=0))  # which is not compiled
SLOW = pytest.mark.slow


def pairs_of_a_class():
    """Names of estimators of one class with different parameters, each beside another."""
    names = sorted(ESTIMATORS)
    pairs = [(a, b) for a, b in pairwise(names) if type(ESTIMATORS[a]) is type(ESTIMATORS[b])]
    return pairs + [(b, a) for a, b in pairs]


def assert_equal(found, expected):
    assert found.keys() == expected.keys()
    for name, value in found.items():
        np.testing.assert_array_equal(value, expected[name], err_msg=name)


@pytest.fixture
def small_chunks(monkeypatch, name, size):
    expected_results(name, size)  # of chunks as they are
    patched = set()
    for module in [m for name, m in sys.modules.items() if name.startswith("sklearn_mcmd.")]:
        for constant in CHUNKS.keys() & vars(module).keys():
            times = 10 if module.__name__.endswith(OF_NEIGHBORS) else 1
            monkeypatch.setattr(module, constant, times * CHUNKS[constant])
            patched.add(constant)
    assert patched == CHUNKS.keys()


def with_jobs(name, n_jobs):
    estimator = ESTIMATORS[name]
    if "n_jobs" not in estimator.get_params():
        pytest.skip("it has no n_jobs")
    return type(estimator)(**{**estimator.get_params(deep=False), "n_jobs": n_jobs})


@pytest.mark.parametrize("name", ESTIMATORS)
def test_threads_change_nothing(name):
    X = cloud_for(name, "compiled")
    found = results(fitted(with_jobs(name, 2), X), X)
    assert_equal(found, expected_results(name, "compiled"))


@pytest.mark.parametrize(
    ("name", "size"),
    [(n, size) for n in ESTIMATORS for size in CLOUDS if (n, size) != (RANSAC, "compiled")],
)
def test_chunks_change_nothing(name, size, small_chunks):
    """But rounding of sums in adjustments, whose order is that of chunks."""
    X = cloud_for(name, size)
    estimator = ESTIMATORS[name]
    if "n_jobs" in estimator.get_params():
        estimator = with_jobs(name, 2)
    found, expected = results(fitted(estimator, X), X), expected_results(name, size)
    for attribute, value in found.items():
        one_plane = hasattr(estimator, "sigma0") and value.dtype.kind == "f"
        atol = 1e-12 * np.abs(value).max() if one_plane else 0
        np.testing.assert_allclose(value, expected[attribute], 0, atol, err_msg=attribute)


def test_backends_change_nothing():
    with joblib.parallel_config("loky", n_jobs=2):
        for name, estimator in ESTIMATORS.items():
            X = cloud_for(name)
            assert_equal(results(fitted(estimator, X), X), expected_results(name, "small"))


def test_threads_that_fit_at_once_change_nothing():
    def work(name):
        X = cloud_for(name)  # one array for all
        return results(fitted(ESTIMATORS[name], X), X)

    names = [*ESTIMATORS]
    with ThreadPoolExecutor(4) as pool:
        for name, found in zip(names, pool.map(work, names), strict=True):
            assert_equal(found, expected_results(name, "small"))


@pytest.mark.parametrize("name", ESTIMATORS)
def test_two_fits_and_a_pickle_are_the_same(name):
    X = cloud_for(name)
    estimator = fitted(ESTIMATORS[name], X)
    expected = results(estimator, X, new=X[::7] + 0.01)
    if {"labels_", "predicted"} <= expected.keys():  # a detector's
        np.testing.assert_array_equal(expected["labels_"], expected["predicted"])
    copy = pickle.loads(pickle.dumps(estimator))
    assert_equal(results(copy, X, new=X[::7] + 0.01), expected)
    assert_equal(results(estimator.fit(X), X, new=X[::7] + 0.01), expected)


@pytest.mark.parametrize(("before", "now"), pairs_of_a_class())
def test_nothing_is_left_of_a_fit_with_other_parameters(before, now):
    X = cloud_for(now)
    used, expected = fitted(ESTIMATORS[before], X), fitted(ESTIMATORS[now], X)
    used.set_params(**expected.get_params(deep=False)).fit(X)
    assert vars(used).keys() == vars(expected).keys()


@pytest.mark.parametrize("kind", [SharpFeatureDetector, RegionGrowing])
def test_planes_that_are_given_leave_no_steps_of_an_earlier_fit(kind):
    X = np.random.default_rng(0).normal(size=(200, 3)) * [1, 1, 0.01]
    used = kind(random_state=0).fit(X)
    given = {"normals": "precomputed"}
    given |= {"outlier_detector": "passthrough"} if kind is SharpFeatureDetector else {}
    used.set_params(**given).fit(RobustNormalEstimator(random_state=0).fit_transform(X))
    assert not hasattr(used, "normal_estimator_")
    assert not hasattr(used, "outlier_detector_")


def elsewhere(pickled):
    """Results of pickled clouds and fitted estimators: as they came, and fitted again."""
    from public import fitted, results

    return [
        (results(estimator, X), results(fitted(estimator, X), X))
        for estimator, X in pickle.loads(pickled)
    ]


@pytest.mark.parametrize("start", [None, *(pytest.param(s, marks=SLOW) for s in ("fork", "spawn"))])
@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # fork beside threads
def test_another_process_has_the_same_results(start):
    """Of loky, where no way to start it is named."""
    pickled = pickle.dumps(
        [(fitted(e, cloud_for(name)), cloud_for(name)) for name, e in ESTIMATORS.items()]
    )
    if start is None:
        (answer,) = joblib.Parallel(2, "loky")([joblib.delayed(elsewhere)(pickled)])
    elif start not in multiprocessing.get_all_start_methods():
        pytest.skip(f"there is no {start} here")
    else:
        with ProcessPoolExecutor(1, multiprocessing.get_context(start)) as pool:
            answer = pool.submit(elsewhere, pickled).result()
    for name, found in zip(ESTIMATORS, answer, strict=True):
        for result in found:
            assert_equal(result, expected_results(name, "small"))
