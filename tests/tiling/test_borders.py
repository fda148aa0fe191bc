"""What cells that overlap say of each other: sides of normals, and regions that are one."""

import csv

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from sklearn.metrics import adjusted_rand_score

from sklearn_mcmd import RegionGrowing, RobustNormalEstimator
from sklearn_mcmd.datasets import make_box, make_crown_roof, make_street
from sklearn_mcmd.io import read_points
from sklearn_mcmd.tiling._borders import _signs
from tiled import fit_in_memory, street, values_of, written

CURVATURES = ["mean_curvature", "max_curvature", "max_curvature_direction"]
TREE = RobustNormalEstimator(16, orientation="mst", features=CURVATURES, random_state=0)
REGIONS = RegionGrowing(20, normal_estimator=RobustNormalEstimator(24, random_state=0))


def sphere():
    X = np.random.default_rng(0).normal(size=(5_000, 3))
    return X / np.linalg.norm(X, axis=1)[:, None] * [1.0, 1.0, 0.8]


def two_spheres():
    return np.vstack([sphere()[:2_500], sphere()[2_500:] + np.array([0, 9, 3])])


@pytest.mark.parametrize(
    "make", [lambda: street(5_000), sphere, two_spheres, lambda: make_box(5_000).data]
)
def test_sides_and_what_flips_with_them_are_those_of_the_tree_of_memory(make, by_tiles, tmp_path):
    path = written(tmp_path, make())
    expected = values_of(fit_in_memory(read_points(path).xyz, TREE))
    values, proven, _, report = by_tiles(path, TREE, tile_size=1_500)
    assert report.n_tiles >= 4
    assert proven.mean() > 0.9
    same = (values[:, : expected.shape[1]] == expected).all(axis=1)
    assert same[proven].mean() > 0.999


def test_parts_agree_along_the_tree_of_the_most_votes_with_the_highest():
    """The third contradicts the first two, with fewer votes; the fourth and fifth are apart."""
    pairs = np.array([[0, 0, 1, 2, 3], [1, 1, 2, 0, 4]])
    signs = _signs(pairs, np.array([-3.0, -2.0, 4.0, 0.5, -0.1]), np.array([1.0, 5, 2, 7, 3]))
    assert_array_equal(signs, [-1, 1, 1, 1, -1])
    assert_array_equal(_signs(np.empty((2, 0), int), np.empty(0), np.zeros(3)), np.ones(3))


def table_of(path):
    with open(path, newline="") as file:
        rows = list(csv.DictReader(file))
    numbers = ("points", "normal_x", "normal_y", "normal_z", "rms", "area", "centroid_z")
    return {name: np.array([float(row[name]) for row in rows]) for name in numbers} | {
        "kind": [row["kind"] for row in rows]
    }


@pytest.mark.parametrize("tile_size", [9_000, 2_000])
def test_regions_and_their_table_are_those_of_memory(tile_size, by_tiles, tmp_path):
    """Of a street: four large planes, which are those of a roof, a road and two fronts."""
    X = make_street(8_000, outlier_share=0.03, random_state=0).data
    path, table = written(tmp_path, X), tmp_path / "regions.csv"
    fitted = fit_in_memory(read_points(path).xyz, REGIONS)
    values, _, _, report = by_tiles(path, REGIONS, tile_size=tile_size, regions=table)
    found, expected = table_of(table), fitted.regions_
    assert len(found["points"]) == report.n_regions
    sizes = np.bincount(values[values >= 0].astype(int))
    assert_array_equal(np.sort(sizes)[::-1], sizes)  # numbers are by size
    assert list(report.largest) == sizes[:20].tolist()
    assert_array_equal(found["points"], sizes)
    if tile_size > 8_000:
        assert_array_equal(values[:, 0], fitted.labels_)
    assert adjusted_rand_score(values[:, 0], fitted.labels_) > 0.98
    large = np.flatnonzero(expected["points"] > 300)
    assert len(large) >= 3
    for i in large:
        (one,) = np.flatnonzero(np.bincount(values[fitted.labels_ == i, 0].astype(int)) > 150)
        normal = [found[f"normal_{axis}"][one] for axis in "xyz"]
        assert np.abs(expected["normal"][i] @ normal) > np.cos(np.radians(0.5))
        assert found["kind"][one] == expected["kind"][i]
        for name in ("points", "area", "rms"):
            assert_allclose(found[name][one], expected[name][i], rtol=0.05)


def test_a_region_runs_through_many_cells_and_small_parts_of_it_count(by_tiles, tmp_path):
    X = np.random.default_rng(0).uniform(0, 1, (3_000, 3)) * [60, 1, 0.004]
    values, _, _, report = by_tiles(written(tmp_path, X), REGIONS, tile_size=100)
    assert report.n_tiles >= 30
    assert report.n_regions == 1
    assert (values >= 0).mean() > 0.98


def test_faces_of_a_roof_stay_apart_in_cells(by_tiles, tmp_path):
    path = written(tmp_path, make_crown_roof(4_000, random_state=0).data)
    values, _, _, report = by_tiles(path, REGIONS, tile_size=1_200)
    fitted = fit_in_memory(read_points(path).xyz, REGIONS)
    assert abs(report.n_regions - fitted.n_regions_) <= 1
    assert adjusted_rand_score(values[:, 0], fitted.labels_) > 0.95
