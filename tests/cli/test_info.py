"""mcmd info: what a file holds, counted."""

import re

import numpy as np
import pytest

from commands import done, error_line, run
from sklearn_mcmd.io import PointCloud, write_points

GRID = np.stack(np.meshgrid(range(4), range(5), [7.0]), axis=-1).reshape(-1, 3)


def rows_of(path):
    result = done("info", path)
    lines = (line.strip().removeprefix("- ") for line in result.stdout.splitlines()[1:])
    return dict(line.split(maxsplit=1) for line in lines)


def test_info_counts_points_and_duplicates_and_shows_bounds(tmp_path):
    write_points(tmp_path / "grid.csv", PointCloud(np.vstack([GRID, GRID[:2]])))
    rows = rows_of(tmp_path / "grid.csv")
    assert rows["format"] == "CSV"
    assert rows["points"] == "22"
    assert rows["duplicates"] == "2 (9.09 %)"
    assert rows["spacing"].startswith("1 ")
    assert rows["y"].startswith("0.00000 to 4.00000 ")


def test_info_shows_ranges_of_attributes_and_gathers_the_constant(room, tmp_path):
    values = {"ones": np.ones(len(room)), "half": np.where(room.xyz[:, 0] > 1, np.nan, 1.5)}
    write_points(tmp_path / "room.npz", room.with_attributes(**values))
    rows = rows_of(tmp_path / "room.npz")
    assert rows["intensity"] == "uint16, 0 to 929"
    assert rows["half"] == "float64, 1.5 to 1.5, some without a value"
    assert "ones 1" in rows["constant"]


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("432100.25 5157000.1 -0.125\n", "432100.25"),
        ("432100.25 5157000.1 -0.125\n" * 3, "432100.25"),
        ("-1.7e308 0 0\n1.7e308 1 1\n", "(extent inf)"),
        ("5157000.1 0 0\n5157000.1000001 0 0\n", "5157000.100000000 to 5157000.100000100 "),
    ],
)
def test_info_shows_as_many_digits_as_coordinates_have(text, shown, tmp_path):
    (tmp_path / "a.xyz").write_text(text)
    assert shown in rows_of(tmp_path / "a.xyz")["x"]


def test_info_names_the_coordinate_system_of_a_las_file(room, tmp_path):
    laspy = pytest.importorskip("laspy")
    las = laspy.create(point_format=6, file_version="1.4")
    las.x, las.y, las.z = room.xyz.T
    text = 'PROJCS["Amersfoort / RD New",GEOGCS["x"]]'
    las.header.vlrs.append(laspy.vlrs.known.WktCoordinateSystemVlr(text))
    las.write(tmp_path / "crs.las")
    assert rows_of(tmp_path / "crs.las")["CRS"].startswith("Amersfoort / RD New")


def test_info_names_the_position_of_the_sensor_where_a_format_can_tell_it(room, tmp_path):
    pytest.importorskip("pypcd4")
    room.metadata["pcd_viewpoint"] = (1.2, 3.4, 5.6, 1.0, 0.0, 0.0, 0.0)
    write_points(tmp_path / "room.pcd", room)
    assert rows_of(tmp_path / "room.pcd")["sensor"] == "stated: 1.2, 3.4, 5.6 (PCD's VIEWPOINT)"
    del room.metadata["pcd_viewpoint"]
    write_points(tmp_path / "room.pcd", room)
    assert "not known: PCD's VIEWPOINT is 0 0 0" in rows_of(tmp_path / "room.pcd")["sensor"]
    write_points(tmp_path / "room.csv", room)
    assert "sensor" not in rows_of(tmp_path / "room.csv")


@pytest.mark.parametrize("verb", ["info", "plane"])
def test_huge_coordinates_are_shown_with_six_digits(verb, tmp_path):
    xyz = 1e60 * np.random.default_rng(0).uniform(size=(50, 3)) * [1, 1, 0.001]
    np.savetxt(tmp_path / "huge.xyz", xyz)
    shown = done(verb, tmp_path / "huge.xyz").stdout
    assert re.findall(r"\d{16,}", shown) == []
    assert re.search(r"\de\+5\d", shown)


def test_info_of_a_folder_has_a_line_for_each_file_and_one_for_all(tmp_path):
    folder = tmp_path / "scans"
    folder.mkdir()
    assert "without point files" in error_line(run("info", folder))
    write_points(folder / "a.npy", GRID)
    write_points(folder / "b.csv", GRID + np.array([10, 0, 0]))
    (folder / "notes.md").write_text("no points")
    rows = rows_of(folder)
    assert rows["a.npy"] == rows["b.csv"] == "20 points, 3 x 4 x 0, spacing 1"
    assert rows["all"].startswith("40 points of 2 files, x 0.0000 to 13.0000 (extent 13.0000), y")
    (folder / "b.csv").write_text("1,2,NA")
    result = run("info", folder)
    assert result.exit_code == 1
    assert "  b.csv  cannot be read" in result.stdout
    assert f"error: {folder / 'b.csv'}: line 1: 'NA' is not" in result.stderr
