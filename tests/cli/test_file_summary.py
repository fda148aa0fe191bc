"""mcmd info: what a file holds, counted."""

import numpy as np
import pytest

from commands import error_line, run
from sklearn_mcmd.io import PointCloud, write_points


def test_info_counts_points_and_duplicates_and_shows_bounds(tmp_path):
    grid = np.stack(np.meshgrid(range(4), range(5), [7.0]), axis=-1).reshape(-1, 3)
    write_points(tmp_path / "grid.csv", PointCloud(np.vstack([grid, grid[:2]])))
    result = run("info", tmp_path / "grid.csv")
    assert result.exit_code == 0
    rows = dict(line.split(maxsplit=1) for line in result.stdout.splitlines()[1:])
    assert rows["format"] == "CSV"
    assert rows["points"] == "22"
    assert rows["duplicates"] == "2 (9.09 %)"
    assert rows["spacing"].startswith("1 ")
    assert rows["y"].startswith("0.00000 to 4.00000 ")


def test_info_shows_ranges_of_attributes_and_gathers_the_constant(room, tmp_path):
    values = {"ones": np.ones(len(room)), "half": np.where(room.xyz[:, 0] > 1, np.nan, 1.5)}
    write_points(tmp_path / "room.npz", room.with_attributes(**values))
    out = run("info", tmp_path / "room.npz").stdout
    assert "uint16, 0 to 929" in out
    assert "float64, 1.5 to 1.5, some without a value" in out
    assert "ones 1" in out.split("constant")[1]


def test_info_names_the_coordinate_system_of_a_las_file(room, tmp_path):
    laspy = pytest.importorskip("laspy")
    from laspy.vlrs.known import WktCoordinateSystemVlr

    las = laspy.create(point_format=6, file_version="1.4")
    las.x, las.y, las.z = room.xyz.T
    las.header.vlrs.append(WktCoordinateSystemVlr('PROJCS["Amersfoort / RD New",GEOGCS["x"]]'))
    las.write(tmp_path / "crs.las")
    assert "Amersfoort / RD New\n" in run("info", tmp_path / "crs.las").stdout


def test_info_does_not_count_the_value_that_means_no_data(tmp_path):
    laspy = pytest.importorskip("laspy")
    header = laspy.LasHeader(version="1.4", point_format=6)
    none = {"no_data": np.array([-9999.0])}
    header.add_extra_dims([
        laspy.ExtraBytesParams("depth", "f4", **none),
        laspy.ExtraBytesParams("pair", "2f4", no_data=np.array([-1.0, -2.0])),
        laspy.ExtraBytesParams("empty", "i2", **none),
        laspy.ExtraBytesParams(
            "scaled", "i2", scales=np.array([0.01]), offsets=np.array([5.0]), **none
        ),
    ])  # fmt: skip
    las = laspy.LasData(header)
    las.xyz = np.random.default_rng(0).random((4, 3))
    las.depth, las.pair = [-9999, 1, 2, 3], [[-1, -2], [-2, -1], [3, 3], [4, 4]]
    las.points.array["empty"], las.points.array["scaled"] = -9999, [-9999, 100, 200, 300]
    las.write(tmp_path / "a.las")
    out = run("info", tmp_path / "a.las").stdout
    rows = dict(line[4:].split(maxsplit=1) for line in out.splitlines() if line[2:4] == "- ")
    assert rows["depth"] == "float32, 1 to 3, some without a value"
    assert rows["pair"] == "float32 x 2, -2 to 4, some without a value"
    assert rows["scaled"] == "float64, 6 to 8, some without a value"
    assert "empty nan" in out.split("constant")[1]


def test_info_works_on_a_single_point(tmp_path):
    (tmp_path / "one.xyz").write_text("1 2 3\n")
    result = run("info", tmp_path / "one.xyz")
    assert result.exit_code == 0, result.output
    assert "spacing" not in result.stdout


@pytest.mark.parametrize("n", [1, 3])
def test_info_shows_points_of_one_location_with_the_digits_of_the_file(n, tmp_path):
    (tmp_path / "one.xyz").write_text("432100.25 5157000.1 -0.125\n" * n)
    out = run("info", tmp_path / "one.xyz").stdout
    rows = dict(line.split(maxsplit=1) for line in out.splitlines()[1:])
    assert (rows["x"], rows["y"], rows["z"]) == ("432100.25", "5157000.1", "-0.125")


