"""What is proved of a part of a cloud holds in the whole cloud."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from sklearn_mcmd import RobustNormalEstimator
from sklearn_mcmd.datasets import make_street
from sklearn_mcmd.planes._certificate import proved_points, reaches, to_border


@pytest.fixture(scope="module")
def cloud():
    return make_street(9_000, outlier_share=0.05, random_state=0).data


@pytest.mark.parametrize(
    ("params", "levels"),
    [({}, 2), ({"neighbor_planes": False}, 1), ({"reweight": False}, 0), ({"radius": 0.3}, 2)],
    ids=str,
)
def test_proved_normals_are_those_of_the_whole_cloud(cloud, params, levels):
    estimator = RobustNormalEstimator(30, random_state=0, **params)
    assert estimator._locality() == (levels, 30)
    whole = estimator.fit(cloud).normals_
    low, high = np.full(3, -np.inf), np.full(3, np.inf)
    low[0] = np.quantile(cloud[:, 0], 0.3)
    part = ((cloud >= low) & (cloud < high)).all(axis=1)
    normals = estimator.fit(cloud[part]).normals_
    index = estimator._model.index
    exact = reaches(index) < to_border(index.points, low, high)
    proved = proved_points(index, exact, levels)[index.places]
    assert_array_equal(normals[proved], whole[part][proved])
    assert 0.3 < proved.mean() < 1.0
    assert (normals[~proved] != whole[part][~proved]).any()


def test_more_levels_prove_fewer_points(cloud):
    estimator = RobustNormalEstimator(30, random_state=0).fit(cloud)
    index = estimator._model.index
    exact = reaches(index) < to_border(index.points, np.full(3, 1.0), np.full(3, np.inf))
    proved = [proved_points(index, exact, levels) for levels in range(4)]
    assert_array_equal(proved[0], exact)
    for fewer, more in zip(proved[1:], proved, strict=False):
        assert (fewer <= more).all()
        assert fewer.sum() < more.sum()


def test_a_radius_is_reached_where_no_neighbor_is(cloud):
    estimator = RobustNormalEstimator(30, radius=0.05, random_state=0).fit(cloud)
    assert (reaches(estimator._model.index) >= 0.05 - 1e-12).mean() > 0.9


def test_a_cloud_without_border_is_proved():
    points = np.random.default_rng(0).normal(size=(50, 3))
    assert (to_border(points, np.full(3, -np.inf), np.full(3, np.inf)) == np.inf).all()
