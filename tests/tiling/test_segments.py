"""Regions by tiles are those of memory, wherever tiles begin and runs end."""

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_array_equal
from sklearn.base import clone

from benchmarks.simulators import make_airborne_scan, make_bus_stop
from sklearn_mcmd import RegionGrowing, RobustNormalEstimator
from sklearn_mcmd.datasets import make_crown_roof, make_street
from sklearn_mcmd.io import PointCloud, read_points, write_points
from sklearn_mcmd.tiling import TilingError, _memory, _result_files, _segments, process_files
from tiled import divide, is_killed, street

GROWING = RegionGrowing(20, normal_estimator=RobustNormalEstimator(24, random_state=0), max_angle=8)
RNG = np.random.default_rng(0)


@cache
def street_with_tree(n, seed=0):
    return make_street(n, outlier_share=0.03, tree=True, random_state=seed).data


def with_copies():
    X = np.round(street_with_tree(2_800), 2)
    return np.vstack([X, X[:900], X[:900], X[-40:]])


def far_apart():
    X = street_with_tree(2_800).copy()
    X[1_400:, 0] += 1e4
    return np.vstack([X, RNG.uniform(-1e5, 1e5, (15, 3))])


def blunt_gable():
    X = np.random.default_rng(0).uniform(-1, 1, (2_800, 3))
    X[:, 2] *= 0.01
    X[:, 2] -= 0.18 * np.abs(X[:, 0])
    return X


SCENES = {
    "blunt gable": blunt_gable,
    "street": lambda: street_with_tree(2_800),
    "bus stop": lambda: make_bus_stop(3_000, random_state=0).data,
    "crown roof": lambda: make_crown_roof(2_800, random_state=0).data,
    "airborne": lambda: make_airborne_scan(2_600, random_state=0).data,
    "copies": with_copies,
    "far apart": far_apart,
    "volume": lambda: RNG.uniform(0, 5, (3_000, 3)),
    "lattice": lambda: np.unique(RNG.integers(0, 14, (2_900, 3)), axis=0) * 0.25,
    "plane of equal steps": lambda: np.indices((60, 60, 1)).reshape(3, -1).T * 0.1,
    "single precision": lambda: np.round(64 * street_with_tree(2_800)) / 64,
    "sparse beside dense": lambda: np.vstack(
        [street_with_tree(2_500), street_with_tree(2_500, seed=1) / 30]
    ),
}
LARGER_TILES = {"street", "copies", "far apart", "volume"}  # these are tried with them, too
SLOW_SCENES = ("bus stop", "airborne", "single precision", "sparse beside dense")
SWITCHES = [
    {"normal_estimator__n_neighbors": "auto", "normal_estimator__orientation": "mst"},
    {"refine": False},
    {"max_gap": 0.15},
    {"max_distance": 0.02},
    {"refine": False, "max_distance": 0.02, "max_gap": 0.2},
    {"min_region_size": 1, "n_neighbors": 30},
    {"normal_estimator__neighbor_planes": False},
]


def written(folder, xyz):
    """A file of the points, and its cloud as it is read."""
    write_points(folder / "a.las", PointCloud(xyz))
    return folder / "a.las", read_points(folder / "a.las")


def in_memory(cloud, growing=GROWING):
    single = cloud.xyz.astype(np.float32)
    return clone(growing).fit(single if np.array_equal(single, cloud.xyz) else cloud.xyz)


def assert_equal_by_tiles(path, cloud, growing, divisions, **options):
    expected, target = in_memory(cloud, growing), path.with_name("b.las")
    for tile_size, cut in divisions:
        report = divide(path, target, growing, tile_size=tile_size, cut=cut, **options)
        assert_array_equal(read_points(target).attributes["region"], expected.labels_)
        assert report.n_regions == expected.n_regions_
        assert report.n_inside == (expected.labels_ >= 0).sum()
        assert list(report.largest) == expected.region_sizes_[:20].tolist()
        assert report.n_tiles >= len(cloud) / tile_size
    return expected


def some_slow(values, slow):
    """All values, of which some are tried with the slow tests."""
    return [
        pytest.param(value, marks=[pytest.mark.slow] if value in slow else []) for value in values
    ]


@pytest.mark.parametrize("scene", some_slow(SCENES, SLOW_SCENES))
def test_labels_are_those_of_memory_wherever_tiles_begin(scene, tmp_path):
    path, cloud = written(tmp_path, SCENES[scene]())
    divisions = ((800, 0.3), (2_600, 0.7))
    assert_equal_by_tiles(path, cloud, GROWING, divisions[: 1 + (scene in LARGER_TILES)])


