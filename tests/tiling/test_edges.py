"""Edges by tiles are those in memory to the last bit, wherever tiles begin and runs end."""

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_array_equal
from sklearn.base import clone
from sklearn.ensemble import IsolationForest

from sklearn_mcmd import MCMDOutlierDetector, RobustNormalEstimator, SharpFeatureDetector
from sklearn_mcmd.datasets import make_box, make_street
from sklearn_mcmd.io import PointCloud, read_points, write_points
from sklearn_mcmd.io._point_cloud import with_results
from sklearn_mcmd.plotting._still import edge_columns
from sklearn_mcmd.tiling import TilingError, _edges, _result_files, process_files
from sklearn_mcmd.tiling._result_files import SCORED, Results
from tiled import divide, is_killed, street

DETECTOR = SharpFeatureDetector(12, random_state=0)
RNG = np.random.default_rng(0)


@cache
def street_of(n, share=0.05, seed=0):
    return make_street(n, outlier_share=share, random_state=seed).data


def machined():
    """A block with a slot, whose faces meet inward and outward, with displaced points."""
    rng = np.random.default_rng(2)
    box = make_box(2_000, random_state=2).data
    low, high = box.min(axis=0), box.max(axis=0)
    inside = (np.abs((box - low) / (high - low) - [0.5, 0.5, 1.0]) < [0.6, 0.2, 0.4]).all(axis=1)
    box[inside, 2] -= 0.4 * (high - low)[2]
    moved = rng.choice(len(box), 200, replace=False)
    box[moved] += rng.normal(0, 0.05, (200, 3)) * (high - low)
    return box


def with_copies():
    X = np.round(street_of(1_600), 2)
    return np.vstack([X, X[:500], X[:500], X[-40:]])


def far_apart():
    X = street_of(1_800).copy()
    X[900:, 0] += 1e4
    return np.vstack([X, RNG.uniform(-1e5, 1e5, (15, 3)), RNG.normal([0, 0, 2_000], 0.1, (30, 3))])


SCENES = {
    "machined": machined,
    "copies": with_copies,
    "far apart": far_apart,
    "lattice in single precision": lambda: np.unique(np.round(8 * street_of(2_500)) / 8, axis=0),
}

# These are tried as one tile, too. There only order, copies and precision count.
ONE_TILE = {"copies", "lattice in single precision"}


def written(folder, xyz):
    """A file of the points, and its cloud as it is read."""
    write_points(folder / "a.las", PointCloud(xyz))
    return folder / "a.las", read_points(folder / "a.las")


def in_memory(cloud, detector=DETECTOR):
    single = cloud.xyz.astype(np.float32)
    exact = np.array_equal(single, cloud.xyz)
    return clone(detector).fit(single if exact else cloud.xyz)


@pytest.fixture
def by_tiles(monkeypatch, tmp_path):
    """Runs by tiles; returns all scores, and the report."""
    found = []
    write = _edges.write_outputs

    def keep_scores(run, verb, *args):
        results = Results(run.folder.results, len(run.cells), SCORED)
        found.append((results.take(0, run.catalog.n_points)[:, 0], verb.limit))
        return write(run, verb, *args)

    monkeypatch.setattr(_edges, "write_outputs", keep_scores)

    def run(source, detector=DETECTOR, **options):
        report = divide(source, tmp_path / "edges.las", detector, **options)
        return *found.pop(), report

    return run


@pytest.mark.parametrize("scene", SCENES)
def test_scores_are_those_of_memory_wherever_tiles_begin(scene, by_tiles, tmp_path):
    path, cloud = written(tmp_path, SCENES[scene]())
    expected = in_memory(cloud)
    for tile_size, cut in ((800, 0.3), *[(10_000, 0.5)] * (scene in ONE_TILE)):
        scores, limit, report = by_tiles(path, tile_size=tile_size, cut=cut)
        assert_array_equal(scores, expected.scores_)
        assert limit == expected.offset_
        assert report.n_edges == (expected.scores_ < expected.offset_).sum()
        assert report.n_outliers == (~expected.inlier_mask_).sum()
        assert report.removed_fraction == (~expected.inlier_mask_).mean()
        assert report.n_tiles >= len(cloud) / tile_size


PARAMETERS = {
    "passthrough": {"outlier_detector": "passthrough"},
    "share": {"outlier_detector": MCMDOutlierDetector(16, contamination=0.1)},
    "tangents": {"normal_estimator": RobustNormalEstimator(16)},
    "pca": {"normal_estimator": RobustNormalEstimator(20, method="pca", radius=0.5)},
    "sizes": {"normal_estimator": RobustNormalEstimator("auto", orientation="mst")},
    "eigenvalue": {"criterion": "eigenvalue"},
    "removed": {"criterion": "removed_fraction"},
    "Eq. 25": {
        "criterion": "eigenvalue",
        "threshold": "mean",
        "outlier_detector": "passthrough",
        "normal_estimator": RobustNormalEstimator(12, reweight=False),
    },
}


