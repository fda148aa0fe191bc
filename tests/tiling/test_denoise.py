"""Scores by tiles equal those in memory to the last bit, wherever tiles begin and runs end."""

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_array_equal
from sklearn.base import clone

from benchmarks.simulators import make_airborne_scan
from sklearn_mcmd import MCMDOutlierDetector
from sklearn_mcmd.datasets import make_lidar_turn, make_street
from sklearn_mcmd.io import PointCloud, PointFileError, read_points, write_points
from sklearn_mcmd.io._classes import noise_classes
from sklearn_mcmd.io._point_cloud import without_outliers
from sklearn_mcmd.outliers._lowest_points import LowestPoints
from sklearn_mcmd.tiling import TilingError, _denoise, _result_files, process_files
from sklearn_mcmd.tiling._result_files import SCORED, Results
from tiled import divide, is_killed, street

DETECTOR = MCMDOutlierDetector(16, random_state=0)
RNG = np.random.default_rng(0)


@cache
def street_with_tree(n, share=0.05, seed=0):
    return make_street(n, outlier_share=share, tree=True, random_state=seed).data


def with_copies():
    X = np.round(street_with_tree(2_000), 2)
    return np.vstack([X, X[:900], X[:900], X[-40:]])


def far_apart():
    X = street_with_tree(2_000).copy()
    X[1_000:, 0] += 1e4
    far = RNG.uniform(-1e5, 1e5, (15, 3))
    ghost = RNG.normal([0, 0, 2_000], 0.1, (30, 3))
    return np.vstack([X, far, ghost])


SCENES = {
    "street": lambda: street_with_tree(2_500),
    "airborne": lambda: make_airborne_scan(2_000, random_state=0).data,
    "turn": lambda: (turn := make_lidar_turn(3_000, random_state=0).data)[turn.any(axis=1)],
    "copies": with_copies,
    "far apart": far_apart,
    "volume": lambda: RNG.uniform(0, 4, (1_500, 3)),
    "lattice in single precision": lambda: np.unique(RNG.integers(0, 12, (2_000, 3)), axis=0) / 4,
    "sparse beside dense": lambda: np.vstack(
        [street_with_tree(1_200), street_with_tree(1_200, seed=1) / 30]
    ),
}

# These are tried as one tile, too. There only order, copies and precision count.
ONE_TILE = {"copies", "lattice in single precision"}


def written(folder, xyz):
    """A file of the points, and its cloud as it is read."""
    write_points(folder / "a.las", PointCloud(xyz))
    return folder / "a.las", read_points(folder / "a.las")


def in_memory(cloud, detector):
    single = cloud.xyz.astype(np.float32)
    exact = np.array_equal(single, cloud.xyz)
    return clone(detector).fit(single if exact else cloud.xyz)


@pytest.fixture
def by_tiles(monkeypatch, tmp_path):
    """Runs by tiles; returns all scores, and the report."""
    found = []
    write = _denoise.write_outputs

    def keep_scores(run, *args):
        results = Results(run.folder.results, len(run.cells), SCORED)
        found.append(results.take(0, run.catalog.n_points)[:, 0])
        return write(run, *args)

    monkeypatch.setattr(_denoise, "write_outputs", keep_scores)

    def run(source, detector, **options):
        report = divide(source, tmp_path / "denoised.las", detector, **options)
        return found.pop(), report

    return run


@pytest.mark.parametrize("scene", SCENES)
def test_scores_are_those_of_memory_wherever_tiles_begin(scene, by_tiles, tmp_path):
    path, cloud = written(tmp_path, SCENES[scene]())
    expected = in_memory(cloud, DETECTOR)
    for tile_size, cut in ((500, 0.3), *[(10_000, 0.5)] * (scene in ONE_TILE)):
        scores, report = by_tiles(path, DETECTOR, tile_size=tile_size, cut=cut)
        assert_array_equal(scores, -expected.scores_)
        assert report.n_outliers == (expected.scores_ < expected.offset_).sum()
        assert report.n_tiles >= len(cloud) / tile_size


