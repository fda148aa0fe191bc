"""What cannot work by tiles is refused with one line before the work, and leaves nothing."""

import numpy as np
import pytest
from sklearn.ensemble import IsolationForest

from sklearn_mcmd import (
    MCMDOutlierDetector,
    RegionGrowing,
    RobustNormalEstimator,
    SharpFeatureDetector,
)
from sklearn_mcmd.io import PointCloud, PointFileError
from sklearn_mcmd.tiling import TilingError, _run, process_files
from tiled import ESTIMATOR, names_in, street, written

SEED = {"random_state": 0}
OUTLIERS = MCMDOutlierDetector(16, **SEED)
EDGES = SharpFeatureDetector(12, **SEED)
NORMALS_OF_TEN = {"normal_estimator": RobustNormalEstimator(10)}
MANY = np.zeros((4, 3))
ESTIMATORS = [
    (IsolationForest(), "IsolationForest cannot work by tiles"),
    (MCMDOutlierDetector(None, **SEED), "n_neighbors=None"),
    (MCMDOutlierDetector(), "random_state"),
    (MCMDOutlierDetector(cutoff=3, contamination=0.1, **SEED), "exclude each other"),
    (MCMDOutlierDetector(cutoff=3, false_positive_rate=0.1, **SEED), "exclude each other"),
    (MCMDOutlierDetector(false_positive_rate=1e-9, **SEED), "less than the simulation"),
    (MCMDOutlierDetector(strictness="much", **SEED), "strictness"),
    (RobustNormalEstimator(None, orientation="mst", **SEED), "whole cloud"),
    (RobustNormalEstimator(None, **SEED), "whole cloud"),
    (RobustNormalEstimator(), "random_state"),
    (RobustNormalEstimator(orientation="sensor", sensor_origin=MANY, **SEED), "one position by"),
    (RegionGrowing(normals="precomputed"), "precomputed"),
    (RegionGrowing(), "random_state"),
    (RegionGrowing(max_angle=100, **SEED), "max_angle"),
    (SharpFeatureDetector(), "random_state"),
    (SharpFeatureDetector(normals="precomputed", **SEED), "normals='precomputed'"),
    (SharpFeatureDetector(threshold="mean", **SEED), "threshold='mean' is for eigenvalues"),
    (SharpFeatureDetector(outlier_detector=IsolationForest(), **SEED), "IsolationForest"),
    (
        SharpFeatureDetector(criterion="removed_fraction", **NORMALS_OF_TEN, **SEED),
        "needs the column removed_fraction",
    ),
]
NO_CLASSES = [["6"], "6", [6.5], [600], [-1], [True], 7, [None]]
NO_LIST = "is no list of classes, whole numbers from"
OPTIONS = [
    (OUTLIERS, {"mode": "keep"}, "mode='keep' must be"),
    (OUTLIERS, {"colors": True}, "colors=True has no meaning for MCMDOutlierDetector"),
    (ESTIMATOR, {"mode": "mark"}, "mode='mark' has no meaning for RobustNormalEstimator"),
    *((OUTLIERS, {"only_classes": given}, f"^only_classes=.* {NO_LIST}") for given in NO_CLASSES),
    (OUTLIERS, {"ignore_classes": [600]}, f"^ignore_classes=.* {NO_LIST}"),
    (OUTLIERS, {"above": np.nan}, "must be a finite number, or None"),
    (OUTLIERS, {"below": "2"}, "must be a finite number, or None"),
    (ESTIMATOR, {"memory": "10MB"}, "too little"),
    *((ESTIMATOR, {"tile_size": n}, "^tile_size=.* must be") for n in (0, -5, 1.5, "2000", True)),
    *((ESTIMATOR, {"memory": n}, "^memory=.* must be") for n in (0, -1e9, np.nan, np.inf)),
]


