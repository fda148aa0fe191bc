"""Heights over the ground by tiles are those in memory to the last bit."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_array_equal
from sklearn.base import clone

from sklearn_mcmd import MCMDOutlierDetector
from sklearn_mcmd.cli._denoise import Denoise, _verdict, judged_points
from sklearn_mcmd.io import PointCloud, PointFileError, read_points, write_points
from sklearn_mcmd.io._classes import Choice
from sklearn_mcmd.io._ground import Ground
from sklearn_mcmd.tiling import TilingError, _heights, _memory, process_files
from tiled import divide, is_killed

DETECTOR = MCMDOutlierDetector(16, random_state=0)
NEAR = {"above": -0.5, "below": 6.0}
GROUPS = {"low_groups": True}
ALL = {"above": -30.0, "below": 25.0, "low_groups": True}


def site(n=3_000, seed=0):
    """A slope with a hole, a roof, groups below it and single points; some points withheld."""
    rng = np.random.default_rng(seed)
    ground = rng.uniform(0, 30, (n, 3)) * [1, 1, 0] + rng.normal(0, 0.01, (n, 3))
    ground[:, 2] += 0.1 * ground[:, 0]
    ground = ground[np.abs(ground[:, :2] - [8, 20]).max(axis=1) > 2.5]
    roof = rng.uniform(5, 12, (n // 5, 3)) * [1, 1, 0] + [0, 0, 7]
    deep = [rng.normal([x, 12, -9], 0.4, (n // 15, 3)) for x in (6, 15, 24)]
    wide = rng.uniform(12, 18, (n // 15, 3)) * [1, 1, 0] - [0, 0, 3]
    single = rng.uniform(-5, 35, (n // 60, 3)) * [1, 1, 0] + rng.uniform(-20, 40, (n // 60, 1))
    parts = [ground, roof, *deep, wide, single]
    classes = np.repeat([2, 6, 1], [len(ground), len(roof), sum(map(len, parts[2:]))])
    return cloud_of(np.vstack(parts), classes)


def cloud_of(xyz, classes):
    withheld = np.arange(len(xyz)) % 40 == 39
    return PointCloud(xyz, {"classification": classes, "withheld": withheld})


def lattice():
    """Ground points, and others, that are equally distant from many."""
    cloud = site()
    xyz = np.round(cloud.xyz * [2, 2, 4]) / [2, 2, 4]
    classes = cloud.attributes["classification"]
    return cloud_of(np.vstack([xyz, xyz[:400]]), np.append(classes, np.full(400, 2)))


def far_apart():
    a, b = site(1_500), site(1_500, 1)
    rest = np.random.default_rng(0).uniform(-1e4, 1e4, (20, 3))
    moved = b.xyz + np.array([3e3, 0, 50])
    classes = [a.attributes["classification"], b.attributes["classification"], np.ones(20, int)]
    return cloud_of(np.vstack([a.xyz, moved, rest]), np.concatenate(classes))


def little_ground():
    cloud = site()
    classes = cloud.attributes["classification"].copy()
    classes[5 : np.count_nonzero(classes == 2)] = 1
    return cloud.with_attributes(classification=classes)


SCENES = {
    "site": site,
    "lattice": lattice,
    "far apart": far_apart,
    "little ground": little_ground,
}


def in_memory(source, target, mode="mark", choice=None, detector=DETECTOR, **heights):
    """Write what a run by tiles must equal; returns the `Judged` points and the classes."""
    cloud = read_points(source)
    points = judged_points(source, cloud, choice or Choice(), **heights)
    used = cloud.xyz[points.used]
    single = used.astype(np.float32)
    fitted = clone(detector).fit(single if np.array_equal(single, used) else used)
    low_groups = heights.get("low_groups", False)
    classes, score, _ = _verdict(cloud, points, fitted, low_groups)
    found = SimpleNamespace(classes=classes, score=score)
    made, noise = Denoise(source, target, mode=mode).written(cloud, found)
    write_points(target, made, noise=noise)
    return points, classes


def files(tmp_path):
    return tuple(tmp_path / name for name in ("a.las", "b.las", "c.las"))


@pytest.mark.parametrize(
    ("scene", "heights"),
    [
        *(pytest.param("site", heights) for heights in (NEAR, GROUPS, ALL)),
        *[("lattice", ALL), ("far apart", ALL), ("little ground", ALL)],
    ],
)
def test_verdicts_are_those_of_memory_wherever_tiles_begin(scene, heights, tmp_path):
    a, b, c = files(tmp_path)
    write_points(a, SCENES[scene]())
    points, classes = in_memory(a, b, **heights)
    for tile_size, cut in ((500, 0.3), *[(10_000, 0.5)] * (scene == "lattice")):
        report = divide(a, c, DETECTOR, mode="mark", tile_size=tile_size, cut=cut, **heights)
        assert c.read_bytes() == b.read_bytes()
        assert report.n_outliers == np.count_nonzero(classes)
        assert (report.n_judged, report.n_used) == (points.judged.sum(), points.used.sum())
    if scene == "site":
        assert (classes == 7).any() == (heights is not NEAR)
        assert (report.n_judged < report.n_used) == (heights is not GROUPS)


@pytest.mark.parametrize(
    ("options", "params", "mode"),
    [
        ({"ignore_classes": [2]}, {"strictness": "surfaces"}, "drop"),
        ({"only_classes": [1, 2]}, {"contamination": 0.1}, "mark"),
        ({}, {"strictness": None}, "drop"),
    ],
    ids=["ignored", "only", "paper"],
)
def test_verdicts_are_those_of_memory_for_other_points_and_detectors(
    options, params, mode, tmp_path
):
    a, b, c = files(tmp_path)
    write_points(a, site())
    detector = clone(DETECTOR).set_params(**params)
    choice = Choice(options.get("ignore_classes", ()), options.get("only_classes", ()))
    in_memory(a, b, mode, choice, detector, **ALL)
    process_files(a, c, detector, mode=mode, tile_size=900, **options, **ALL)
    assert c.read_bytes() == b.read_bytes()


@given(
    n=st.integers(60, 900),
    seed=st.integers(0, 10**6),
    digits=st.sampled_from([0, 1, 3]),
    tile_size=st.integers(100, 900),
    cut=st.floats(0.2, 0.8),
    above=st.sampled_from([None, -8.0, 0.0]),
)
@settings(max_examples=4)
def test_verdicts_of_any_cloud_are_those_of_memory(
    n, seed, digits, tile_size, cut, above, tmp_path
):
    a, b, c = files(tmp_path)
    cloud = site(n, seed)
    write_points(a, cloud_of(np.round(cloud.xyz, digits), cloud.attributes["classification"]))
    in_memory(a, b, above=above, low_groups=True)
    options = {"above": above, "low_groups": True, "tile_size": tile_size, "cut": cut}
    divide(a, c, DETECTOR, mode="mark", **options)
    assert c.read_bytes() == b.read_bytes()


@pytest.mark.parametrize("n_jobs", [1, 2])
def test_the_ground_of_one_file_counts_for_the_points_of_another(n_jobs, tmp_path):
    cloud = site()
    cloud.xyz[:] = np.round(cloud.xyz, 3)  # one step for all three files
    is_ground = cloud.attributes["classification"] == 2
    (tmp_path / "in").mkdir()
    write_points(tmp_path / "in" / "a.las", cloud.subset(is_ground))
    write_points(tmp_path / "in" / "b.las", cloud.subset(~is_ground))
    parts = [read_points(tmp_path / "in" / name) for name in ("a.las", "b.las")]
    columns = {
        name: np.concatenate([part.attributes[name] for part in parts])
        for name in ("classification", "withheld")
    }
    write_points(tmp_path / "all.las", PointCloud(np.vstack([p.xyz for p in parts]), columns))
    _, classes = in_memory(tmp_path / "all.las", tmp_path / "expected.las", **ALL)
    process_files(
        *(tmp_path / "in", tmp_path / "out", DETECTOR), mode="mark", tile_size=900, n_jobs=n_jobs,
        **ALL,
    )  # fmt: skip
    found = [read_points(tmp_path / "out" / name).attributes for name in ("a.las", "b.las")]
    found = {name: np.concatenate([f[name] for f in found]) for name in found[0]}
    noise = np.isin(found["classification"], (7, 18))
    assert_array_equal(np.where(noise, found["classification"], 0), classes)
    expected = read_points(tmp_path / "expected.las").attributes["outlier_score"]
    assert_array_equal(found["outlier_score"], expected)


def test_other_heights_need_no_new_scores(tmp_path, monkeypatch):
    a, b, c = files(tmp_path)
    write_points(a, site())

    def fail(*args):
        raise MemoryError

    with monkeypatch.context() as patch:
        patch.setattr(_heights.Heights, "scored", fail)
        with pytest.raises(TilingError, match="MemoryError; what was done is kept"):
            process_files(a, c, DETECTOR, mode="mark", tile_size=900, **ALL)
    in_memory(a, b, **NEAR)
    report = process_files(a, c, DETECTOR, mode="mark", tile_size=900, **NEAR)
    assert report.n_resumed == report.n_tiles
    assert c.read_bytes() == b.read_bytes()


# A run that kills itself while it looks at heights.
RUN = """
import os, signal, sys
from sklearn_mcmd import MCMDOutlierDetector
from sklearn_mcmd.tiling import _heights, process_files

