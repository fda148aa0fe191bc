"""Planes found in sweeps over cells are those in memory, and runs may end amid a sweep."""

import numpy as np
from numpy.testing import assert_array_equal

from sklearn_mcmd import RobustNormalEstimator
from sklearn_mcmd.datasets import make_street
from sklearn_mcmd.io import read_points, write_points
from sklearn_mcmd.tiling import _planes, process_files
from tiled import ESTIMATOR, in_memory


def test_planes_amid_many_outliers_are_those_of_memory(tmp_path):
    xyz = np.round(make_street(5_000, outlier_share=0.2, random_state=2).data, 2)
    write_points(tmp_path / "a.las", xyz)
    estimator = RobustNormalEstimator(12, random_state=0)
    expected = in_memory(tmp_path / "a.las", tmp_path / "expected.las", estimator)
    process_files(tmp_path / "a.las", tmp_path / "out.las", estimator, tile_size=1_500)
    assert (tmp_path / "out.las").read_bytes() == expected.read_bytes()


def test_planes_that_were_bent_in_part_are_found_anew(small_file, tmp_path, monkeypatch):
    """Planes are changed in place, and a run may end amid that."""
    expected = in_memory(small_file, tmp_path / "expected.las").read_bytes()
    bend, bent = _planes._bend, []

    def normals_of(job):
        return job.surfaces(job.model()).members.planes.normals

    def bend_twice(cell, job):
        bend(cell, job)
        bent.append(normals_of(job).copy())
        bend(cell, job)
        assert_array_equal(normals_of(job), bent[-1])

    monkeypatch.setattr(_planes, "_bend", bend_twice)
    process_files(small_file, tmp_path / "out.las", ESTIMATOR, tile_size=2_000)
    assert len(bent) == 4
    assert (tmp_path / "out.las").read_bytes() == expected
    assert len(read_points(tmp_path / "out.las")) == 5_000
