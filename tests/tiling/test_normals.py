"""Normals by tiles equal those in memory for all parameters, or are refused."""

import numpy as np
import pytest
from sklearn.ensemble import IsolationForest

from benchmarks.simulators import make_airborne_scan, make_mobile_scan
from sklearn_mcmd import RobustNormalEstimator
from sklearn_mcmd.datasets import make_street
from sklearn_mcmd.io import PointCloud, write_points
from sklearn_mcmd.tiling import process_files
from tiled import divide, in_memory


@pytest.mark.parametrize(
    "params",
    [
        {"neighbor_planes": False, "features": "mean_curvature", "orientation": "mst"},
        {"reweight": False, "radius": 0.15},
        {"method": "pca"},
        {"method": "msac"},
        {"radius": 0.1, "orientation": [1.0, 2.0, 3.0]},
        {"n_neighbors": 8, "orientation": "mst", "reweight": False},
        {"method": "mcmd_md", "n_neighbors": 20, "tangents": False},
        {"radius": 0.2, "features": ["roughness", "mean_curvature", "max_curvature_direction"]},
        {"orientation": "sensor", "sensor_origin": [362_002, 5_157_002, 103]},
        {"orientation": "mst", "radius": 0.2, "features": "roughness"},
    ],
    ids=lambda params: "-".join(params),
)
def test_the_output_is_that_of_memory_for_all_parameters(small_file, tmp_path, params):
    estimator = RobustNormalEstimator(**{"n_neighbors": 16, "random_state": 3, **params})
    expected = in_memory(small_file, tmp_path / "expected.las", estimator)
    process_files(small_file, tmp_path / "out.las", estimator, tile_size=2_000)
    assert (tmp_path / "out.las").read_bytes() == expected.read_bytes()


@pytest.mark.parametrize(
    ("estimator", "message"),
    [
        (RobustNormalEstimator(None, orientation="mst", random_state=0), "whole cloud"),
        (RobustNormalEstimator(None, random_state=0), "whole cloud"),
        (RobustNormalEstimator(), "random_state"),
        (
            RobustNormalEstimator(
                orientation="sensor", sensor_origin=np.zeros((4, 3)), random_state=0
            ),
            "is one position by tiles",
        ),
        (IsolationForest(), "IsolationForest cannot work by tiles"),
    ],
)
def test_estimators_that_need_the_whole_cloud_are_refused(small_file, tmp_path, estimator, message):
    with pytest.raises(ValueError, match=message):
        process_files(small_file, tmp_path / "out.las", estimator)


SCENES = {
    "street": lambda: make_street(40_000, outlier_share=0.1, random_state=1).data,
    "mobile": lambda: make_mobile_scan(40_000, random_state=1).data,
    "airborne": lambda: make_airborne_scan(40_000, random_state=1).data,
}


@pytest.mark.slow
@pytest.mark.parametrize("scene", SCENES)
def test_many_points_have_the_normals_of_memory(scene, tmp_path):
    source = tmp_path / "scene.laz"
    write_points(source, PointCloud(np.round(SCENES[scene](), 3)))
    usual = RobustNormalEstimator(random_state=0)
    expected = in_memory(source, tmp_path / "expected.laz", usual).read_bytes()
    target = tmp_path / "out.laz"
    divide(source, target, usual, tile_size=5_000, n_jobs=2)
    assert target.read_bytes() == expected