@pytest.mark.parametrize(
    ("scene", "params"),
    [
        ("street", {"strictness": "isolated"}),
        ("street", {"strictness": "surfaces"}),
        ("volume", {"strictness": "surfaces"}),
        ("street", {"strictness": None}),
        ("volume", {"method": "mcmd_md"}),
        ("street", {"noise_scale": 0.02, "n_neighbors": 40}),
        ("volume", {"noise_scale": 0.02, "n_neighbors": 40}),
        ("street", {"reweight": False, "support_fraction": 0.7, "n_neighbors": 6}),
    ],
    ids=str,
)
def test_scores_are_those_of_memory_for_all_parameters(scene, params, by_tiles, tmp_path):
    path, cloud = written(tmp_path, SCENES[scene]())
    detector = clone(DETECTOR).set_params(**params)
    scores, _ = by_tiles(path, detector, tile_size=900)
    assert_array_equal(scores, -in_memory(cloud, detector).scores_)


@pytest.mark.parametrize(
    "params",
    [
        {"contamination": 0.07},
        {"cutoff": 10.0},
        {"false_positive_rate": 0.02},
        {"strictness": None, "false_positive_rate": 0.02},
    ],
    ids=lambda params: "-".join(params),
)
def test_labels_are_those_of_memory_for_all_cutoffs(params, tmp_path):
    path, cloud = written(tmp_path, np.round(street_with_tree(2_000), 2))
    detector = clone(DETECTOR).set_params(**params)
    kept = in_memory(cloud, detector)
    kept = kept.scores_ >= kept.offset_
    process_files(path, tmp_path / "b.las", detector, tile_size=700)
    assert_array_equal(read_points(tmp_path / "b.las").xyz, cloud.xyz[kept])


@st.composite
def clouds(draw):
    """More than a thousand places: faces, clusters and single points, some rounded or copied."""
    rng = np.random.default_rng(draw(st.integers(0, 10**6)))
    n_face, n_volume = draw(st.integers(0, 900)), draw(st.integers(1, 500))
    n_far, n_copies = draw(st.integers(0, 40)), draw(st.integers(0, 200))
    n_face = max(n_face, 1_100 - n_volume - n_far)
    face = rng.uniform(0, 4, (n_face, 3)) * [1, 1, 0] + rng.normal(0, 0.01, (n_face, 3))
    parts = [face, rng.normal(0, 1, (n_volume, 3)), rng.uniform(-90, 90, (n_far, 3))]
    X = np.vstack(parts)
    digits = draw(st.sampled_from([1, 2, 4]))
    X = np.round(X, digits)
    return np.vstack([X, X[rng.integers(0, len(X), n_copies)]])


@given(
    X=clouds(),
    tile_size=st.integers(150, 900),
    cut=st.floats(0.2, 0.8),
    strictness=st.sampled_from(["isolated", "groups", "surfaces", None]),
)
@settings(max_examples=4)
def test_scores_of_any_cloud_are_those_of_memory(X, tile_size, cut, strictness, by_tiles, tmp_path):
    path, cloud = written(tmp_path, X)
    detector = MCMDOutlierDetector(8, strictness=strictness, random_state=1)
    scores, _ = by_tiles(path, detector, tile_size=tile_size, cut=cut)
    assert_array_equal(scores, -in_memory(cloud, detector).scores_)


@pytest.mark.parametrize("n", [900, 30])
def test_small_clouds_are_judged_as_in_memory(n, by_tiles, tmp_path):
    path, cloud = written(tmp_path, street_with_tree(2_000)[:n])
    scores, _ = by_tiles(path, DETECTOR, tile_size=200)
    assert_array_equal(scores, -in_memory(cloud, DETECTOR).scores_)


def test_many_points_at_few_places_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(_result_files, "MOST_COPIES", 1_000)
    path, _ = written(tmp_path, np.repeat(street_with_tree(600), 2, axis=0))
    with pytest.raises(TilingError, match="1,200 points at 600 places"):
        process_files(path, tmp_path / "b.las", DETECTOR, tile_size=500)