@pytest.mark.parametrize(
    "params",
    some_slow(SWITCHES, SWITCHES[8:]),
    ids=lambda params: "-".join(f"{name}={value}" for name, value in params.items()),
)
def test_labels_are_those_of_memory_for_all_parameters(params, tmp_path):
    path, cloud = written(tmp_path, np.round(street_with_tree(2_800), 3))
    assert_equal_by_tiles(path, cloud, clone(GROWING).set_params(**params), ((900, 0.4),))


@pytest.mark.slow
@pytest.mark.parametrize(("scene", "params"), list(zip(SCENES, SWITCHES, strict=True)), ids=str)
def test_each_scene_has_the_labels_of_memory_with_other_parameters(scene, params, tmp_path):
    path, cloud = written(tmp_path, SCENES[scene]())
    growing = clone(GROWING).set_params(**params)
    assert_equal_by_tiles(path, cloud, growing, ((900, 0.4),))


@st.composite
def clouds(draw):
    """More than two thousand places: faces, strips, clusters, some rounded or copied."""
    rng = np.random.default_rng(draw(st.integers(0, 10**6)))
    n_volume, n_far = draw(st.integers(1, 800)), draw(st.integers(0, 40))
    faces = []
    for _ in range(draw(st.integers(1, 4))):
        size = rng.choice([0.3, 2.0, 5.0], 2)
        face = rng.uniform(0, 1, (800, 3)) * [*size, 0] + rng.normal(0, 0.01, (800, 3))
        faces.append(np.roll(face, rng.integers(3), axis=1) + rng.integers(0, 3, 3))
    parts = [*faces, rng.normal(0, 1, (n_volume + 1_600, 3)), rng.uniform(-90, 90, (n_far, 3))]
    X = np.round(np.vstack(parts), draw(st.sampled_from([2, 4])))
    return np.vstack([X, X[rng.integers(0, len(X), draw(st.integers(0, 300)))]])


@given(X=clouds(), tile_size=st.integers(300, 1_500), cut=st.floats(0.2, 0.8))
@settings(max_examples=2)
def test_labels_of_any_cloud_are_those_of_memory(X, tile_size, cut, tmp_path):
    path, cloud = written(tmp_path, X)
    assert_equal_by_tiles(path, cloud, GROWING, ((tile_size, cut),))


@pytest.mark.parametrize("n", [1_900, 30])
def test_small_clouds_are_segmented_as_in_memory(n, tmp_path):
    path, cloud = written(tmp_path, street_with_tree(2_500)[:n])
    assert_equal_by_tiles(path, cloud, GROWING, ((300, 0.5),))


def test_many_points_at_few_places_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(_result_files, "MOST_COPIES", 1_000)
    path, _ = written(tmp_path, np.repeat(street_with_tree(600), 2, axis=0))
    with pytest.raises(TilingError, match="1,200 points at 600 places"):
        process_files(path, tmp_path / "b.las", GROWING, tile_size=500)


@pytest.mark.parametrize("n_jobs", [1, 2])
def test_a_folder_is_one_cloud_and_keeps_its_attributes(n_jobs, tmp_path):
    cloud = street(6_000)
    left = cloud.xyz[:, 0] < np.median(cloud.xyz[:, 0])
    (tmp_path / "in").mkdir()
    write_points(tmp_path / "in" / "a.laz", cloud.subset(left))
    colors = {name: np.arange(3_000, dtype=np.uint16) for name in ("red", "green", "blue")}
    write_points(tmp_path / "in" / "b.las", cloud.subset(~left).with_attributes(**colors))
    inputs = [read_points(tmp_path / "in" / name) for name in ("a.laz", "b.las")]
    fitted = in_memory(PointCloud(np.vstack([part.xyz for part in inputs])))
    report = process_files(
        tmp_path / "in", tmp_path / "out", GROWING, tile_size=1_500, n_jobs=n_jobs
    )
    assert report.n_workers == n_jobs
    parts = np.split(fitted.labels_, [len(inputs[0])])
    for name, part, labels in zip(("a.laz", "b.las"), inputs, parts, strict=True):
        expected = tmp_path / f"expected-{name}"
        write_points(expected, _segments.segmented(part, labels))
        assert (tmp_path / "out" / name).read_bytes() == expected.read_bytes()
        found = read_points(tmp_path / "out" / name).attributes
        assert_array_equal(found["intensity"], part.attributes["intensity"])
        if name == "b.las":
            assert_array_equal(found["red"], colors["red"])
    assert sorted(p.name for p in tmp_path.iterdir() if p.suffix == ".tiles") == []


@pytest.mark.parametrize("colors", [True, False])
def test_colors_are_written_if_they_are_asked_for(colors, tmp_path):
    path, _ = written(tmp_path, street_with_tree(2_500))
    process_files(path, tmp_path / "b.las", GROWING, tile_size=1_500, colors=colors)
    assert ("red" in read_points(tmp_path / "b.las").attributes) == colors


