"""The cutoff of a rate learnt from the cloud itself: its parts, and what clean scans lose."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from scipy.stats import binom

from scenes import sphere
from sklearn_mcmd import MCMDOutlierDetector
from sklearn_mcmd.datasets import (
    make_airborne_scan,
    make_lidar_turn,
    make_mobile_scan,
    make_street,
)
from sklearn_mcmd.outliers._rehearsal import PARTS, n_parts_of, parts_of, shuffled

CLEAN = {"outlier_share": 0.0, "random_state": 3}
SCENES = {
    "street": lambda: make_street(8_000, **CLEAN).data,
    "spacing grows": lambda: make_street(8_000, spacing_growth=3.4, tree=True, **CLEAN).data,
    "scan lines": lambda: make_street(8_000, sampling="scan_lines", tree=True, **CLEAN).data,
    "sphere": lambda: sphere(4_000)[0],
    "turn": lambda: make_lidar_turn(8_000, **CLEAN).data,
    "mobile": lambda: make_mobile_scan(8_000, far_share=0, **CLEAN).data,
    "airborne": lambda: make_airborne_scan(8_000, far_share=0, **CLEAN).data,
}


def most(rate, n):
    """A share of n points that so many independent ones exceed once in ten thousand clouds.

    Of twice the rate: two tails are bounded, that of noise and that of things.
    """
    return binom.ppf(1 - 1e-4, n, 2 * rate) / n


@pytest.mark.parametrize("strictness", ["isolated", "groups"])
@pytest.mark.parametrize("scene", SCENES)
def test_clean_scans_lose_no_more_than_twice_the_stated_rate(scene, strictness):
    X, rate = SCENES[scene](), 0.02
    detector = MCMDOutlierDetector(
        strictness=strictness, false_positive_rate=rate, random_state=0
    ).fit(X)
    assert (detector.scores_ < detector.offset_).mean() <= most(rate, len(X))


def test_a_scan_of_thin_things_asks_for_a_larger_cutoff_than_a_plane_of_its_noise():
    X = SCENES["turn"]()
    plane = MCMDOutlierDetector(strictness="surfaces", false_positive_rate=0.02, random_state=0)
    whole = MCMDOutlierDetector(false_positive_rate=0.02, random_state=0)
    assert -whole.fit(X).offset_ > -plane.fit(X).offset_ + 0.3
    assert_array_equal(whole.scores_, MCMDOutlierDetector(random_state=0).fit(X).scores_)


def test_the_sensors_position_counts_in_parts_too():
    turn = make_lidar_turn(8_000, **CLEAN)
    cutoffs = []
    for origins in (None, turn.viewpoints):
        detector = MCMDOutlierDetector(false_positive_rate=0.02, random_state=0)
        detector.fit(turn.data, sensor_origin=origins)
        cutoffs.append(-detector.offset_)
        assert (detector.scores_ < detector.offset_).mean() <= most(0.02, 8_000)
    assert cutoffs[1] < cutoffs[0]  # with it less is lost, and less has to be kept


def test_the_cutoff_does_not_depend_on_the_order_of_rows_or_on_threads():
    X = SCENES["airborne"]()
    order = np.random.default_rng(0).permutation(len(X))
    cutoffs = {
        MCMDOutlierDetector(false_positive_rate=0.02, random_state=0, n_jobs=n_jobs).fit(Y).offset_
        for Y, n_jobs in ((X, 1), (X[order], 2))
    }
    assert len(cutoffs) == 1


def test_outliers_are_found_all_the_same():
    rng = np.random.default_rng(0)
    X = SCENES["street"]()
    above = np.array([0.0, 0.0, 9.0])
    stray = rng.uniform(X.min(axis=0), X.max(axis=0), (80, 3)) + above
    detector = MCMDOutlierDetector(false_positive_rate=0.01, random_state=0)
    assert (detector.fit_predict(np.vstack([X, stray]))[-80:] == -1).all()


def test_parts_are_even_and_keep_copies_together():
    X = np.round(np.random.default_rng(0).normal(size=(8_000, 3)), 1)
    X[X == 0] *= -1  # -0.0 counts as 0.0
    kept = np.arange(len(X)) < 6_000
    parts = parts_of(X, kept, 50)
    assert (parts[~kept] == -1).all()
    sizes = np.bincount(parts[kept])
    assert len(sizes) == PARTS
    assert np.abs(sizes - 1500).max() < 250
    order = np.random.default_rng(1).permutation(len(X))
    assert_array_equal(parts_of(X[order], kept[order], 50), parts[order])
    assert_array_equal(shuffled(-np.zeros((50, 3))), shuffled(np.zeros((50, 3))))
    whole = np.random.default_rng(2).integers(0, 4_000, (8_000, 3)).astype(float)
    whole[:, :2] //= 1_000  # columns of a wall in whole millimeters are divided, too
    part = shuffled(whole) % np.uint64(4)
    for place in np.unique(whole[:, :2], axis=0):
        sizes = np.bincount(part[(whole[:, :2] == place).all(axis=1)].astype(int), minlength=4)
        assert sizes.min() > 0.15 * sizes.sum()
    assert_array_equal(shuffled(X * 1024), shuffled(X))
    assert_array_equal(shuffled(X.astype(np.float32)), shuffled(X.astype(np.float32).astype(float)))


@pytest.mark.parametrize(
    ("n", "k", "expected"),
    [(1_999, 50, 0), (2_000, 50, 2), (3_999, 50, 3), (10**6, 50, 4), (5_000, 200, 2), (900, 5, 0)],
)
def test_small_clouds_have_fewer_parts_or_none(n, k, expected):
    assert n_parts_of(n, k) == expected
