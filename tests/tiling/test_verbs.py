"""What is decided of all cells together: cutoffs, edges by other criteria; and own sizes."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from sklearn.base import clone

from sklearn_mcmd import MCMDOutlierDetector, RobustNormalEstimator, SharpFeatureDetector
from sklearn_mcmd.io import PointCloud, read_points
from tiled import fit_in_memory, street, written

OUTLIERS = MCMDOutlierDetector(16, random_state=0)
EDGES = SharpFeatureDetector(12, random_state=0)


@pytest.fixture(scope="module")
def source(tmp_path_factory):
    return written(tmp_path_factory.mktemp("street"), street(6_000))


@pytest.mark.parametrize(
    "params",
    [
        {},
        {"strictness": "surfaces"},
        {"strictness": None},
        {"contamination": 0.07},
        {"false_positive_rate": 0.02},
        {"strictness": None, "false_positive_rate": 0.02},
        {"noise_scale": 0.02, "n_neighbors": 30},
        {"cutoff": 5.0},
    ],
    ids=str,
)
def test_outliers_of_cells_are_nearly_those_of_memory(params, source, by_tiles):
    """Their cutoffs are the same to 2 %; 3 % of the outliers, at the ends of surfaces, differ."""
    detector = clone(OUTLIERS).set_params(**params)
    values, _, verb, report = by_tiles(source, detector, tile_size=2_000)
    fitted = fit_in_memory(read_points(source).xyz, detector)
    assert_allclose(verb.cutoff, -fitted.offset_, rtol=0.02)
    is_outlier = fitted.scores_ < fitted.offset_
    n_differ = np.count_nonzero((values[:, 0] > verb.cutoff) != is_outlier)
    assert n_differ <= 0.03 * np.count_nonzero(is_outlier) + 2
    assert report.n_outliers == np.count_nonzero(values[:, 0] > verb.cutoff)
    if "contamination" in params:
        assert report.n_outliers == pytest.approx(0.07 * 6_000, abs=1)


def test_intensity_is_evidence_as_in_memory(by_tiles, tmp_path):
    cloud, rng = street(6_050), np.random.default_rng(0)
    xyz = cloud.xyz[:6_000].copy()  # without copies
    off = xyz[:, 2] > 101.5
    xyz[off] += rng.normal(0, 1.0, (off.sum(), 3))
    light = np.where(off, rng.integers(0, 9, 6_000), rng.integers(5, 200, 6_000)).astype(np.uint16)
    path = written(tmp_path, PointCloud(np.round(xyz, 3), {"intensity": light}))
    xyz = read_points(path).xyz
    fitted, without = (fit_in_memory(xyz, OUTLIERS, intensity=given) for given in (light, None))
    is_outlier = fitted.scores_ < fitted.offset_
    values, _, verb, _ = by_tiles(path, OUTLIERS, tile_size=2_000, intensity=True)
    n_differ = np.count_nonzero((values[:, 0] > verb.cutoff) != is_outlier)
    n_changed = np.count_nonzero((without.scores_ < without.offset_) != is_outlier)
    assert n_differ <= 0.05 * np.count_nonzero(is_outlier) + 2
    assert n_changed > 2 * n_differ


@pytest.mark.parametrize(
    "params",
    [
        {},
        {"outlier_detector": "passthrough"},
        {"outlier_detector": MCMDOutlierDetector(16, contamination=0.1)},
        {"criterion": "eigenvalue"},
        {"criterion": "removed_fraction"},
        {
            **{"criterion": "eigenvalue", "threshold": "mean", "outlier_detector": "passthrough"},
            "normal_estimator": RobustNormalEstimator(12, reweight=False),
        },
        {"normal_estimator": RobustNormalEstimator("auto", orientation="mst")},
    ],
    ids=str,
)
def test_edges_of_cells_are_nearly_those_of_memory(params, source, by_tiles):
    detector = clone(EDGES).set_params(**params)
    values, _, verb, report = by_tiles(source, detector, tile_size=2_000)
    fitted = fit_in_memory(read_points(source).xyz, detector)
    is_edge = fitted.scores_ < fitted.offset_
    assert_allclose(verb.limit, fitted.offset_, rtol=0.02)
    assert np.count_nonzero((values[:, 0] < verb.limit) != is_edge) <= 0.01 * 6_000
    assert report.n_edges == np.count_nonzero(values[:, 0] < verb.limit)
    n_removed = np.count_nonzero(~fitted.inlier_mask_)  # cells have a share of their own removed
    assert abs(report.n_outliers - n_removed) <= 0.06 * n_removed + 5
