"""mcmd change: its columns are those of CloudChange, and its words those of what happened."""

import laspy
import numpy as np
import pytest

from commands import done, error_line, run, usage_error
from sklearn_mcmd import CloudChange
from sklearn_mcmd.io import PointCloud, read_points, write_points

N = 1_500


@pytest.fixture(scope="module")
def scans():
    """A corner of three faces, of which one moved by 2 cm."""
    rng = np.random.default_rng(0)

    def corner(shift):
        faces = [
            rng.uniform(0.02, 1, (N // 3, 3)) * [axis != k for axis in range(3)] for k in range(3)
        ]
        faces[2][:, 2] += shift
        return np.round(np.vstack(faces) + rng.normal(0, 0.002, (N, 3)), 6)

    return corner(0.0), corner(0.02)


@pytest.fixture
def files(scans, tmp_path):
    paths = tmp_path / "before.laz", tmp_path / "after.ply"
    intensity = {"intensity": np.arange(N, dtype=np.uint16)}
    write_points(paths[0], PointCloud(scans[0], intensity))
    write_points(paths[1], PointCloud(scans[1]))
    return paths


@pytest.mark.parametrize(
    ("options", "parameters"),
    [
        ([], {}),
        (
            ["--registration", "3mm", "--unit", "m", "--alpha", 0.01, "--correction", "none"],
            {"registration": 0.003, "alpha": 0.01, "correction": "none"},
        ),
        (["--n-neighbors", 30, "--reach", 0.5], {"n_neighbors": 30, "reach": 0.5}),
        (["--registration", "auto"], {"registration": "auto"}),
    ],
)
def test_the_columns_are_those_of_the_estimator(files, tmp_path, options, parameters):
    result = done("change", *files, tmp_path / "out.laz", *options)
    written = read_points(tmp_path / "out.laz")
    before, after = (read_points(path).xyz for path in files)
    changes = CloudChange(random_state=0, **parameters).fit(before).compare(after)
    np.testing.assert_array_equal(written.xyz, before)
    np.testing.assert_array_equal(written.attributes["intensity"], np.arange(N))
    for name in ("distance", "distance_error", "level_of_detection", "pvalue"):
        expected = getattr(changes, name)
        np.testing.assert_allclose(written.attributes[name], expected, rtol=1e-4, atol=1e-7)
    np.testing.assert_array_equal(written.attributes["reason"], changes.reason)
    assert f"{changes.significant.sum():,} (" in result.stdout
    if changes.bodies is not None:
        assert "3 in both" in result.stdout


def test_copies_of_one_file_have_no_distance_and_no_noise_in_common(tmp_path):
    floor = np.random.default_rng(0).uniform(0, [9, 9, 0.01], (4_000, 3))
    write_points(tmp_path / "floor.laz", PointCloud(floor))
    result = done("change", *[tmp_path / "floor.laz"] * 2, tmp_path / "out.laz")
    assert "distance            0, median" in result.stdout
    assert "noise alike nearby  none" in result.stdout


def test_a_report_has_maps_distances_and_bodies(files, tmp_path):
    folder = tmp_path / "report"
    done("change", *files, tmp_path / "out.ply", "--registration", "auto", "--report", folder)
    page = (folder / "index.html").read_text(encoding="utf-8")
    for words in ("Distance, from above", "Flat surfaces of both scans", "significant"):
        assert words in page


@pytest.mark.parametrize("name", ["out.pts", "out.e57"])
def test_a_format_without_place_for_distances_is_refused(files, tmp_path, name):
    line = error_line(run("change", *files, tmp_path / name))
    assert "has no place for distances" in line


def test_the_second_scan_is_not_overwritten(files):
    assert "is AFTER" in error_line(run("change", *files, files[1]))
    assert len(read_points(files[1])) == N


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--registration", "good"], "good is not auto or a number above 0"),
        (["--registration", "3mm"], "needs --unit"),
        (["--alpha", 2], "--alpha"),
        (["--reach", -1], "is not a number above 0"),
        (["--correction", "holm"], "--correction"),
    ],
)
def test_wrong_options_are_named(files, tmp_path, options, words):
    assert words in usage_error(run("change", *files, tmp_path / "out.ply", *options))


def test_large_clouds_and_folders_are_compared_by_tiles(scans, tmp_path):
    (tmp_path / "in").mkdir()
    for i, part in enumerate(np.array_split(scans[0], 2)):
        write_points(tmp_path / "in" / f"{i}.las", part)
    write_points(tmp_path / "after.las", scans[1])
    report = ["--report", tmp_path / "report", "--registration", "auto"]
    result = done("change", tmp_path / "in", tmp_path / "after.las", tmp_path / "out", *report)
    assert "halos               complete for 100.00 % of the points" in result.stdout
    assert "3 in both" in result.stdout
    page = (tmp_path / "report" / "index.html").read_text(encoding="utf-8")
    assert "Distance, from above" in page
    assert "in 2 files, with distance" in page
    parts = [read_points(tmp_path / "out" / f"{i}.las").attributes["distance"] for i in range(2)]
    expected = CloudChange(random_state=0).fit(scans[0]).compare(scans[1]).distance
    np.testing.assert_allclose(np.concatenate(parts), expected, atol=1e-6)


def test_scans_of_other_coordinate_systems_are_refused(scans, tmp_path):
    paths = [tmp_path / name for name in ("before.las", "after.las")]
    for path, name in zip(paths, ("here", "there"), strict=True):
        write_points(path, scans[0])
        cloud = laspy.read(path)
        wkt = f'PROJCS["{name}",UNIT["metre",1]]'
        cloud.header.vlrs.append(laspy.vlrs.known.WktCoordinateSystemVlr(wkt))
        cloud.write(path)
    for options in ([], ["--memory", "1MB"]):
        line = error_line(run("change", *paths, tmp_path / "out.las", *options))
        assert "its coordinate system" in line