@pytest.mark.parametrize("name", PARAMETERS)
def test_scores_and_limits_are_those_of_memory_for_all_parameters(name, by_tiles, tmp_path):
    path, cloud = written(tmp_path, np.round(street_of(2_000, seed=1), 2))
    detector = clone(DETECTOR).set_params(**PARAMETERS[name])
    expected = in_memory(cloud, detector)
    scores, limit, _ = by_tiles(path, detector, tile_size=1_000)
    assert_array_equal(scores, expected.scores_)
    assert limit == expected.offset_


@st.composite
def clouds(draw):
    """More than a thousand places: faces at right angles and single points, rounded or copied."""
    rng = np.random.default_rng(draw(st.integers(0, 10**6)))
    n_face, n_far = draw(st.integers(500, 700)), draw(st.integers(0, 60))
    parts = []
    for flat in ([1, 1, 0], [1, 0, 1], [0, 1, 1]):
        parts.append(rng.uniform(0, 4, (n_face, 3)) * flat + rng.normal(0, 0.01, (n_face, 3)))
    X = np.vstack([*parts, rng.uniform(-9, 9, (n_far, 3))])
    X = np.round(X, draw(st.sampled_from([1, 2, 4])))
    return np.vstack([X, X[rng.integers(0, len(X), draw(st.integers(0, 200)))]])


@given(
    X=clouds(),
    tile_size=st.integers(200, 1_500),
    cut=st.floats(0.2, 0.8),
    cleaner=st.sampled_from([None, "passthrough"]),
)
@settings(max_examples=2)
def test_scores_of_any_cloud_are_those_of_memory(X, tile_size, cut, cleaner, by_tiles, tmp_path):
    path, cloud = written(tmp_path, X)
    detector = SharpFeatureDetector(10, outlier_detector=cleaner, random_state=1)
    scores, _, _ = by_tiles(path, detector, tile_size=tile_size, cut=cut)
    assert_array_equal(scores, in_memory(cloud, detector).scores_)


@pytest.mark.parametrize(("n", "criterion"), [(900, "eigenvalue"), (30, "crease")])
def test_small_clouds_are_judged_as_in_memory(n, criterion, by_tiles, tmp_path):
    path, cloud = written(tmp_path, street_of(2_000)[:n])
    detector = clone(DETECTOR).set_params(criterion=criterion)
    scores, limit, _ = by_tiles(path, detector, tile_size=200)
    expected = in_memory(cloud, detector)
    assert_array_equal(scores, expected.scores_)
    assert limit == expected.offset_


def test_clouds_of_which_hardly_anything_is_kept_are_refused_as_in_memory(by_tiles, tmp_path):
    path, cloud = written(tmp_path, street_of(1_500))
    cleaner = MCMDOutlierDetector(16, strictness="surfaces", cutoff=1e-9)
    detector = clone(DETECTOR).set_params(outlier_detector=cleaner)
    with pytest.raises(ValueError, match=r"calls (\d+) of \1 points outliers"):
        by_tiles(path, detector, tile_size=500)
    with pytest.raises(ValueError, match=r"calls (\d+) of \1 points outliers"):
        in_memory(cloud, detector)


def test_many_points_of_which_few_are_kept_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(_result_files, "MOST_COPIES", 1_000)
    path, _ = written(tmp_path, np.repeat(street_of(600), 2, axis=0))
    detector = clone(DETECTOR).set_params(outlier_detector="passthrough")
    with pytest.raises(TilingError, match="1,200 points, of which 600 places are no outliers"):
        process_files(path, tmp_path / "b.las", detector, tile_size=500)


@pytest.mark.parametrize(("n_jobs", "colors"), [(1, None), (2, False)])
def test_files_are_those_that_memory_writes(n_jobs, colors, tmp_path):
    path, expected, target = (tmp_path / name for name in ("a.laz", "b.laz", "c.laz"))
    write_points(path, street(5_000))
    cloud = read_points(path)
    fitted = clone(DETECTOR).fit(cloud.xyz)
    is_edge = fitted.scores_ < fitted.offset_
    results = edge_columns(is_edge, fitted.scores_, colors is None)
    write_points(expected, with_results(cloud, results))
    report = process_files(path, target, DETECTOR, colors=colors, tile_size=2_000, n_jobs=n_jobs)
    assert target.read_bytes() == expected.read_bytes()
    assert report.n_workers == n_jobs
    assert report.n_edges == is_edge.sum()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.laz", "b.laz", "c.laz"]