@pytest.mark.parametrize("mode", ["drop", "mark"])
@pytest.mark.parametrize("n_jobs", [1, 2])
def test_files_are_those_that_memory_writes(mode, n_jobs, tmp_path):
    path, expected, target = (tmp_path / name for name in ("a.laz", "b.laz", "c.laz"))
    write_points(path, street(8_000))
    cloud = read_points(path)
    fitted = clone(DETECTOR).fit(cloud.xyz)
    is_outlier = fitted.scores_ < fitted.offset_
    if mode == "drop":
        write_points(expected, without_outliers(cloud, ~is_outlier))
    else:
        scores = (-fitted.scores_).astype(np.float32)
        used, lowest = np.ones(8_000, bool), LowestPoints(8_000, 16)
        noise = noise_classes(cloud, is_outlier, is_outlier, used, lowest)
        assert set(noise) == {0, 7, 18}
        write_points(expected, cloud.with_attributes(outlier_score=scores), noise=noise)
    report = process_files(path, target, DETECTOR, mode=mode, tile_size=3_000, n_jobs=n_jobs)
    assert target.read_bytes() == expected.read_bytes()
    assert report.n_workers == n_jobs
    assert report.n_outliers == is_outlier.sum()
    assert report.removed_fraction == is_outlier.mean()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.laz", "b.laz", "c.laz"]


@pytest.mark.parametrize("mode", ["drop", "mark"])
def test_points_that_are_withheld_or_of_other_classes_are_as_in_memory(mode, tmp_path):
    path, expected, target = (tmp_path / name for name in ("a.las", "b.las", "c.las"))
    cloud, rng = street(6_000), np.random.default_rng(0)
    classes, withheld = rng.choice([1, 2, 6, 9], len(cloud)), rng.random(len(cloud)) < 0.1
    cloud = cloud.with_attributes(classification=classes, withheld=withheld)
    write_points(path, cloud)
    cloud, used = read_points(path), ~withheld & np.isin(classes, [1, 2])
    fitted = clone(DETECTOR).fit(cloud.xyz[used])
    scores = np.full(len(cloud), np.nan)
    scores[used] = -fitted.scores_
    is_outlier = scores > -fitted.offset_
    if mode == "drop":
        write_points(expected, without_outliers(cloud, ~is_outlier))
    else:
        lowest = LowestPoints(len(cloud), 16)
        noise = noise_classes(cloud, is_outlier, is_outlier, used, lowest)
        scores = scores.astype(np.float32)
        write_points(expected, cloud.with_attributes(outlier_score=scores), noise=noise)
    report = process_files(
        *(path, target, DETECTOR), mode=mode, tile_size=900, only_classes=[1, 2, 6],
        ignore_classes=[6],
    )  # fmt: skip
    assert target.read_bytes() == expected.read_bytes()
    assert (report.n_judged, report.n_outliers) == (used.sum(), is_outlier.sum())
    assert report.n_points == len(cloud)


@pytest.mark.parametrize("size", [400, 5_000])
def test_a_run_whose_points_are_all_left_out_is_refused(size, tmp_path):
    write_points(tmp_path / "a.las", street(1_000))
    with pytest.raises(PointFileError, match=r"a\.las: no points are judged: all are withheld"):
        process_files(
            tmp_path / "a.las", tmp_path / "b.las", DETECTOR, only_classes=[2], tile_size=size
        )
    assert [p.name for p in tmp_path.iterdir()] == ["a.las"]


@pytest.mark.parametrize("name", ["ignore_classes", "only_classes"])
@pytest.mark.parametrize("classes", [["6"], "6", [6.5], [600], [-1], [True], 7, [None]])
def test_what_is_no_list_of_classes_is_refused(name, classes, tmp_path):
    write_points(tmp_path / "a.las", street(400))
    with pytest.raises(ValueError, match=rf"^{name}=.* is no list of classes, whole numbers from"):
        process_files(tmp_path / "a.las", tmp_path / "b.las", DETECTOR, **{name: classes})
    assert [p.name for p in tmp_path.iterdir()] == ["a.las"]


