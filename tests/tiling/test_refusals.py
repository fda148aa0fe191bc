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
from sklearn_mcmd.tiling import Catalog, TilingError, _run, process_files
from tiled import (
    EDGES,
    ESTIMATOR,
    OUTLIERS,
    REGIONS,
    VERBS,
    but,
    names_in,
    street,
    two_files,
    written,
)

pytestmark = pytest.mark.usefixtures("measured")

N = 2_000
ESTIMATORS = [
    (IsolationForest(), "IsolationForest cannot work by tiles"),
    (but(OUTLIERS, n_neighbors=None), "n_neighbors=None"),
    (MCMDOutlierDetector(), "random_state"),
    (but(OUTLIERS, cutoff=3, contamination=0.1), "exclude each other"),
    (but(OUTLIERS, false_positive_rate=1e-9), "less than the simulation"),
    (but(OUTLIERS, cutoff=-5.0), "'cutoff' parameter"),
    (but(OUTLIERS, sensor_origin=np.zeros((5, 3))), "is one position"),
    (but(ESTIMATOR, n_neighbors=None, orientation="mst"), "whole cloud"),
    (RobustNormalEstimator(), "random_state"),
    (but(ESTIMATOR, orientation="sensor", sensor_origin=np.zeros((4, 3))), "one position by"),
    (but(ESTIMATOR, orientation="sensor"), "needs sensor_origin"),
    (RegionGrowing(normals="precomputed"), "precomputed"),
    (RegionGrowing(), "random_state"),
    (but(REGIONS, max_angle=100), "max_angle"),
    (SharpFeatureDetector(), "random_state"),
    (but(EDGES, threshold="mean"), "threshold='mean' is for eigenvalues"),
    (but(EDGES, outlier_detector=IsolationForest()), "IsolationForest"),
]
CLASSES = [["6"], "6", [6.5], [600], [-1], [True], 7, [None]]
NO_SIZES = ["much", "", "-2GB", "2XB", "0GB"]
NO_LIST = "is no list of classes, whole numbers from"
AT_ONE = [[0, 0, 1.0]] * N
ORIGINS = [
    (OUTLIERS, "auto", "'auto' must be a trajectory, or positions of all points"),
    (OUTLIERS, (0.0, 0.0, 10.0), r"shape \(n, 3\), got \(3,\); give one position"),
    (OUTLIERS, np.full((N, 3), np.nan), "sensor_origin contains NaN"),
    (OUTLIERS, np.zeros((5, 3)), "has 5 positions, and the inputs have 2,000 points"),
    (OUTLIERS, ([5.0, 6.0], np.zeros((2, 3))), "2,000 points were measured when there is no"),
    (but(OUTLIERS, strictness=None), AT_ONE, "has no meaning where"),
    (but(OUTLIERS, sensor_origin="origin"), AT_ONE, "given twice"),
    (but(ESTIMATOR, orientation=np.array([0.0, 0.0, 1.0])), AT_ONE, "orientation is not"),
    (EDGES, "auto", "no meaning for SharpFeatureDetector"),
]
OPTIONS = [
    (OUTLIERS, {"mode": "keep"}, "mode='keep' must be"),
    (OUTLIERS, {"colors": True}, "colors=True has no meaning for MCMDOutlierDetector"),
    (ESTIMATOR, {"mode": "mark"}, "mode='mark' has no meaning for RobustNormalEstimator"),
    *((OUTLIERS, {"only_classes": given}, f"^only_classes=.* {NO_LIST}") for given in CLASSES),
    (OUTLIERS, {"ignore_classes": [600]}, f"^ignore_classes=.* {NO_LIST}"),
    *(
        (OUTLIERS, {"only_classes": [3], "tile_size": n}, r"a\.las: no .* withheld")
        for n in (400, 5_000)
    ),
    (OUTLIERS, {"intensity": True}, r"a\.las: intensity is asked for, but the inputs have none"),
    (but(OUTLIERS, strictness=None), {"intensity": True}, "has no meaning where"),
    (ESTIMATOR, {"memory": "10MB"}, "too little"),
    *((one, {"n_jobs": 1.5}, "'n_jobs' parameter .* must be") for one in (ESTIMATOR, EDGES)),
    *((ESTIMATOR, {"tile_size": n}, "^tile_size=.* must be") for n in (0, -5, 1.5, "2000", True)),
    *((ESTIMATOR, {"memory": n}, "^memory=.* must be") for n in (0, -1e9, np.nan, np.inf)),
    *((ESTIMATOR, {"memory": text}, "write it like 2GB") for text in NO_SIZES),
    *((estimator, {"sensor_origin": given}, told) for estimator, given, told in ORIGINS),
]