def test_info_works_on_an_extent_beyond_all_numbers(tmp_path):
    np.save(tmp_path / "far.npy", [[-1.7e308, 0, 0], [1.7e308, 1, 1]])
    result = run("info", tmp_path / "far.npy")
    assert result.exit_code == 0
    assert "(extent inf)" in result.stdout


def test_info_shows_no_more_digits_than_large_coordinates_have(tmp_path):
    (tmp_path / "two.xyz").write_text("5157000.1 0 0\n5157000.1000001 0 0\n")
    out = run("info", tmp_path / "two.xyz").stdout
    assert "5157000.100000000 to 5157000.100000100 " in out


@pytest.mark.parametrize(
    ("codes", "shown"),
    [
        ({3072: 32767}, "user-defined"),
        ({2048: 4326, 3072: 32767}, "user-defined"),
        ({2048: 4326, 3072: 25832}, "EPSG:25832"),
        ({2048: 4326}, "EPSG:4326"),
    ],
)
def test_info_shows_geotiff_codes_and_says_where_there_is_none(codes, shown, room, tmp_path):
    laspy = pytest.importorskip("laspy")
    from laspy.vlrs.known import GeoKeyDirectoryVlr, GeoKeyEntryStruct

    las = laspy.create(point_format=1, file_version="1.2")
    las.x, las.y, las.z = room.xyz.T
    directory = GeoKeyDirectoryVlr()
    directory.geo_keys = [
        GeoKeyEntryStruct(id=key, tiff_tag_location=0, count=1, value_offset=code)
        for key, code in codes.items()
    ]
    directory.geo_keys_header.number_of_keys = len(codes)
    las.header.vlrs.append(directory)
    las.write(tmp_path / "crs.las")
    rows = run("info", tmp_path / "crs.las").stdout.splitlines()
    assert next(row.split()[1] for row in rows if row.split()[0] == "CRS") == shown


def test_info_names_the_position_of_the_sensor_where_a_format_can_tell_it(room, tmp_path):
    pytest.importorskip("pypcd4")
    room.metadata["pcd_viewpoint"] = (1.2, 3.4, 5.6, 1.0, 0.0, 0.0, 0.0)
    write_points(tmp_path / "room.pcd", room)
    assert "stated: 1.2, 3.4, 5.6 (PCD's VIEWPOINT)" in run("info", tmp_path / "room.pcd").stdout
    del room.metadata["pcd_viewpoint"]
    write_points(tmp_path / "room.pcd", room)
    assert "not known: PCD's VIEWPOINT is 0 0 0" in run("info", tmp_path / "room.pcd").stdout
    write_points(tmp_path / "room.csv", room)
    assert "sensor" not in run("info", tmp_path / "room.csv").stdout


def test_info_bounds_the_places_of_the_sensor(tmp_path):
    pye57 = pytest.importorskip("pye57")
    points = {f"cartesian{axis}": np.arange(3.0) for axis in "XYZ"}
    with pye57.E57(str(tmp_path / "a.e57"), mode="w") as file:
        for x in (1.5, 7.0):
            file.write_scan_raw(points, translation=np.array([x, 0, 1]))
    told = run("info", tmp_path / "a.e57").stdout
    assert "stated: from 1.5, 0, 1 to 7, 0, 1 (poses of the scans)" in told


def test_info_of_a_folder_has_a_line_for_each_file_and_one_for_all(tmp_path):
    folder = tmp_path / "scans"
    folder.mkdir()
    assert "without point files" in error_line(run("info", folder))
    grid = np.stack(np.meshgrid(range(4), range(5), [7.0]), axis=-1).reshape(-1, 3)
    write_points(folder / "a.npy", grid)
    write_points(folder / "b.csv", grid + np.array([10, 0, 0]))
    (folder / "notes.md").write_text("no points")
    result = run("info", folder)
    assert result.exit_code == 0
    title, *rows, total = result.stdout.splitlines()
    assert title == str(folder)
    assert rows == [f"  {name}  20 points, 3 x 4 x 0, spacing 1" for name in ("a.npy", "b.csv")]
    assert total.startswith(
        "  all    40 points of 2 files, x 0.0000 to 13.0000 (extent 13.0000), y"
    )

    (folder / "b.csv").write_text("1,2,NA")
    result = run("info", folder)
    assert result.exit_code == 1
    assert "  b.csv  cannot be read" in result.stdout
    assert f"error: {folder / 'b.csv'}: line 1: 'NA' is not" in result.stderr
