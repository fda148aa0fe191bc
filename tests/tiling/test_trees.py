"""Normals that agree along a tree of neighbors: by tiles it is the tree of memory."""

import numpy as np
import pytest

from sklearn_mcmd import RobustNormalEstimator
from sklearn_mcmd.io import PointCloud, write_points
from sklearn_mcmd.tiling import TilingError, _planes, process_files
from tiled import in_memory


@pytest.mark.parametrize(("n", "n_jobs"), [(40, 1), (40, 2), (10, 1)])
def test_normals_agree_along_the_tree_of_memory_where_costs_are_equal(tmp_path, n, n_jobs):
    side = np.stack(np.meshgrid(np.arange(n), np.arange(n), [0.0], indexing="ij"), -1).reshape(
        -1, 3
    )
    faces = [np.roll(side, turn, axis=1) + shift for turn in range(3) for shift in (0, 1000)]
    shuffled = np.random.default_rng(0).permutation(np.vstack([*faces, side[:9]]) / 8)
    source, target = tmp_path / "box.laz", tmp_path / "out.laz"
    write_points(source, PointCloud(shuffled))
    estimator = RobustNormalEstimator(16, orientation="mst", random_state=0)
    expected = in_memory(source, tmp_path / "expected.laz", estimator).read_bytes()
    report = process_files(source, target, estimator, tile_size=len(shuffled) // 4, n_jobs=n_jobs)
    assert report.n_tiles > 4
    assert target.read_bytes() == expected


def test_a_run_along_a_tree_that_failed_goes_on(small_file, tmp_path, monkeypatch):
    estimator = RobustNormalEstimator(16, orientation="mst", random_state=0)
    expected = in_memory(small_file, tmp_path / "expected.las", estimator).read_bytes()
    with monkeypatch.context() as patch:
        patch.setattr(_planes, "signs_along", lambda *_: 1 / 0)
        with pytest.raises(TilingError, match="goes on from there"):
            process_files(small_file, tmp_path / "out.las", estimator, tile_size=2_000)
    report = process_files(small_file, tmp_path / "out.las", estimator, tile_size=2_000)
    assert report.n_resumed == report.n_tiles
    assert (tmp_path / "out.las").read_bytes() == expected
