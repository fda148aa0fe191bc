"""What cells that overlap say of each other: sides of normals, and regions that are one."""

import csv

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from sklearn.metrics import adjusted_rand_score

from sklearn_mcmd import RegionGrowing
from sklearn_mcmd.datasets import make_box, make_crown_roof, make_street
from sklearn_mcmd.io import read_points
from tiled import REGIONS, TREE, fit_in_memory, street, values_of, written


def two_spheres():
    X = np.random.default_rng(0).normal(size=(5_000, 3))
    X *= [1.0, 1.0, 0.8] / np.linalg.norm(X, axis=1)[:, None]
    return np.vstack([X[:2_500], X[2_500:] + np.array([0, 9, 3])])


@pytest.mark.parametrize("make", [lambda: street(5_000), two_spheres])
def test_sides_and_what_flips_with_them_are_those_of_the_tree_of_memory(make, by_tiles, tmp_path):
    path = written(tmp_path, make())
    expected = values_of(fit_in_memory(read_points(path).xyz, TREE))
    values, proven, _, report = by_tiles(path, TREE, tile_size=1_500)
    assert report.n_tiles >= 4
    assert proven.mean() > 0.9
    same = (values[:, : expected.shape[1]] == expected).all(axis=1)
    assert same[proven].mean() > 0.999


def test_regions_of_cells_and_their_table_are_nearly_those_of_memory(by_tiles, tmp_path):
    """Of a street: four large planes, which are those of a roof, a road and two fronts."""
    X = make_street(8_000, outlier_share=0.03, random_state=0).data
    path, table = written(tmp_path, X), tmp_path / "regions.csv"
    fitted = fit_in_memory(read_points(path).xyz, REGIONS)
    values, _, _, report = by_tiles(path, REGIONS, tile_size=2_000, regions=table)
    with open(table, newline="") as file:
        found = list(csv.DictReader(file))
    sizes = np.bincount(values[values >= 0].astype(int))
    assert_array_equal(np.sort(sizes)[::-1], sizes)  # numbers are by size
    assert [int(row["points"]) for row in found] == sizes.tolist()
    assert (report.n_regions, report.n_inside) == (len(sizes), sizes.sum())
    assert list(report.largest) == sizes[:20].tolist()
    assert adjusted_rand_score(values[:, 0], fitted.labels_) > 0.98
    large = fitted.regions_[fitted.regions_["points"] > 300]
    assert len(large) >= 3
    for i, expected in enumerate(large):
        (one,) = np.flatnonzero(np.bincount(values[fitted.labels_ == i, 0].astype(int)) > 150)
        normal = [float(found[one][f"normal_{axis}"]) for axis in "xyz"]
        assert np.abs(expected["normal"] @ normal) > np.cos(np.radians(0.5))
        assert found[one]["kind"] == expected["kind"]
        for name in ("points", "area", "rms"):
            assert_allclose(float(found[one][name]), expected[name], rtol=0.05)


def test_a_region_runs_through_many_cells_and_small_parts_of_it_count(by_tiles, tmp_path):
    X = np.random.default_rng(0).uniform(0, 1, (1_500, 3)) * [30, 1, 0.004]
    values, _, _, report = by_tiles(written(tmp_path, X), REGIONS, tile_size=100)
    assert report.n_tiles >= 15
    assert report.n_regions == 1
    assert (values >= 0).mean() > 0.98


def test_faces_of_a_roof_stay_apart_in_cells(by_tiles, tmp_path):
    path = written(tmp_path, make_crown_roof(4_000, random_state=0).data)
    values, _, _, report = by_tiles(path, REGIONS, tile_size=1_200)
    fitted = fit_in_memory(read_points(path).xyz, REGIONS)
    assert abs(report.n_regions - fitted.n_regions_) <= 1
    assert adjusted_rand_score(values[:, 0], fitted.labels_) > 0.95


def test_faces_that_touch_stay_apart_where_another_cell_sees_little_of_one(by_tiles, tmp_path):
    """Such a cell has an end of a face of a box in its own, and would join all."""
    path = written(tmp_path, make_box(6_000, random_state=2).data)
    values, _, _, report = by_tiles(path, RegionGrowing(16, random_state=0), tile_size=700)
    fitted = fit_in_memory(read_points(path).xyz, RegionGrowing(16, random_state=0))
    assert report.n_regions == fitted.n_regions_
    assert adjusted_rand_score(values[:, 0], fitted.labels_) > 0.99


def test_arms_of_a_floor_that_meet_in_another_cell_are_one(by_tiles, tmp_path):
    X = np.random.default_rng(0).uniform(0, 1, (6_000, 3)) * [4, 3, 0.004]
    X = X[(np.abs(X[:, 0] - 2) > 0.2) | (X[:, 1] > 2.5)]
    values, _, _, report = by_tiles(written(tmp_path, X), REGIONS, tile_size=700)
    assert report.n_regions == 1
    assert (values >= 0).mean() > 0.98