@pytest.mark.parametrize(
    ("estimator", "options", "message"),
    [*((estimator, {}, message) for estimator, message in ESTIMATORS), *OPTIONS],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_what_cannot_work_is_refused_before_the_work(tmp_path, estimator, options, message):
    known = {"gps_time": np.zeros(N), "classification": np.full(N, 2)}
    path = written(tmp_path, PointCloud(street(N).xyz, known))
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
        (".", "out.LAS", r"become a folder, and \.LAS is no name for it"),
        ("a.las x/a.las", "other.ply", "several outputs need a folder"),
        ("a.las x/a.las", "out", "several files have this name"),
        ("a.las x/a.las", "a.las", "several outputs need a folder"),
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


@pytest.mark.parametrize(
    ("place", "message"), [("nowhere/t.csv", "does not exist"), ("x.csv", "is a folder")]
)
def test_a_table_that_cannot_be_written_is_refused_before_the_work(tmp_path, place, message):
    (tmp_path / "x.csv").mkdir()
    path = written(tmp_path, street(N))
    with pytest.raises(PointFileError, match=message):
        process_files(path, tmp_path / "b.las", REGIONS, regions=tmp_path / place)
    assert names_in(tmp_path) == ["a.las", "x.csv"]


def test_a_catalog_of_another_file_is_refused_before_the_work(tmp_path, monkeypatch):
    catalog = Catalog(written(tmp_path, street(N)))
    written(tmp_path, street(N // 2))
    monkeypatch.setattr(_run, "_scatter", None)
    with pytest.raises(PointFileError, match=r"a\.las: has changed since it was read"):
        process_files(catalog, tmp_path / "b.las", ESTIMATOR)
    assert names_in(tmp_path) == ["a.las"]


def test_a_table_may_lie_in_the_folder_that_a_run_makes(tmp_path):
    source, out = two_files(tmp_path, street(N))[0], tmp_path / "out"
    process_files(source, out, REGIONS, regions=out / "t.csv")
    assert names_in(out) == ["a.laz", "b.las", "t.csv"]


@pytest.mark.parametrize("verb", VERBS)
@pytest.mark.parametrize("size", [1, None])
def test_too_few_points_for_a_plane_are_refused_and_leave_nothing(size, verb, tmp_path):
    path = written(tmp_path, street(5_000).xyz[[0, 100, 500]])
    with pytest.raises(ValueError, match=r"^n_samples=3 is too few for planes in 3D: at least 4"):
        process_files(path, tmp_path / "b.las", VERBS[verb], tile_size=size)
    assert names_in(tmp_path) == ["a.las"]


def test_a_run_whose_inputs_do_not_let_it_end_says_why_and_leaves_nothing(tmp_path):
    """It says of no other run that it goes on: none would."""
    path = written(tmp_path, np.zeros((20, 3)))
    with (
        pytest.warns(match="tile 0 failed .*: sensor_origin is where all points are: there are no"),
        pytest.raises(ValueError, match=r"^1 of 1 tiles failed$"),
    ):
        process_files(path, tmp_path / "b.las", but(OUTLIERS, sensor_origin=[0, 0, 0]))
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