def test_few_points_among_many_of_other_classes_are_judged_as_in_memory(tmp_path):
    cloud = street(3_000)
    classes = np.where(np.arange(3_000) % 7 == 0, 2, 1)
    write_points(tmp_path / "a.las", cloud.with_attributes(classification=classes))
    expected = -in_memory(read_points(tmp_path / "a.las").subset(classes == 2), DETECTOR).scores_
    process_files(
        *(tmp_path / "a.las", tmp_path / "b.las", DETECTOR), mode="mark", only_classes=[2],
        tile_size=150,
    )  # fmt: skip
    found = read_points(tmp_path / "b.las").attributes["outlier_score"]
    assert_array_equal(found[classes == 2], expected.astype(np.float32))
    assert np.isnan(found[classes != 2]).all()


def test_files_of_a_folder_are_one_cloud(tmp_path):
    cloud = street(5_000)
    left = cloud.xyz[:, 0] < np.median(cloud.xyz[:, 0])
    (tmp_path / "in").mkdir()
    write_points(tmp_path / "in" / "a.laz", cloud.subset(left))
    write_points(tmp_path / "in" / "b.las", cloud.subset(~left))
    inputs = [read_points(tmp_path / "in" / name) for name in ("a.laz", "b.las")]
    fitted = clone(DETECTOR).fit(np.vstack([part.xyz for part in inputs]))
    kept = fitted.scores_ >= fitted.offset_
    process_files(tmp_path / "in", tmp_path / "out", DETECTOR, tile_size=1_500)
    parts = np.split(kept, [len(inputs[0])])
    for name, part, some in zip(("a.laz", "b.las"), inputs, parts, strict=True):
        found = read_points(tmp_path / "out" / name)
        assert_array_equal(found.xyz, part.xyz[some])
        assert_array_equal(found.attributes["intensity"], part.attributes["intensity"][some])


def test_a_file_of_nothing_but_outliers_is_warned_of(tmp_path):
    (tmp_path / "in").mkdir()
    write_points(tmp_path / "in" / "a.las", street(1_500))
    write_points(tmp_path / "in" / "b.las", [[3e5, 0, 5e3], [4e5, 9e3, 0]])
    with pytest.warns(UserWarning, match=r"out.b\.las: all points are outliers") as caught:
        process_files(tmp_path / "in", tmp_path / "out", DETECTOR)
    assert [warning.filename for warning in caught] == [__file__]
    with pytest.raises(PointFileError, match="holds no points"):
        read_points(tmp_path / "out" / "b.las")


# A run that kills itself within a sweep, or at the output.
RUN = """
import os, signal, sys
from sklearn_mcmd import MCMDOutlierDetector
from sklearn_mcmd.tiling import _denoise, _result_files, process_files

source, target, place = sys.argv[1:]

def die(*args, **kwargs):
    os.kill(os.getpid(), getattr(signal, "SIGKILL", signal.SIGTERM))

def twice(work, done=[]):
    def some(*args, **kwargs):
        done.append(work(*args, **kwargs) if len(done) < 2 else die())
    return some

if place == "writing":
    _result_files.Results.take = die
else:
    setattr(_denoise, place, twice(getattr(_denoise, place)))
detector = MCMDOutlierDetector(16, random_state=0)
process_files(source, target, detector, tile_size=1_500, mode="mark")
"""


@pytest.mark.parametrize(
    ("place", "n_resumed"),
    [
        ("find_planes", 2),
        *(
            pytest.param(place, n, marks=pytest.mark.slow)
            for place, n in (("write_results", 4), ("find_places", 0), ("writing", 4))
        ),
    ],
)
def test_a_run_that_was_killed_goes_on(place, n_resumed, by_tiles, tmp_path, monkeypatch):
    source = tmp_path / "a.las"
    write_points(source, street(5_000))
    expected = in_memory(read_points(source), DETECTOR)
    target = tmp_path / "denoised.las"
    assert is_killed(RUN, source, target, place)
    assert not target.exists()
    computed = []
    work = _denoise.find_planes
    monkeypatch.setattr(
        _denoise, "find_planes", lambda cell, job: computed.append(cell) or work(cell, job)
    )
    scores, report = by_tiles(source, DETECTOR, tile_size=1_500, mode="mark")
    assert_array_equal(scores, -expected.scores_)
    assert report.n_resumed == n_resumed == report.n_tiles - len(computed)
    assert not (tmp_path / "denoised.las.tiles").exists()


