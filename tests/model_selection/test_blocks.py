"""Splits of clouds: blocks are whole, and verdicts within a fold are those of the whole cloud."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from sklearn.neighbors import NearestNeighbors

from sklearn_mcmd import MCMDOutlierDetector
from sklearn_mcmd.datasets import make_street
from sklearn_mcmd.model_selection import SpatialBlockSplit, spatial_blocks


@pytest.fixture(scope="module")
def street():
    cloud = make_street(900, random_state=0)
    return cloud.data, cloud.target


def test_every_point_is_tested_once_and_within_its_training_points(street):
    X, _ = street
    tested, cv = [], SpatialBlockSplit(4, random_state=0)
    assert cv.get_n_splits() == 4
    for train, test in cv.split(X):
        assert np.isin(test, train).all()
        assert len(np.unique(train)) == len(train)
        tested.append(test)
        assert len(train) < 0.9 * len(X)
    assert_array_equal(np.sort(np.concatenate(tested)), np.arange(len(X)))
    again, by_seed = (next(SpatialBlockSplit(4, random_state=s).split(X))[1] for s in (0, 1))
    assert_array_equal(tested[0], again)
    assert not np.array_equal(tested[0], by_seed)


def test_a_test_point_finds_all_its_neighbors_among_the_training_points(street):
    X, _ = street
    expected = NearestNeighbors(n_neighbors=25).fit(X).kneighbors(X)[0]
    for train, test in SpatialBlockSplit(3, n_neighbors=25, random_state=1).split(X):
        distances = NearestNeighbors(n_neighbors=25).fit(X[train]).kneighbors(X[test])[0]
        assert_allclose(distances, expected[test], rtol=1e-12)


def test_with_three_rings_the_default_judges_a_block_nearly_as_in_the_whole_cloud():
    X = make_street(3000, random_state=0).data
    detector = MCMDOutlierDetector(30, random_state=0)
    whole = detector.fit(X)
    expected, labels = whole.score_samples(X), whole.predict(X)
    scores, judged = np.empty(len(X)), np.empty(len(X))
    for train, test in SpatialBlockSplit(3, n_neighbors=30, n_rings=3, random_state=0).split(X):
        scores[test] = detector.fit(X[train]).score_samples(X[test])
        judged[test] = detector.predict(X[test])
    # .996 and 1 when measured.
    assert np.isclose(scores, expected, rtol=1e-9).mean() > 0.98
    assert (judged == labels).mean() > 0.998


@pytest.mark.parametrize("n_blocks", [1, 2, 7, 16])
def test_blocks_hold_nearly_equal_numbers_of_points(street, n_blocks):
    X, _ = street
    sizes = np.bincount(spatial_blocks(X, n_blocks), minlength=n_blocks)
    assert len(sizes) == n_blocks
    assert np.ptp(sizes) <= np.ceil(np.log2(n_blocks))


def test_blocks_are_boxes_apart(street):
    X, _ = street
    blocks = spatial_blocks(X, 6)
    for a in range(6):
        for b in range(a):
            first, second = X[blocks == a], X[blocks == b]
            gap = np.maximum(first.min(0) - second.max(0), second.min(0) - first.max(0))
            assert gap.max() >= 0
    square = np.random.default_rng(0).random((400, 2))
    blocks = spatial_blocks(square, 4)  # halved, and halved again
    assert max(np.ptp(square[blocks == block], axis=0).max() for block in range(4)) < 0.7


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"n_splits": 1}, "n_splits=1 is too few: at least 2"),
        ({"n_neighbors": 101}, "n_neighbors=101 is too many for n_samples=100"),
        ({"n_rings": 0}, "n_rings=0 is too few"),
        ({"n_neighbors": 2.5}, "n_neighbors=2.5 must be an integer"),
        ({"n_splits": 26}, "n_splits=26 is too many for n_samples=100"),
    ],
)
def test_a_bad_parameter_is_named(parameters, message):
    X = np.random.default_rng(0).normal(size=(100, 3))
    with pytest.raises(ValueError, match=message):
        next(SpatialBlockSplit(**parameters).split(X))


@pytest.mark.parametrize(
    ("X", "n_blocks", "message"),
    [
        ([[0.0, np.nan], [1.0, 1.0]], 2, "NaN"),
        ([[0.0, 1.0], [1.0, 1.0]], 3, "n_blocks=3 is more than n_samples=2"),
    ],
)
def test_blocks_reject_missing_values_and_too_few_points(X, n_blocks, message):
    with pytest.raises(ValueError, match=message):
        spatial_blocks(X, n_blocks)
