"""Heights over the ground, and groups below it, by tiles are those in memory."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from commands import done
from sklearn_mcmd.io import PointCloud, read_points, write_points
from sklearn_mcmd.tiling import _outliers, process_files
from tiled import OUTLIERS

NEAR = {"above": -0.5, "below": 6.0}
GROUPS = {"low_groups": True}
ALL = {"above": -30.0, "below": 25.0, "low_groups": True}


def site():
    """A slope with a hole, a roof, groups below it and single points; some points withheld."""
    rng, n = np.random.default_rng(0), 3_000
    ground = rng.uniform(0, 30, (n, 3)) * [1, 1, 0] + rng.normal(0, 0.01, (n, 3))
    ground[:, 2] += 0.1 * ground[:, 0]
    ground = ground[np.abs(ground[:, :2] - [8, 20]).max(axis=1) > 2.5]
    roof = rng.uniform(5, 12, (n // 5, 3)) * [1, 1, 0] + [0, 0, 7]
    deep = [rng.normal([x, 12, -9], 0.4, (n // 15, 3)) for x in (6, 15, 24)]
    wide = rng.uniform(12, 18, (n // 15, 3)) * [1, 1, 0] - [0, 0, 3]
    single = rng.uniform(-5, 35, (n // 60, 3)) * [1, 1, 0] + rng.uniform(-20, 40, (n // 60, 1))
    parts = [ground, roof, *deep, wide, single]
    classes = np.repeat([2, 6, 1], [len(ground), len(roof), sum(map(len, parts[2:]))])
    return cloud_of(np.round(np.vstack(parts), 3), classes)


def cloud_of(xyz, classes):
    withheld = np.arange(len(xyz)) % 40 == 39
    return PointCloud(xyz, {"classification": classes, "withheld": withheld})


def lattice():
    """Ground points, and others, that are equally distant from many."""
    cloud = site()
    xyz = np.round(cloud.xyz * [2, 2, 4]) / [2, 2, 4]
    classes = cloud.attributes["classification"]
    return cloud_of(np.vstack([xyz, xyz[:400]]), np.append(classes, np.full(400, 2)))


def in_memory(source, heights):
    """The attributes of points that are marked without tiles."""
    options = [f"--{name}={value}" for name, value in heights.items() if name != "low_groups"]
    options += ["--low-groups"] * ("low_groups" in heights)
    known = ("--mode", "mark", "--n-neighbors", 16, "--sensor", "none")
    done("denoise", source, source.with_name("memory.las"), *known, *options)
    return read_points(source.with_name("memory.las")).attributes


@pytest.mark.parametrize(
    ("scene", "heights"), [(site, NEAR), (site, GROUPS), (site, ALL), (lattice, ALL)]
)
def test_the_same_points_are_judged_and_the_same_groups_lie_below_the_ground(
    scene, heights, tmp_path, monkeypatch
):
    """The ground has small cells, too; other scores are those of tiles."""
    monkeypatch.setattr(_outliers, "CAPACITY", 300)
    a, c = tmp_path / "a.las", tmp_path / "c.las"
    write_points(a, cloud := scene())
    expected = in_memory(a, heights)
    report = process_files(a, c, OUTLIERS, mode="mark", tile_size=900, **heights)
    found, is_judged = read_points(c).attributes, ~np.isnan(expected["outlier_score"])
    assert report.n_tiles > 4
    n_used = np.count_nonzero(~cloud.attributes["withheld"])
    assert (report.n_judged, report.n_used) == (is_judged.sum(), n_used)
    assert_array_equal(np.isnan(found["outlier_score"]), ~is_judged)
    classes, other = expected["classification"], found["classification"]
    noise = np.isin(classes, (7, 18)) | np.isin(other, (7, 18))
    assert np.count_nonzero((classes != other)[noise]) <= 0.01 * np.count_nonzero(noise) + 2
    assert np.count_nonzero(noise) > 10
