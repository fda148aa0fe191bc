"""What a cloud is like, compared with what it was made of."""

import numpy as np
import pytest

from sklearn_mcmd.io import PointCloud
from sklearn_mcmd.report._facts import Facts, distinct_points


def raster(n=40, step=0.5):
    x, y = np.meshgrid(np.arange(n) * step, np.arange(n) * step)
    return np.column_stack([x.ravel(), y.ravel(), np.zeros(n * n)])


def test_spacing_copies_and_step_of_a_raster_are_those_it_was_made_with():
    xyz = np.vstack([raster(), raster()[:100]])
    xyz[:, 2] = xyz[:, 0]  # of one level no step is known
    facts = Facts.of(xyz, 9, np.array([0.1, np.nan, 0.3, 0.2]))
    assert (facts.n_points, facts.n_distinct) == (1700, 1600)
    assert (facts.spacing, facts.step, facts.noise) == (0.5, 0.5, 0.2)
    assert facts.radius == pytest.approx(0.5 * np.sqrt(3))  # eight neighbors, where z = x
    assert facts.near.all()
    assert np.isnan(Facts.of(xyz, 9).noise)
    assert Facts.of(np.zeros((1, 3)), 50).n_distinct == 1
    assert Facts.of(np.array([[0.0, 0, 0], [3, 4, 0]]), 50).spacing == 5


def test_distinct_points_are_each_place_once():
    xyz = np.array([[1.0, 2, 3], [0, 0, 0], [1, 2, 3], [1, 2, 4]])
    assert distinct_points(xyz).tolist() == [[0, 0, 0], [1, 2, 3], [1, 2, 4]]


def test_only_points_farther_away_than_the_cloud_is_wide_are_far():
    xyz = np.vstack([raster(), [[500.0, 0, 0], [25, 0, 0]]])
    assert np.flatnonzero(~Facts.of(xyz, 9).near).tolist() == [1600]


@pytest.mark.parametrize(("offset", "coarse"), [(0.0, False), (5e6, True)])
def test_float32_is_coarse_far_from_the_origin_only(offset, coarse):
    rng = np.random.default_rng(0)
    xyz = (rng.uniform(size=(2000, 3)) + offset).astype(np.float32).astype(np.float64)
    assert (Facts.of(xyz, 50).rounding > 0) == coarse


def test_rows_have_bounds_and_attributes():
    cloud = PointCloud(
        raster() + np.array([1000, 2000, 3]), {"intensity": np.arange(1600)}, n_dropped=2
    )
    rows = dict(Facts.of(cloud.xyz, 9).rows(cloud))
    assert (rows["points"], rows["attributes"]) == ("1,600", "intensity")
    assert rows["left out"].startswith("2 ")
    assert rows["x"] == "1000.0000 to 1019.5000 (extent 19.5000)"
    assert rows["duplicates"] == "0 (0.00 %)"
