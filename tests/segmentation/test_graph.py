"""Links between neighbors and what grows along them, against NumPy and sets."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from benchmarks._ablation_changes import changed
from sklearn_mcmd import RobustNormalEstimator
from sklearn_mcmd.planes._columns import split_columns
from sklearn_mcmd.planes._neighborhoods import NeighborIndex
from sklearn_mcmd.segmentation._graph import (
    GrowthLimits,
    GrowthRules,
    grow_regions,
    link_neighbors,
)


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


def links_by_numpy(index, planes, floor, rules):
    """What `link_neighbors` tells, whole arrays at a time."""
    rows = np.arange(len(index.points))
    near = index.query_own(rows, index.n_neighbors // 2 + 1).indices
    gaps = index.points[near] - index.points[:, None]
    normals = planes.normals[:, None]
    height = np.abs(((index.points[near] - planes.centroids[:, None]) * normals).sum(axis=2))
    middle = np.median(height, axis=1, keepdims=True)
    limit = middle + 2 * 1.4826 * np.median(np.abs(height - middle), axis=1, keepdims=True)
    limit += floor[:, None]
    fits = (near != rows[:, None]) & (height <= limit)
    if rules.mutual:
        back = ((index.points[:, None] - planes.centroids[near]) * planes.normals[near]).sum(axis=2)
        usual = np.sort(planes.scale[near], axis=1)[:, near.shape[1] // 4]
        radius = np.linalg.norm(gaps, axis=2).max(axis=1)
        bent = np.arccos(rules.min_cosine) * radius / 8
        quiet = planes.scale <= (1 + 3 / np.sqrt(2 * index.n_neighbors)) * np.hypot(usual, bent)
        fits &= (np.abs(back) <= limit[near, 0]) & quiet[:, None]
    fits &= np.abs((planes.normals[near] * normals).sum(axis=2)) >= rules.min_cosine
    links = np.take_along_axis(
        np.where(fits, near, -1), np.argsort(~fits, axis=1, kind="stable"), axis=1
    )
    return links, np.linalg.norm(gaps, axis=2).max(axis=1)


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


@pytest.mark.parametrize(("k", "mutual"), [(16, False), (17, True)])
@pytest.mark.parametrize("name", adversarial_clouds())
def test_links_and_regions_are_those_of_numpy_on_adversarial_clouds(name, k, mutual):
    X = adversarial_clouds()[name]
    columns = split_columns(RobustNormalEstimator(20, random_state=0).fit_transform(X))
    index = NeighborIndex(X, k)
    planes = columns.planes(index.rows)
    # The floor that the estimator gives keeps apart what rounding alone would decide.
    floor = 1e-13 * np.abs(index.points).max(axis=1) + 1e-9
    rules = GrowthRules(0.96, mutual=mutual)
    links, radius = link_neighbors(index, planes, floor, rules)
    expected, farthest = links_by_numpy(index, planes, floor, rules)
    assert_array_equal(links, expected)
    assert_allclose(radius, farthest, rtol=1e-12)
    seeds = np.argsort(columns.surface_variation[index.rows], kind="stable")
    assert_array_equal(grow_regions(links, seeds), grown_by_sets(links, seeds))


def test_links_notice_an_edited_constant():
    # Constants that a kernel imports are frozen when it is compiled, and by Numba's cache for good.
    X = adversarial_clouds()["a national grid"]
    columns = split_columns(RobustNormalEstimator(20, random_state=0).fit_transform(X))
    index = NeighborIndex(X, 16)
    planes, found = columns.planes(index.rows), []
    for n_deviations in (2.0, 0.5):
        with changed(GrowthLimits, n_deviations=n_deviations):
            links, _ = link_neighbors(index, planes, 1e-9 * planes.scale, GrowthRules(0.96))
        found.append(np.count_nonzero(links >= 0))
    assert found[1] < 0.9 * found[0]
