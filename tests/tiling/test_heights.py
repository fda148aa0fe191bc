"""Heights over the ground, and groups below it, by tiles are those in memory."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from sklearn_mcmd import MCMDOutlierDetector
from sklearn_mcmd.cli._denoise import _verdict, judged_points
from sklearn_mcmd.io import PointCloud, PointFileError, read_points, write_points
from sklearn_mcmd.io._classes import Choice
from sklearn_mcmd.tiling import _heights, process_files
from tiled import fit_in_memory, names_in

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


def in_memory(source, **heights):
    """The `Judged` points, the classes, and scores."""
    cloud = read_points(source)
    points = judged_points(source, cloud, Choice(), **heights)
    fitted = fit_in_memory(cloud.xyz[points.used], DETECTOR)
    return points, *_verdict(cloud, points, fitted, heights.get("low_groups", False))[:2]


@pytest.mark.parametrize(
    ("scene", "heights"),
    [*(("site", heights) for heights in (NEAR, GROUPS, ALL)), ("lattice", ALL)],
)
def test_the_same_points_are_judged_and_the_same_groups_lie_below_the_ground(
    scene, heights, tmp_path, monkeypatch
):
    """The ground has small cells, too; other scores are those of tiles."""
    monkeypatch.setattr(_heights, "CAPACITY", 300)
    a, c = tmp_path / "a.las", tmp_path / "c.las"
    write_points(a, (lattice if scene == "lattice" else site)())
    points, classes, score = in_memory(a, **heights)
    report = process_files(a, c, DETECTOR, mode="mark", tile_size=900, **heights)
    found = read_points(c).attributes
    assert report.n_tiles > 4
    assert (report.n_judged, report.n_used) == (points.judged.sum(), points.used.sum())
    assert_array_equal(np.isnan(found["outlier_score"]), np.isnan(score))
    noise = np.where(np.isin(found["classification"], (7, 18)), found["classification"], 0)
    assert np.count_nonzero(noise != classes) <= 0.01 * np.count_nonzero(classes) + 2


def test_the_ground_of_one_file_counts_for_the_points_of_another(tmp_path):
    cloud = site()
    cloud.xyz[:] = np.round(cloud.xyz, 3)  # one step for all three files
    is_ground = cloud.attributes["classification"] == 2
    (tmp_path / "in").mkdir()
    write_points(tmp_path / "in" / "a.las", cloud.subset(is_ground))
    write_points(tmp_path / "in" / "b.las", cloud.subset(~is_ground))
    order = np.concatenate([np.flatnonzero(is_ground), np.flatnonzero(~is_ground)])
    write_points(tmp_path / "all.las", cloud.subset(order))
    _, classes, score = in_memory(tmp_path / "all.las", **ALL)
    process_files(tmp_path / "in", tmp_path / "out", DETECTOR, mode="mark", **ALL)
    found = [read_points(tmp_path / "out" / name).attributes for name in ("a.las", "b.las")]
    found = {name: np.concatenate([f[name] for f in found]) for name in found[0]}
    noise = np.isin(found["classification"], (7, 18))
    assert_array_equal(np.where(noise, found["classification"], 0), classes)
    assert_array_equal(found["outlier_score"], score.astype(np.float32))


def test_points_without_ground_or_at_other_heights_are_said(tmp_path):
    a, c = tmp_path / "a.las", tmp_path / "c.las"
    write_points(a, site(600))
    with pytest.raises(PointFileError, match=r"no points are judged: .* or at other heights"):
        process_files(a, c, DETECTOR, above=1e6)
    cloud = read_points(a)
    write_points(a, cloud.subset(cloud.attributes["classification"] != 2))
    with pytest.raises(PointFileError, match=r"a\.las: .* fewer than 3 points have the class 2"):
        process_files(a, c, DETECTOR, low_groups=True, restart=True)
    assert names_in(tmp_path) == ["a.las"]