def test_files_of_a_folder_are_one_cloud_and_keep_their_colors(tmp_path):
    cloud = street(3_000)
    left = cloud.xyz[:, 0] < np.median(cloud.xyz[:, 0])
    gray = dict.fromkeys(("red", "green", "blue"), np.full(left.sum(), 7, np.uint16))
    (tmp_path / "in").mkdir()
    write_points(tmp_path / "in" / "a.laz", cloud.subset(left).with_attributes(**gray))
    write_points(tmp_path / "in" / "b.las", cloud.subset(~left))
    inputs = [read_points(tmp_path / "in" / name) for name in ("a.laz", "b.las")]
    fitted = clone(DETECTOR).fit(np.vstack([part.xyz for part in inputs]))
    is_edge = fitted.scores_ < fitted.offset_
    process_files(tmp_path / "in", tmp_path / "out", DETECTOR, tile_size=1_500)
    parts = np.split(is_edge, [len(inputs[0])])
    a, b = (read_points(tmp_path / "out" / name) for name in ("a.laz", "b.las"))
    for found, part, some in zip((a, b), inputs, parts, strict=True):
        assert_array_equal(found.xyz, part.xyz)
        assert_array_equal(found.attributes["edge"], some)
        assert_array_equal(found.attributes["intensity"], part.attributes["intensity"])
    assert (a.attributes["red"] == 7).all()
    assert len(np.unique(b.attributes["red"])) == 2


# A run that kills itself within a sweep, or at the output.
RUN = """
import os, signal, sys
from sklearn_mcmd import SharpFeatureDetector
from sklearn_mcmd.tiling import _denoise, _edges, _planes, _result_files, process_files

source, target, place = sys.argv[1:]

def die(*args, **kwargs):
    os.kill(os.getpid(), getattr(signal, "SIGKILL", signal.SIGTERM))

def twice(work, done=[]):
    def some(*args, **kwargs):
        done.append(work(*args, **kwargs) if len(done) < 2 else die())
    return some

if place == "writing":
    _result_files.Results.take = die
elif place == "close_kept":
    _edges.close_kept = die
else:
    places = (_denoise,) if place == "find_planes" else (_planes, _edges, _denoise)
    module = next(module for module in places if hasattr(module, place))
    setattr(module, place, twice(getattr(module, place)))
detector = SharpFeatureDetector(12, random_state=0)
process_files(source, target, detector, tile_size=1_500)
"""


@pytest.mark.parametrize(
    ("place", "n_resumed"),
    [
        ("_tell_cell", 2),
        *(
            pytest.param(place, n, marks=pytest.mark.slow)
            for place, n in (
                *[("find_kept", 0), ("find_planes", 0), ("close_kept", 0)],
                *[("find_places", 0), ("writing", 4)],
            )
        ),
    ],
)
def test_a_run_that_was_killed_goes_on(place, n_resumed, by_tiles, tmp_path):
    path = tmp_path / "a.las"
    write_points(path, street(4_500))
    expected = in_memory(read_points(path))
    assert is_killed(RUN, path, tmp_path / "edges.las", place)
    assert not (tmp_path / "edges.las").exists()
    scores, _, report = by_tiles(path, tile_size=1_500)
    assert_array_equal(scores, expected.scores_)
    assert report.n_resumed == n_resumed
    assert not (tmp_path / "edges.las.tiles").exists()


@pytest.mark.parametrize(
    ("estimator", "message"),
    [
        (SharpFeatureDetector(), "random_state"),
        (clone(DETECTOR).set_params(normals="precomputed"), "normals='precomputed'"),
        (clone(DETECTOR).set_params(threshold="mean"), "threshold='mean' is for eigenvalues"),
        (clone(DETECTOR).set_params(outlier_detector=IsolationForest()), "IsolationForest"),
        (
            clone(DETECTOR).set_params(
                criterion="removed_fraction", normal_estimator=RobustNormalEstimator(10)
            ),
            "needs the column removed_fraction",
        ),
    ],
)
def test_detectors_that_cannot_work_are_refused_before_the_work(tmp_path, estimator, message):
    path, _ = written(tmp_path, street_of(2_000))
    with pytest.raises(ValueError, match=message):
        process_files(path, tmp_path / "b.las", estimator)
    assert [p.name for p in tmp_path.iterdir()] == ["a.las"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("criterion", "tile_size", "cut", "n_jobs"),
    [("crease", 5_000, 0.5, 2), ("removed_fraction", 20_000, 0.3, 1)],
)
def test_many_points_have_the_scores_of_memory(
    criterion, tile_size, cut, n_jobs, by_tiles, tmp_path
):
    path, cloud = written(tmp_path, np.round(street_of(25_000), 3))
    detector = SharpFeatureDetector(criterion=criterion, random_state=0)
    expected = in_memory(cloud, detector)
    scores, limit, _ = by_tiles(path, detector, tile_size=tile_size, cut=cut, n_jobs=n_jobs)
    assert_array_equal(scores, expected.scores_)
    assert limit == expected.offset_
