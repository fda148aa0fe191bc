"""Results of cells beside those of memory: how little differs at seams."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from sklearn.metrics import adjusted_rand_score

from sklearn_mcmd import (
    MCMDOutlierDetector,
    RegionGrowing,
    RobustNormalEstimator,
    SharpFeatureDetector,
)
from sklearn_mcmd.datasets import make_street
from sklearn_mcmd.io import read_points
from tiled import EDGES, OUTLIERS, but, fit_in_memory, shining_street, street, values_of, written

ESTIMATORS = [
    MCMDOutlierDetector(random_state=0),
    RobustNormalEstimator(random_state=0),
    SharpFeatureDetector(random_state=0),
    RegionGrowing(random_state=0),
]
# Of each cloud, the least adjusted Rand index of regions to those of memory: .02 less than found.
# The office's wall is cut in memory along a rounding level of its camera, and whole in cells.
CLOUDS = {
    "mobile_street_labelled": 0.95,
    "ahn3_amsterdam_2397": 0.97,
    "fast_gicp_velodyne": 0.93,
    "pcl_office1": 0.92,
}
AT_ONCE = 25_000  # points of a cell
WHOLE_STEPS = {"criterion": "eigenvalue", "threshold": "mean", "outlier_detector": "passthrough"}


def assert_seams_are_small(estimator, path, by_tiles, tile_size, least=0.98, small=False):
    """Cells that are `small` have three times as many outliers at the ends of surfaces, and twenty
    times as many edges."""
    xyz = read_points(path).xyz
    values, _, run, report = by_tiles(path, estimator, tile_size=tile_size)
    fitted = fit_in_memory(xyz, estimator)
    expected, n = values_of(fitted), len(xyz)
    assert report.n_tiles > 1
    if isinstance(fitted, MCMDOutlierDetector):
        flags, found = expected[:, 0] > -fitted.offset_, values[:, 0] > run.cutoff
        differ = np.count_nonzero(found != flags)
        assert differ <= (0.03 if small else 0.01) * np.count_nonzero(flags) + 2
        assert_allclose(run.cutoff, -fitted.offset_, rtol=0.02)
        assert report.n_outliers == np.count_nonzero(found)
        if fitted.contamination is not None:
            assert report.n_outliers == pytest.approx(fitted.contamination * n, abs=1)
    elif isinstance(fitted, RobustNormalEstimator):
        cosine = np.abs(np.einsum("ij,ij->i", values[:, :3], expected[:, :3].astype(float)))
        places = np.unique(xyz[cosine < np.cos(np.radians(1.0))], axis=0)  # copies count once
        assert len(places) <= 0.0001 * n + 5
    elif isinstance(fitted, SharpFeatureDetector):
        found = values[:, 0] < run.limit
        differ = np.count_nonzero(found != (expected[:, 0] < fitted.offset_))
        assert differ <= (0.01 if small else 0.0005) * n
        assert_allclose(run.limit, fitted.offset_, rtol=0.03 if small else 0.02)
        assert report.n_edges == np.count_nonzero(found)
        n_removed = np.count_nonzero(~fitted.inlier_mask_)  # cells have a share of their own
        assert abs(report.n_outliers - n_removed) <= 0.06 * n_removed + 5
    else:
        assert adjusted_rand_score(values[:, 0], fitted.labels_) > least


def kind_of(value):
    return type(value).__name__


@pytest.mark.parametrize("estimator", ESTIMATORS, ids=kind_of)
def test_seams_of_a_street_are_small(estimator, by_tiles, tmp_path):
    X = make_street(6_000, outlier_share=0.03, tree=True, random_state=0).data
    assert_seams_are_small(estimator, written(tmp_path, np.round(X, 3)), by_tiles, 3_200)


@pytest.mark.parametrize(
    ("estimator", "params"),
    [
        (OUTLIERS, {"strictness": "surfaces"}),
        (OUTLIERS, {"strictness": None}),
        (OUTLIERS, {"contamination": 0.07}),
        (OUTLIERS, {"false_positive_rate": 0.02}),
        (OUTLIERS, {"cutoff": 5.0}),
        (EDGES, {"outlier_detector": MCMDOutlierDetector(16, contamination=0.1)}),
        (EDGES, {"criterion": "surface_variation"}),
        (EDGES, {**WHOLE_STEPS, "normal_estimator": RobustNormalEstimator(12, reweight=False)}),
        (EDGES, {"normal_estimator": RobustNormalEstimator("auto", orientation="mst")}),
    ],
    ids=str,
)
def test_what_is_decided_of_all_cells_is_nearly_what_memory_decides(
    estimator, params, by_tiles, tmp_path
):
    path, estimator = written(tmp_path, street(3_600)), but(estimator, **params)
    assert_seams_are_small(estimator, path, by_tiles, 1_200, small=True)


def test_a_cell_without_surfaces_has_no_edges_if_the_cloud_has_surfaces(by_tiles, tmp_path):
    """In memory only clouds without any are asked everywhere."""
    blob = np.array([20, 0, 0]) + np.random.default_rng(0).uniform(0, 2, (4_000, 3))
    X = np.vstack([make_street(4_000, random_state=0).data, blob])
    estimator = SharpFeatureDetector(random_state=0)
    assert_seams_are_small(estimator, written(tmp_path, np.round(X, 3)), by_tiles, 3_000)


def test_intensity_is_evidence_as_in_memory(by_tiles, tmp_path):
    path = written(tmp_path, shining_street(6_000))
    cloud = read_points(path)
    light = cloud.attributes["intensity"]
    with_light, without = (fit_in_memory(cloud.xyz, OUTLIERS, intensity=i) for i in (light, None))
    is_outlier = with_light.scores_ < with_light.offset_
    values, _, verb, _ = by_tiles(path, OUTLIERS, tile_size=2_000, intensity=True)
    n_differ = np.count_nonzero((values[:, 0] > verb.cutoff) != is_outlier)
    n_changed = np.count_nonzero((without.scores_ < without.offset_) != is_outlier)
    assert n_differ <= 0.05 * np.count_nonzero(is_outlier) + 2
    assert n_changed > 2 * n_differ


@pytest.mark.filterwarnings("ignore:the n_neighbors=50 nearest")  # spinning turns have rows
@pytest.mark.slow
@pytest.mark.parametrize("estimator", ESTIMATORS, ids=kind_of)
@pytest.mark.parametrize("name", CLOUDS)
def test_seams_of_real_clouds_are_small(name, estimator, by_tiles, tmp_path, shared_data):
    path = shared_data / name / "cloud.npz"
    if not path.exists():
        pytest.skip(f"shared/data has no {name}")
    with np.load(path) as stored:
        xyz = stored["xyz"].astype(float)
    xyz = xyz[xyz.any(axis=1)]  # without silent rays
    assert_seams_are_small(estimator, written(tmp_path, xyz), by_tiles, AT_ONCE, CLOUDS[name])