source, target, place = sys.argv[1:]

def twice(work, done=[]):
    def some(*args, **kwargs):
        if len(done) == 2:
            os.kill(os.getpid(), getattr(signal, "SIGKILL", signal.SIGTERM))
        done.append(work(*args, **kwargs))
        return done[-1]
    return some

setattr(_heights, place, twice(getattr(_heights, place)))
process_files(source, target, MCMDOutlierDetector(16, random_state=0), tile_size=900,
               mode="mark", above=-30.0, below=40.0, low_groups=True)
"""


@pytest.mark.parametrize(
    ("place", "n_resumed"),
    [("find_verdicts", 5), pytest.param("find_heights", 0, marks=pytest.mark.slow)],
)
def test_a_run_that_was_killed_goes_on(place, n_resumed, tmp_path):
    a, b, c = files(tmp_path)
    write_points(a, site())
    in_memory(a, b, **ALL)
    assert is_killed(RUN, a, c, place)
    assert not c.exists()
    report = process_files(a, c, DETECTOR, mode="mark", tile_size=900, **ALL)
    assert c.read_bytes() == b.read_bytes()
    assert (report.n_resumed > 0) == (n_resumed > 0)
    assert not (tmp_path / "c.las.tiles").exists()


def test_points_without_ground_or_at_other_heights_are_said(tmp_path):
    a, _, c = files(tmp_path)
    write_points(a, site(600))
    with pytest.raises(TilingError, match=r"no points are judged: .* or at other heights"):
        process_files(a, c, DETECTOR, above=1e6)
    cloud = read_points(a)
    write_points(a, cloud.subset(cloud.attributes["classification"] != 2))
    with pytest.raises(PointFileError, match=r"a\.las: .* fewer than 3 points have the class 2"):
        process_files(a, c, DETECTOR, low_groups=True, restart=True)
    assert [path.name for path in tmp_path.iterdir()] == ["a.las"]


@pytest.mark.parametrize("wrong", [{"above": np.nan}, {"below": "2"}])
def test_what_is_no_height_is_refused(wrong, tmp_path):
    with pytest.raises(ValueError, match="must be a finite number, or None"):
        process_files(tmp_path, tmp_path / "b.las", DETECTOR, **wrong)


def test_groups_below_the_ground_that_take_more_than_the_memory_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(_memory, "BELOW_POINT", 10**7)
    a, _, c = files(tmp_path)
    write_points(a, site())
    with pytest.raises(TilingError, match=r"points lie below the ground, .* memory=500MB"):
        process_files(a, c, DETECTOR, low_groups=True, memory="500MB", tile_size=900)


def test_the_nearest_ground_is_that_of_all_whatever_cells_there_are(tmp_path):
    cloud = lattice()
    writer = _heights.GroundWriter(tmp_path, 300, 0.4)
    for rows in np.array_split(np.arange(len(cloud)), 7):
        writer.add(cloud.subset(rows))
    cells = writer.close()
    is_ground = (cloud.attributes["classification"] == 2) & ~cloud.attributes["withheld"]
    assert cells.counts.sum() == is_ground.sum()
    queries = cloud.xyz[::5]
    expected = Ground(cloud.xyz[is_ground]).nearest(queries)
    for part in (slice(None), slice(100, 130), slice(3, 4)):
        found = _heights._nearest_ground(cells, queries[part])
        assert_array_equal(found, np.array(expected)[:, part])


def test_cells_of_fewer_ground_points_than_corners_are_put_together(tmp_path):
    xyz = np.random.default_rng(0).uniform(size=(40, 3)) * [9, 9, 1]
    writer = _heights.GroundWriter(tmp_path, 2, 0.5)
    writer.add(PointCloud(xyz, {"classification": np.full(40, 2, np.uint8)}))
    queries = np.random.default_rng(1).uniform(-5, 15, (30, 3))
    found = _heights._nearest_ground(writer.close(), queries)
    assert_array_equal(found, Ground(xyz).nearest(queries))