@pytest.mark.parametrize(
    ("estimator", "options", "message"),
    [*((estimator, {}, message) for estimator, message in ESTIMATORS), *OPTIONS],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_what_cannot_work_is_refused_before_the_work(tmp_path, estimator, options, message):
    path = written(tmp_path, street(2_000))
    with pytest.raises(ValueError, match=message):
        process_files(path, tmp_path / "b.las", estimator, **options)
    assert names_in(tmp_path) == ["a.las"]


@pytest.mark.parametrize(
    ("names", "target", "message"),
    [
        ("a.las", "nowhere/out.las", "does not exist"),
        ("a.las", "out.ply", r"\.las or \.laz only"),
        ("a.las", "out.copc.laz", "COPC can be read"),
        ("a.las", ".", "is a folder"),
        (".", "out.TXT", r"become a folder, or one \.las or \.laz"),
        ("a.las x/a.las", "other.ply", "several outputs need a folder"),
        ("a.las x/a.las", "out", "several files have this name"),
        ("a.las x/a.las", "a.las", "is one of the inputs"),
    ],
)
def test_a_target_that_cannot_be_is_refused_before_the_work(tmp_path, names, target, message):
    (tmp_path / "x").mkdir()
    for folder in (tmp_path, tmp_path / "x"):
        written(folder, street(50))
    (tmp_path / "other.ply").touch()
    paths = [tmp_path / name for name in names.split()]
    with pytest.raises(PointFileError, match=message):
        process_files(paths if len(paths) > 1 else paths[0], tmp_path / target, ESTIMATOR)
    assert names_in(tmp_path) == ["a.las", "other.ply", "x"]


@pytest.mark.parametrize("size", [400, 5_000])
def test_a_run_whose_points_are_all_left_out_is_refused(size, tmp_path):
    path = written(tmp_path, street(1_000))
    with pytest.raises(PointFileError, match=r"a\.las: no points are judged: all are withheld"):
        process_files(path, tmp_path / "b.las", OUTLIERS, only_classes=[2], tile_size=size)
    assert names_in(tmp_path) == ["a.las"]


@pytest.mark.parametrize("estimator", [OUTLIERS, ESTIMATOR, EDGES, RegionGrowing(**SEED)])
@pytest.mark.parametrize("size", [1, None])
def test_too_few_points_for_a_plane_are_refused_and_leave_nothing(size, estimator, tmp_path):
    path = written(tmp_path, street(5_000).xyz[[0, 100, 500]])
    with pytest.raises(ValueError, match=r"^n_samples=3 is too few for planes in 3D: at least 4"):
        process_files(path, tmp_path / "b.las", estimator, tile_size=size)
    assert names_in(tmp_path) == ["a.las"]


def test_a_run_whose_inputs_do_not_let_it_end_says_why_and_leaves_nothing(tmp_path):
    """It says of no other run that it goes on: none would."""
    path = written(tmp_path, np.zeros((20, 3)))
    detector = MCMDOutlierDetector(16, sensor_origin=[0, 0, 0], **SEED)
    with (
        pytest.warns(match="tile 0 failed .*: sensor_origin is where all points are: there are no"),
        pytest.raises(ValueError, match=r"^1 of 1 tiles failed$"),
    ):
        process_files(path, tmp_path / "b.las", detector)
    assert names_in(tmp_path) == ["a.las"]


def test_a_run_that_ends_for_another_reason_says_why_and_what_is_kept_in_one_sentence(
    tmp_path, monkeypatch
):
    path = written(tmp_path, street(1_000))
    monkeypatch.setattr(_run, "write_outputs", lambda *_: (tmp_path / "gone").read_text())
    with pytest.raises(
        TilingError, match=r"No such file.*; what was done is kept in .*b\.las\.til"
    ):
        process_files(path, tmp_path / "b.las", ESTIMATOR)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_intensity_that_is_not_finite_is_refused_if_its_points_are_judged(value, tmp_path):
    light, withheld = np.arange(3_000.0), np.arange(3_000) == 7
    light[7] = value
    known = {"reflectance": light, "withheld": withheld}
    path = written(tmp_path, PointCloud(street(3_000).xyz, known))
    options = {"intensity": True, "tile_size": 1_000, "n_jobs": 1}
    process_files(path, tmp_path / "b.las", OUTLIERS, **options)
    written(tmp_path, PointCloud(street(3_000).xyz, {"reflectance": light}))
    with pytest.raises(PointFileError, match="reflectance of some points is not finite; leave"):
        process_files(path, tmp_path / "c.las", OUTLIERS, **options)
    assert names_in(tmp_path) == ["a.las", "b.las"]