def test_a_tile_that_fails_has_its_line_and_does_not_end_the_others(tmp_path, monkeypatch):
    path, _ = written(tmp_path, street_with_tree(4_000))
    work = _denoise.find_planes

    def fail(cell, job):
        if cell == 1:
            raise MemoryError("too much\nof it")
        return work(cell, job)

    monkeypatch.setattr(_denoise, "find_planes", fail)
    with (
        pytest.warns(UserWarning, match="tile 1 failed .*MemoryError: too much of") as caught,
        pytest.raises(TilingError, match=r"1 of 4 tiles failed; .*b\.las\.tiles, and"),
    ):
        process_files(path, tmp_path / "b.las", DETECTOR, tile_size=1_500)
    assert [warning.filename for warning in caught] == [__file__]
    monkeypatch.setattr(_denoise, "find_planes", work)
    report = process_files(path, tmp_path / "b.las", DETECTOR, tile_size=1_500)
    assert report.n_resumed == 3


@pytest.mark.parametrize(
    ("estimator", "message"),
    [
        (MCMDOutlierDetector(None, random_state=0), "n_neighbors=None"),
        (MCMDOutlierDetector(), "random_state"),
        (MCMDOutlierDetector(cutoff=3, contamination=0.1, random_state=0), "exclude each other"),
        (
            MCMDOutlierDetector(cutoff=3, false_positive_rate=0.1, random_state=0),
            "exclude each other",
        ),
        (MCMDOutlierDetector(strictness="much", random_state=0), "strictness"),
    ],
)
def test_detectors_that_cannot_work_are_refused_before_the_work(tmp_path, estimator, message):
    path, _ = written(tmp_path, street_with_tree(2_000))
    with pytest.raises(ValueError, match=message):
        process_files(path, tmp_path / "b.las", estimator)
    with pytest.raises(ValueError, match="mode"):
        process_files(path, tmp_path / "b.las", DETECTOR, mode="keep")
    with pytest.raises(ValueError, match=r"colors=True has no meaning for MCMDOutlierDetector"):
        process_files(path, tmp_path / "b.las", DETECTOR, colors=True)
    assert [p.name for p in tmp_path.iterdir()] == ["a.las"]


@pytest.mark.slow
@pytest.mark.parametrize(("scene", "strictness"), [("street", "groups"), ("airborne", "surfaces")])
def test_many_points_have_the_scores_of_memory(scene, strictness, by_tiles, tmp_path):
    make = {
        "street": lambda: make_street(40_000, outlier_share=0.1, tree=True, random_state=1),
        "airborne": lambda: make_airborne_scan(40_000, random_state=1),
    }
    path, cloud = written(tmp_path, np.round(make[scene]().data, 3))
    detector = MCMDOutlierDetector(strictness=strictness, random_state=0)
    expected = -in_memory(cloud, detector).scores_
    scores, _ = by_tiles(path, detector, tile_size=5_000, n_jobs=2)
    assert_array_equal(scores, expected)


@pytest.mark.parametrize("digits", [0, 1, 9])
@pytest.mark.parametrize("step", [1, 7, 400])
def test_points_are_taken_evenly_in_the_order_of_their_coordinates(digits, step):
    rng = np.random.default_rng(step)
    xyz = np.unique(np.round(rng.normal(0, 3, (2_000, 3)), digits), axis=0)
    ordered = xyz.copy()
    rng.shuffle(xyz)
    assert_array_equal(xyz[_denoise.evenly_along_x(xyz, step)], ordered[::step])
