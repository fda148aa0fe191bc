"""Links between neighbors: the compiled form is that of NumPy."""

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


@pytest.mark.parametrize("mutual", [True, False])
@pytest.mark.parametrize("name", adversarial_clouds())
def test_compiled_and_numpy_links_agree_on_adversarial_clouds(name, mutual, monkeypatch):
    X = adversarial_clouds()[name]
    columns = split_columns(RobustNormalEstimator(20, random_state=0).fit_transform(X))
    answers = []
    rules = GrowthRules(0.96, mutual=mutual)
    for compile_from in (1, len(X) + 1):
        monkeypatch.setattr("sklearn_mcmd.segmentation._graph.COMPILE_FROM", compile_from)
        index = NeighborIndex(X, 16)
        planes = columns.planes(index.rows)
        # The floor that the estimator gives keeps apart what rounding alone would decide.
        floor = 1e-13 * np.abs(index.points).max(axis=1) + 1e-9
        planes.scale[:] += floor
        links, _ = link_neighbors(index, planes, floor, rules)
        seeds = np.argsort(columns.surface_variation[index.rows], kind="stable")
        answers.append((links, grow_regions(links, seeds)))
    (links, labels), (links_numpy, labels_numpy) = answers
    assert_array_equal(links, links_numpy)
    assert_array_equal(labels, labels_numpy)


@pytest.mark.parametrize(("name", "mutual"), [("CUTOFF", True), ("N_DEVIATIONS", False)])
def test_compiled_links_notice_an_edited_constant(name, mutual, monkeypatch):
    # Constants that a kernel imports are frozen when it is compiled, and by Numba's cache for good.
    X = adversarial_clouds()["a national grid"]
    columns = split_columns(RobustNormalEstimator(20, random_state=0).fit_transform(X))
    index = NeighborIndex(X, 16)
    planes = columns.planes(index.rows)
    planes.scale[:] = 1e-3
    rules = GrowthRules(0.96, mutual=mutual)

    def links(compile_from):
        monkeypatch.setattr("sklearn_mcmd.segmentation._graph.COMPILE_FROM", compile_from)
        return link_neighbors(index, planes, 1e-9 * planes.scale, rules)[0]

    before = links(1)
    monkeypatch.setattr(f"sklearn_mcmd.segmentation._graph.{name}", 0.5)
    after = links(1)
    assert np.count_nonzero(after >= 0) < 0.9 * np.count_nonzero(before >= 0)
    assert_array_equal(after, links(len(X) + 1))


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
