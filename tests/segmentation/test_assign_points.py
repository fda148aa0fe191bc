"""Who claims points without a region: as if all were asked in each round, in whatever parts."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from sklearn_mcmd.planes._explaining import ExplainLimits, explain
from sklearn_mcmd.planes._neighborhoods import NeighborIndex
from sklearn_mcmd.planes._record import Planes
from sklearn_mcmd.segmentation import _assign_points
from sklearn_mcmd.segmentation._assign_points import Claims
from sklearn_mcmd.segmentation._graph import GrowthRules

RULES = GrowthRules(min_cosine=0.9)


def strip(seed, n=600):
    """A long strip of points with planes of their own, of which the first have regions."""
    rng = np.random.default_rng(seed)
    index = NeighborIndex(rng.uniform(0, [9, 1, 0.02], (n, 3)), 10)
    points, planes = index.points, Planes.unknown(n, 3)
    planes.centroids[:], planes.normals[:] = points, [0, 0, 1]
    planes.scale[:], planes.radius[:] = rng.uniform(1e-3, 4e-3, n), rng.uniform(0.1, 0.5, n)
    labels = np.where(points[:, 0] < 2, rng.integers(0, 3, n), -1).astype(np.int32)
    return index, planes, labels


def literally(index, planes, labels, content=(), cutoff=None):
    """All points without a region are asked in each round; and how many rounds there are."""
    labels, n_rounds, cutoff = labels.copy(), 0, cutoff or ExplainLimits().explained
    while True:
        rest, usable = np.flatnonzero(labels < 0), (labels >= 0) & ~np.isin(labels, content)
        given = index.points[rest], index.query_own(rest), planes, usable, np.zeros(len(rest))
        owner, share = explain(*given)
        claimed = (owner >= 0) & (share <= cutoff)
        if not claimed.any():
            return labels, n_rounds
        labels[rest[claimed]], n_rounds = labels[owner[claimed]], n_rounds + 1


@pytest.mark.parametrize("rows", [2**16, 50, 1])
@pytest.mark.parametrize("seed", range(4))
def test_points_are_claimed_round_by_round(seed, rows, monkeypatch):
    monkeypatch.setattr(_assign_points, "CHUNK", 10 * rows)
    index, planes, labels = strip(seed)
    expected, n_rounds = literally(index, planes, labels, content=[1])
    assert n_rounds > 5
    assert (expected < 0).any()
    assert_array_equal(Claims(index, planes, RULES).assign_unlabeled(labels, [1]), expected)


def test_of_equal_planes_the_nearest_is_asked_in_each_round():
    """It claims the point by no rounding error; the next would, once it is claimed itself."""
    index = NeighborIndex(np.array([[0, 0, 0.03], [0.1, 0, 0], [0.25, 0, 0], [9, 9, 9]]), 3)
    row, near, next_one, far = np.argsort(index.points[:, 0])
    planes = Planes.unknown(4, 3)
    planes.centroids[:], planes.normals[:], planes.radius[:] = index.points, [0, 0, 1], 1.0
    planes.scale[[row, near, next_one, far]] = 1e-9, 0.01 * (1 - 1e-12), 0.01 * (1 + 1e-12), 1e-9
    labels = np.full(4, -1, np.int32)
    labels[near] = 0
    expected, n_rounds = literally(index, planes, labels)
    assert (n_rounds, expected[next_one], expected[row]) == (1, 0, -1)
    assert_array_equal(Claims(index, planes, RULES).assign_unlabeled(labels), expected)


def test_limits_that_are_given_take_the_place_of_those_of_planes():
    index, planes, labels = strip(0)
    rules = RULES._replace(max_distance=0.004, max_gap=0.3)
    given = planes._replace(scale=np.full(600, 0.004), radius=np.full(600, 0.3))
    expected, _ = literally(index, given, labels, cutoff=1.0)
    assert (expected != literally(index, planes, labels)[0]).any()
    assert_array_equal(Claims(index, planes, rules).assign_unlabeled(labels), expected)


def test_a_fragment_goes_to_the_region_that_claims_most_of_it():
    index, planes, _ = strip(0)
    planes.scale[:] = 1.0
    x = index.points[:, 0]
    labels = np.select([x < 4, x < 4.1, x < 8.9], [0, 1, 2], 3).astype(np.int32)
    assert 0 < np.count_nonzero(labels == 1) <= 10 >= np.count_nonzero(labels == 3) > 0
    left, right = (explain_share(index, planes, labels, region) for region in (0, 2))
    found = Claims(index, planes, RULES).absorb_fragments(labels.copy())
    assert set(found[labels == 1]) == {0 if left > 0.5 else 2 if right > 0.5 else 1}
    assert set(found[labels == 3]) == {2}
    assert_array_equal(found[labels == 0], 0)


def explain_share(index, planes, labels, region):
    """The share of the second region's points that a plane of a region explains best."""
    rows = np.flatnonzero(labels == 1)
    usable = (labels == 0) | (labels == 2)
    given = index.points[rows], index.query_own(rows), planes, usable, np.zeros(len(rows))
    return np.mean(labels[explain(*given)[0]] == region)


def test_a_cloud_without_regions_or_without_rest_stays_as_it_is():
    index, planes, _ = strip(0)
    claims = Claims(index, planes, RULES)
    for label in (-1, 0):
        labels = np.full(600, label, np.int32)
        for step in (claims.absorb_fragments, claims.assign_unlabeled):
            assert_array_equal(step(labels.copy()), labels)