# A run that kills itself within a sweep, after growth, or at the output.
RUN = """
import os, signal, sys
from sklearn_mcmd import RegionGrowing, RobustNormalEstimator
from sklearn_mcmd.tiling import _result_files, _segments, process_files

source, target, place = sys.argv[1:]

def die(*args, **kwargs):
    os.kill(os.getpid(), getattr(signal, "SIGKILL", signal.SIGTERM))

def some(work, done=[]):
    def limited(*args, **kwargs):
        done.append(work(*args, **kwargs) if len(done) < 2 else die())
    return limited

if place == "writing":
    _result_files.Results.take = die
elif place == "tell_planes":
    _segments.tell_planes = some(_segments.tell_planes)
else:
    setattr(_segments, place, die)
normals = RobustNormalEstimator(24, random_state=0)
growing = RegionGrowing(20, normal_estimator=normals, max_angle=8)
process_files(source, target, growing, tile_size=1_500)
"""


@pytest.mark.parametrize(
    ("place", "n_resumed"),
    [
        ("tell_planes", 2),
        *(
            pytest.param(place, n, marks=pytest.mark.slow)
            for place, n in (("finish_regions", 4), ("write_results", 4), ("writing", 4))
        ),
    ],
)
def test_a_run_that_was_killed_goes_on(place, n_resumed, tmp_path):
    path, cloud = written(tmp_path, street_with_tree(4_000))
    target = tmp_path / "b.las"
    assert is_killed(RUN, path, target, place)
    assert not target.exists()
    report = process_files(path, target, GROWING, tile_size=1_500)
    assert report.n_resumed == n_resumed <= report.n_tiles
    assert_array_equal(read_points(target).attributes["region"], in_memory(cloud).labels_)
    assert not (tmp_path / "b.las.tiles").exists()


def test_a_tile_that_fails_has_its_line_and_does_not_end_the_others(tmp_path, monkeypatch):
    path, cloud = written(tmp_path, street_with_tree(4_000))
    work = _segments.tell_planes

    def fail(cell, job, fitted):
        if cell == 1:
            raise MemoryError("too much\nof it")
        return work(cell, job, fitted)

    monkeypatch.setattr(_segments, "tell_planes", fail)
    with (
        pytest.warns(UserWarning, match="tile 1 failed .*MemoryError: too much of"),
        pytest.raises(TilingError, match=r"1 of 4 tiles failed; .*b\.las\.tiles, and"),
    ):
        process_files(path, tmp_path / "b.las", GROWING, tile_size=1_500)
    monkeypatch.setattr(_segments, "tell_planes", work)
    report = process_files(path, tmp_path / "b.las", GROWING, tile_size=1_500)
    assert report.n_resumed == 3
    found = read_points(tmp_path / "b.las").attributes["region"]
    assert_array_equal(found, in_memory(cloud).labels_)


@pytest.mark.parametrize(
    ("estimator", "message"),
    [
        (RegionGrowing(normals="precomputed"), "precomputed"),
        (RegionGrowing(), "random_state"),
        (RegionGrowing(max_angle=100, random_state=0), "max_angle"),
    ],
)
def test_estimators_that_cannot_work_are_refused_before_the_work(tmp_path, estimator, message):
    path, _ = written(tmp_path, street_with_tree(2_000))
    with pytest.raises(ValueError, match=message):
        process_files(path, tmp_path / "b.las", estimator)
    assert [p.name for p in tmp_path.iterdir()] == ["a.las"]


def test_too_little_memory_to_join_regions_is_refused_before_the_work(tmp_path):
    path, _ = written(tmp_path, street_with_tree(2_000))
    with pytest.raises(ValueError, match="too little"):
        process_files(path, tmp_path / "b.las", GROWING, memory="10MB")


def test_points_on_no_surface_that_take_more_than_the_memory_are_warned_of(tmp_path, monkeypatch):
    monkeypatch.setattr(_memory, "REST_POINT", 10**6)
    path, cloud = written(tmp_path, SCENES["volume"]())
    with pytest.warns(UserWarning, match=r"of 3,000 different points .* more than memory=500MB"):
        process_files(path, tmp_path / "b.las", GROWING, memory="500MB", tile_size=2_000)
    found = read_points(tmp_path / "b.las").attributes["region"]
    assert_array_equal(found, in_memory(cloud).labels_)


@pytest.mark.slow
@pytest.mark.parametrize("scene", ["street", "airborne"])
def test_many_points_have_the_labels_of_memory(scene, tmp_path):
    make = {
        "street": lambda: make_street(40_000, outlier_share=0.02, tree=True, random_state=1),
        "airborne": lambda: make_airborne_scan(40_000, random_state=1),
    }
    path, cloud = written(tmp_path, np.round(make[scene]().data, 3))
    growing = RegionGrowing(normal_estimator=RobustNormalEstimator(random_state=0))
    assert_equal_by_tiles(path, cloud, growing, ((5_000, 0.5),), n_jobs=2)
