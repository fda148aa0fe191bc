"""Links between neighbors and what grows along them, against NumPy and sets."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from sklearn_mcmd import RobustNormalEstimator
from sklearn_mcmd.planes._columns import split_columns
from sklearn_mcmd.planes._neighborhoods import NeighborIndex
from sklearn_mcmd.segmentation._graph import GrowthRules, grow_regions, link_neighbors


def adversarial_clouds():
    rng = np.random.default_rng(0)
    grid = np.stack(np.meshgrid(range(50), range(50)), -1).reshape(-1, 2) * 0.01
    flat = np.column_stack([grid, np.zeros(2500)])
    return {
        "a perfect plane on a grid": flat,
        "coordinates in centimeters": np.round(
            np.column_stack([rng.uniform(0, 3, (2500, 2)), rng.normal(0, 0.004, 2500)]), 2
        ),
        "a national grid": flat + rng.normal(0, 1e-3, (2500, 3)) + [5e5, 5e6, 100],
        "copies": np.repeat(rng.uniform(0, 1, (1300, 3)) * [1, 1, 0.01], 2, axis=0),
        "a line": np.outer(np.linspace(0, 1, 2500), [1.0, 2.0, 3.0]),
    }


def links_by_numpy(points, around, planes, limits, usable, farthest, start, links):
    """What `link_rows` fills, whole arrays at a time."""
    rows, near = np.arange(start, start + len(links)), around.indices
    gaps = points[near] - points[rows][:, None]
    own, other = planes.normals[rows][:, None], planes.normals[near]
    fits = around.valid & (near != rows[:, None]) & usable[rows][:, None] & usable[near]
    fits &= np.linalg.norm(gaps, axis=2) <= limits.max_gap
    fits &= np.abs((other * own).sum(axis=2)) >= limits.min_cosine
    height = ((points[near] - planes.centroids[rows][:, None]) * own).sum(axis=2)
    fits &= np.abs(height) <= limits.explained * planes.scale[rows][:, None]
    height = ((points[rows][:, None] - planes.centroids[near]) * other).sum(axis=2)
    fits &= (np.abs(height) <= limits.explained * planes.scale[near]) | (not limits.mutual)
    found = np.where(fits, near, -1)
    links[:] = np.take_along_axis(found, np.argsort(~fits, axis=1, kind="stable"), axis=1)


def grown_by_sets(links, seeds):
    """Labels of regions: all that a seed reaches over points of no region."""
    labels, region = np.full(len(links), -1), 0
    for seed in seeds:
        waiting = {seed} if labels[seed] < 0 else set()
        while waiting:
            new = np.array(sorted(waiting))
            labels[new] = region
            waiting = {j for j in links[new].ravel() if j >= 0 and labels[j] < 0}
        region = labels.max() + 1
    return labels


@pytest.mark.parametrize("mutual", [True, False])
@pytest.mark.parametrize("name", adversarial_clouds())
def test_links_and_regions_are_those_of_numpy_on_adversarial_clouds(name, mutual, monkeypatch):
    X = adversarial_clouds()[name]
    columns = split_columns(RobustNormalEstimator(20, random_state=0).fit_transform(X))
    index = NeighborIndex(X, 16)
    planes = columns.planes(index.rows)
    # The floor that the estimator gives keeps apart what rounding alone would decide.
    floor = 1e-13 * np.abs(index.points).max(axis=1) + 1e-9
    planes.scale[:] += floor
    links, _ = link_neighbors(index, planes, floor, GrowthRules(0.96, mutual=mutual))
    monkeypatch.setattr("sklearn_mcmd.planes._linking._compiled", lambda _: links_by_numpy)
    expected, _ = link_neighbors(index, planes, floor, GrowthRules(0.96, mutual=mutual))
    assert_array_equal(links, expected)
    seeds = np.argsort(columns.surface_variation[index.rows], kind="stable")
    assert_array_equal(grow_regions(links, seeds), grown_by_sets(links, seeds))


@pytest.mark.parametrize(("name", "mutual"), [("CUTOFF", True), ("N_DEVIATIONS", False)])
def test_links_notice_an_edited_constant(name, mutual, monkeypatch):
    # Constants that a kernel imports are frozen when it is compiled, and by Numba's cache for good.
    X = adversarial_clouds()["a national grid"]
    columns = split_columns(RobustNormalEstimator(20, random_state=0).fit_transform(X))
    index = NeighborIndex(X, 16)
    planes = columns.planes(index.rows)
    planes.scale[:] = 1e-3
    found = []
    for _ in range(2):
        links, _ = link_neighbors(
            index, planes, 1e-9 * planes.scale, GrowthRules(0.96, mutual=mutual)
        )
        found.append(np.count_nonzero(links >= 0))
        monkeypatch.setattr(f"sklearn_mcmd.segmentation._graph.{name}", 0.5)
    assert found[1] < 0.9 * found[0]


def test_a_link_with_mutual_planes_goes_both_ways():
    X = adversarial_clouds()["a national grid"]
    columns = split_columns(RobustNormalEstimator(20, random_state=0).fit_transform(X))
    index = NeighborIndex(X, 16)
    planes = columns.planes(index.rows)
    links, _ = link_neighbors(index, planes, np.zeros(len(X)), GrowthRules(0.999))
    near = [set(index.tree.query(point, k=links.shape[1])[1][1:]) for point in index.points]
    linked = [set(row[row >= 0]) for row in links]
    assert sum(map(len, linked)) > 1000
    assert all(i in linked[j] for i in range(len(X)) for j in linked[i] if i in near[j])
