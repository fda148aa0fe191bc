"""Links between neighbors: the compiled form is that of NumPy."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from sklearn_mcmd import RobustNormalEstimator
from sklearn_mcmd.planes._neighborhoods import NeighborIndex
from sklearn_mcmd.segmentation._graph import grow_regions, link_neighbors


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


@pytest.mark.parametrize("name", adversarial_clouds())
def test_compiled_and_numpy_links_agree_on_adversarial_clouds(name, monkeypatch):
    X = adversarial_clouds()[name]
    fitted = RobustNormalEstimator(20, random_state=0).fit(X)
    answers = []
    for compile_from in (1, len(X) + 1):
        monkeypatch.setattr("sklearn_mcmd.segmentation._graph.COMPILE_FROM", compile_from)
        index = NeighborIndex(X, 16)
        normals = np.ascontiguousarray(fitted.normals_[index.rows])
        # The floor that the estimator gives keeps apart what rounding alone would decide.
        floor = 1e-13 * np.abs(index.points).max(axis=1) + 1e-9
        graph = link_neighbors(index, normals, floor, min_cosine=0.96)
        seeds = np.argsort(fitted.surface_variation_[index.rows], kind="stable")
        answers.append((graph.links, graph.offset, grow_regions(graph.links, seeds)))
    (links, offset, labels), (links_numpy, offset_numpy, labels_numpy) = answers
    assert_allclose(offset, offset_numpy, atol=1e-12)
    assert_array_equal(links, links_numpy)
    assert_array_equal(labels, labels_numpy)
