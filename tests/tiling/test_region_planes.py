"""What regions grow along, cell by cell, is what it is in memory, to the last bit."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from sklearn_mcmd import RegionGrowing, RobustNormalEstimator
from sklearn_mcmd.datasets import make_street
from sklearn_mcmd.planes._columns import split_columns
from sklearn_mcmd.planes._neighborhoods import NeighborIndex
from sklearn_mcmd.planes._resolution import coordinate_step
from sklearn_mcmd.segmentation._graph import link_neighbors
from sklearn_mcmd.segmentation._steps import least_scales, rules_of
from sklearn_mcmd.tiling._cell_columns import CellColumns
from sklearn_mcmd.tiling._cells import CellWriter
from sklearn_mcmd.tiling._cloud_constants import Constants
from sklearn_mcmd.tiling._planes import PlaneJob, ends_of, find_planes
from sklearn_mcmd.tiling._segments import STORED, tell_planes
from sklearn_mcmd.tiling._stored_index import StoredIndex
from sklearn_mcmd.tiling._sweeps import Sweeps

K = 20


@pytest.fixture(scope="module")
def cloud(request):
    """A street with copies, in the order of its files."""
    X = make_street(3_500, outlier_share=0.03, tree=True, random_state=0).data
    X = np.round(X, 3) if request.param == "float64" else np.round(64 * X) / 64
    return np.vstack([X, X[:300]]).astype(request.param)


def links_by_tiles(folder, X, growing):
    """Columns of all places after the sweeps over cells."""
    for name in ("cells", "columns"):
        (folder / name).mkdir()
    writer = CellWriter(folder / "cells", 900, 0.4)
    writer.add(X.astype(np.float64), 0)
    cells = writer.close()
    constants = Constants(X.dtype.name, float(coordinate_step(X)))
    estimator = growing.normal_estimator
    job = PlaneJob(folder / "cells", folder / "columns", estimator, constants, tell_planes)
    sweeps = Sweeps(CellColumns(folder / "columns"), 1, ends_of(0.0, 1.0, estimator))
    whole = find_planes(sweeps, cells, job, K, variation=(X.dtype, ()), **STORED)
    whole.join("counts")
    assert len(cells) > 4
    return whole


@pytest.mark.parametrize(
    ("cloud", "params"),
    [
        ("float64", {}),
        ("float64", {"mutual": False, "max_distance": 0.02}),
        ("float32", {"mutual": False}),
        ("float32", {"max_gap": 0.1}),
    ],
    indirect=["cloud"],
    ids=str,
)
def test_planes_neighbors_and_links_are_those_of_memory(cloud, params, tmp_path):
    estimator = RobustNormalEstimator(24, random_state=0)
    growing = RegionGrowing(K, normal_estimator=estimator, **params)
    whole = links_by_tiles(tmp_path, cloud, growing)
    told = split_columns(np.asarray(estimator.fit_transform(cloud)), 3)
    index = NeighborIndex(cloud.astype(np.float64), K)
    planes = told.planes(index.rows)
    floor = least_scales(index.points, cloud.dtype, coordinate_step(cloud))
    planes.scale[:] = np.maximum(planes.scale, floor)
    links, planes.radius[:] = link_neighbors(index, planes, floor, rules_of(growing))
    # Rows of the index by rows of all places.
    points, row = whole.open("points"), np.empty(len(whole), np.intp)
    row[np.lexsort(points.T)] = np.lexsort(index.points.T)
    assert_array_equal(points, index.points[row])
    assert_array_equal(whole.open("floor"), floor[row])
    assert_array_equal(whole.open("counts"), np.bincount(index.places)[row])
    assert_array_equal(whole.open("variation"), told.surface_variation[index.rows][row])
    for name in ("centroids", "normals", "scale"):
        assert_array_equal(whole.open(name), getattr(planes, name)[row])
    stored = StoredIndex(whole, n_neighbors=K)
    near = stored.query_own(slice(0, len(whole))).indices
    assert_array_equal(row[near], index.query_own(slice(0, len(row))).indices[row])
    found, radius = link_neighbors(stored, whole.planes(), floor[row], rules_of(growing))
    assert_array_equal(radius, planes.radius[row])
    assert_array_equal(np.where(found < 0, -1, row[found]), links[row])
