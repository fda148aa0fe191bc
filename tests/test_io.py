"""Files in, files out: nothing lost, nothing half-written, one clear line when it fails."""

import os
import re
import sys
import warnings

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.testing import assert_allclose, assert_array_equal

from sklearn_mcmd.io import (
    PointCloud,
    PointFileError,
    _files,
    read_points,
    supported_extensions,
    write_points,
)

laspy = pytest.importorskip("laspy")
pytest.importorskip("lazrs")
plyfile = pytest.importorskip("plyfile")
pypcd4 = pytest.importorskip("pypcd4")
pye57 = pytest.importorskip("pye57")

FLOAT64_EXACT = [".ply", ".pcd", ".npy", ".npz", ".csv", ".xyz", ".txt"]
WKT = 'LOCAL_CS["a site grid",UNIT["metre",1]]'


@pytest.fixture
def cloud():
    """A small cloud in national coordinates with the results that callers write."""
    rng = np.random.default_rng(0)
    n = 40
    normals = rng.normal(size=(n, 3)).astype(np.float32)
    return PointCloud(
        rng.uniform(0, 50, (n, 3)) + np.array([362_000, 5_157_000, 100]),
        {
            "outlier": rng.random(n) < 0.2,
            "score": rng.random(n).astype(np.float32),
            "normal_x": normals[:, 0],
            "normal_y": normals[:, 1],
            "normal_z": normals[:, 2],
            "surface_variation": rng.random(n),
            "region": rng.integers(-1, 9, n),
        },
    )


def write_las_with_everything(path, version="1.4", point_format=7):
    """A LAS file with a coordinate system, another record, and extra dimensions."""
    rng = np.random.default_rng(1)
    n = 60
    header = laspy.LasHeader(version=version, point_format=point_format)
    header.scales, header.offsets = [0.001, 0.002, 0.0005], [362_327.0, 5_157_620.0, 106.271]
    header.add_extra_dims(
        [
            laspy.ExtraBytesParams("reflectance", np.float32),
            laspy.ExtraBytesParams(
                "range", np.uint16, scales=np.array([0.01]), offsets=np.array([5.0])
            ),
            laspy.ExtraBytesParams("beam", "3f8"),
        ]
    )
    wkt = laspy.vlrs.known.WktCoordinateSystemVlr(WKT)
    header.vlrs += [wkt, laspy.VLR("someone", 77, "a note", b"\x01\x02\x03")]
    header.global_encoding.wkt = True
    header.system_identifier = "a scanner"
    las = laspy.LasData(header)
    for axis in "XYZ":
        las[axis] = rng.integers(-(2**31), 2**31 - 1, n, dtype=np.int64).astype(np.int32)
    las.intensity = rng.integers(0, 65536, n)
    las.classification = rng.integers(0, 19, n)
    las.return_number = rng.integers(1, 5, n)
    las.number_of_returns = np.full(n, 5)
    las.gps_time = rng.random(n) * 1e9
    las.red = rng.integers(0, 65536, n)
    las.withheld = rng.integers(0, 2, n)
    las.reflectance = rng.normal(size=n)
    las["range"] = 5 + rng.integers(0, 60_000, n) * 0.01
    las.beam = rng.normal(size=(n, 3))
    las.write(path)
    return path


# ---- round trips -----------------------------------------------------------------------


@pytest.mark.parametrize("extension", FLOAT64_EXACT)
@settings(
    max_examples=25,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
    derandomize=True,
)
@given(
    xyz=hnp.arrays(
        np.float64,
        st.tuples(st.integers(1, 6), st.just(3)),
        elements=st.floats(allow_nan=False, allow_infinity=False),
    )
)
def test_every_float64_survives_formats_that_can_hold_it(tmp_path, extension, xyz):
    write_points(tmp_path / f"a{extension}", xyz)
    assert_array_equal(read_points(tmp_path / f"a{extension}").xyz, xyz)


@pytest.mark.parametrize(("extension", "encoding"), [(".ply", "ascii"), (".ply", "binary")])
@pytest.mark.parametrize("dtype", [np.uint8, np.int16, np.uint32, np.float32, np.float64])
def test_ply_keeps_numbers_and_dtypes_in_both_encodings(tmp_path, extension, encoding, dtype):
    check_encoding(tmp_path / f"a{extension}", encoding, dtype)


@pytest.mark.parametrize("encoding", ["ascii", "binary", "binary_compressed"])
@pytest.mark.parametrize("dtype", [np.uint8, np.int16, np.int64, np.float32, np.float64])
def test_pcd_keeps_numbers_and_dtypes_in_all_encodings(tmp_path, encoding, dtype):
    check_encoding(tmp_path / "a.pcd", encoding, dtype)
    assert f"DATA {encoding}\n".encode() in (tmp_path / "a.pcd").read_bytes()


def check_encoding(path, encoding, dtype):
    # Repeated, because what does not shrink is stored uncompressed.
    values = np.tile(np.linspace(0, 100, 30) / 3, 10).astype(dtype)
    source = PointCloud(np.column_stack([values] * 3) / 7).with_attributes(quality=values)
    write_points(path, source, encoding=encoding)
    back = read_points(path)
    assert back.attributes["quality"].dtype == dtype
    assert_array_equal(back.attributes["quality"], values)
    assert_array_equal(back.xyz, source.xyz)


@pytest.mark.parametrize("extension", [*FLOAT64_EXACT, ".las", ".laz"])
def test_results_come_back_under_their_names_with_the_same_values(tmp_path, cloud, extension):
    write_points(tmp_path / f"a{extension}", cloud)
    back = read_points(tmp_path / f"a{extension}")
    for name, values in cloud.attributes.items():
        assert_array_equal(back.attributes[name].astype(values.dtype), values, err_msg=name)


@pytest.mark.parametrize("extension", [".npy", ".npz"])
def test_numpy_files_keep_dtypes_and_tables(tmp_path, cloud, extension):
    cloud = cloud.with_attributes(eigenvalues=np.arange(120.0).reshape(40, 3))
    write_points(tmp_path / f"a{extension}", cloud)
    back = read_points(tmp_path / f"a{extension}")
    assert {n: a.dtype for n, a in back.attributes.items()} == {
        n: a.dtype for n, a in cloud.attributes.items()
    }
    assert_array_equal(back.attributes["eigenvalues"], cloud.attributes["eigenvalues"])


@pytest.mark.parametrize("extension", [".las", ".ply", ".pcd", ".csv"])
def test_tables_become_numbered_columns_and_normals_get_their_axes(tmp_path, extension):
    table = np.arange(12.0).reshape(4, 3)
    cloud = PointCloud(table).with_attributes(normals=table, eigenvalues=-table[:, :2])
    write_points(tmp_path / f"a{extension}", cloud)
    back = read_points(tmp_path / f"a{extension}").attributes
    assert_array_equal(back["normal_z"], table[:, 2])
    assert_array_equal(back["eigenvalues_1"], -table[:, 1])


def test_two_attributes_for_one_column_are_refused(tmp_path):
    cloud = PointCloud(np.eye(3)).with_attributes(normals=np.eye(3), normal_x=np.ones(3))
    with pytest.raises(PointFileError, match="two attributes would both be written as 'normal_x'"):
        write_points(tmp_path / "a.las", cloud)


@pytest.mark.parametrize("extension", supported_extensions())
def test_extensions_are_known_in_any_case(tmp_path, cloud, extension):
    path = tmp_path / f"A{extension.upper()}"
    write_points(path, cloud.xyz)
    assert len(read_points(path)) == len(cloud)
    assert os.listdir(tmp_path) == [path.name]


@pytest.mark.parametrize("extension", supported_extensions())
def test_input_and_output_may_be_the_same_file(tmp_path, cloud, extension):
    path = tmp_path / f"a{extension}"
    write_points(path, cloud.xyz)
    first = read_points(path)
    write_points(path, first)
    assert_array_equal(read_points(path).xyz, first.xyz)


# ---- LAS -------------------------------------------------------------------------------


@pytest.mark.parametrize("target", ["b.laz", "b.las"])
@pytest.mark.parametrize(("version", "point_format"), [("1.2", 3), ("1.4", 7)])
def test_las_to_las_keeps_every_record_bit_for_bit(tmp_path, version, point_format, target):
    source = write_las_with_everything(tmp_path / "a.las", version, point_format)
    write_points(tmp_path / target, read_points(source))
    before, after = laspy.read(source), laspy.read(tmp_path / target)
    assert after.header.are_points_compressed == target.endswith("z")
    assert after.points.array.dtype == before.points.array.dtype
    assert after.points.array.tobytes() == before.points.array.tobytes()


def test_las_to_laz_keeps_coordinate_system_and_header(tmp_path):
    source = write_las_with_everything(tmp_path / "a.las")
    write_points(tmp_path / "b.laz", read_points(source))
    before, after = laspy.read(source).header, laspy.read(tmp_path / "b.laz").header
    assert after.vlrs.get("WktCoordinateSystemVlr")[0].string == WKT
    assert after.global_encoding.wkt
    assert [v.record_data for v in after.vlrs if v.user_id == "someone"] == [b"\x01\x02\x03"]
    assert after.system_identifier == "a scanner"
    assert after.version == before.version
    assert after.point_format == before.point_format
    assert_array_equal(after.scales, before.scales)
    assert_array_equal(after.offsets, before.offsets)


def test_las_coordinates_are_laspys_own(tmp_path):
    source = write_las_with_everything(tmp_path / "a.las")
    assert_array_equal(read_points(source).xyz, laspy.read(source).xyz)


def test_a_subset_of_las_keeps_the_integers_of_the_chosen_points(tmp_path):
    source = write_las_with_everything(tmp_path / "a.las")
    mask = np.arange(60) % 3 == 0
    write_points(tmp_path / "b.laz", read_points(source).subset(mask))
    before, after = laspy.read(source), laspy.read(tmp_path / "b.laz")
    assert after.points.array.tobytes() == before.points.array[mask].tobytes()
    assert after.header.point_count == 20
    assert_allclose(after.header.maxs, after.xyz.max(axis=0), rtol=1e-15)


@pytest.mark.parametrize(("version", "point_format"), [("1.2", 3), ("1.4", 7)])
def test_noise_is_class_7_and_nothing_else_changes(tmp_path, version, point_format):
    source = write_las_with_everything(tmp_path / "a.las", version, point_format)
    noise = np.arange(60) % 4 == 0
    write_points(tmp_path / "b.laz", read_points(source), noise=noise)
    before, after = laspy.read(source), laspy.read(tmp_path / "b.laz")
    assert (np.asarray(after.classification)[noise] == 7).all()
    after.classification = before.classification
    assert after.points.array.tobytes() == before.points.array.tobytes()


@pytest.mark.parametrize("extension", [".ply", ".pcd", ".csv", ".xyz", ".npy", ".npz"])
def test_noise_is_a_column_outlier_in_other_formats(tmp_path, cloud, extension):
    noise = np.arange(40) % 4 == 0
    write_points(tmp_path / f"a{extension}", PointCloud(cloud.xyz), noise=noise)
    assert_array_equal(read_points(tmp_path / f"a{extension}").attributes["outlier"], noise)


def test_results_can_be_written_again_over_results(tmp_path):
    path = write_las_with_everything(tmp_path / "a.las")
    for result in (np.arange(60) % 2 == 0, np.arange(60) / 60, np.arange(60) + 2**53):
        write_points(path, read_points(path).with_attributes(outlier=result))
    las = laspy.read(path)
    assert list(las.point_format.extra_dimension_names).count("outlier") == 1
    assert las["outlier"].dtype == np.int64
    assert_array_equal(las["outlier"], np.arange(60) + 2**53)
    assert "reflectance" in las.point_format.extra_dimension_names


def test_changed_attributes_of_las_are_written(tmp_path):
    source = write_las_with_everything(tmp_path / "a.las")
    cloud = read_points(source).with_attributes(classification=np.full(60, 2))
    cloud.attributes["intensity"][:] = 5
    write_points(tmp_path / "b.las", cloud)
    after = laspy.read(tmp_path / "b.las")
    assert (np.asarray(after.classification) == 2).all()
    assert (after.intensity == 5).all()


def test_values_too_rich_for_a_standard_dimension_are_kept_beside_it(tmp_path, cloud):
    intensity = np.linspace(0, 1, 40, dtype=np.float32)
    with pytest.warns(UserWarning, match="'intensity' does not fit"):
        write_points(tmp_path / "a.las", cloud.with_attributes(intensity=intensity))
    back = read_points(tmp_path / "a.las").attributes
    assert_array_equal(back["intensity_value"], intensity)
    assert (back["intensity"] == 0).all()


def test_eight_bit_colors_fill_the_sixteen_bits_of_las(tmp_path, cloud):
    red = np.arange(40, dtype=np.uint8)
    colors = {"red": red, "green": red, "blue": red}
    write_points(tmp_path / "a.las", cloud.with_attributes(**colors))
    las = laspy.read(tmp_path / "a.las")
    assert las.point_format.id == 7
    assert_array_equal(las.red, np.arange(40) * 256)


@pytest.mark.parametrize("shift", [0.0004, 3.0, -5e6])
def test_moved_points_are_rounded_to_at_most_half_a_step(tmp_path, shift):
    source = write_las_with_everything(tmp_path / "a.las")
    cloud = read_points(source)
    moved = cloud.xyz + np.array([shift, 0, 0])
    cloud = PointCloud(moved, cloud.attributes, cloud.metadata)
    write_points(tmp_path / "b.las", cloud)
    las = laspy.read(tmp_path / "b.las")
    # Half a step, and the float64 rounding of coordinates up to 1e7.
    assert np.abs(las.xyz[:, 0] - moved[:, 0]).max() <= las.header.scales[0] / 2 + 4e-9
    before = laspy.read(source)
    assert_array_equal(las.Y, before.Y)
    assert_array_equal(las.Z, before.Z)


def test_coordinates_beyond_the_integers_of_the_header_get_a_new_grid(tmp_path):
    source = write_las_with_everything(tmp_path / "a.las")
    cloud = read_points(source)
    far = PointCloud(cloud.xyz * [1000, 1, 1], cloud.attributes, cloud.metadata)
    write_points(tmp_path / "b.las", far)
    las = laspy.read(tmp_path / "b.las")
    extent = np.ptp(far.xyz[:, 0])
    assert las.header.scales[0] <= 1e-8 * extent
    assert np.abs(las.xyz[:, 0] - far.xyz[:, 0]).max() <= 0.5001 * las.header.scales[0]
    assert_array_equal(las.Y, laspy.read(source).Y)


@settings(
    max_examples=60,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
    derandomize=True,
)
@given(
    extent=st.floats(1e-6, 1e9),
    shift=st.floats(-1e7, 1e7),
    seed=st.integers(0, 5),
    n=st.integers(1, 9),
)
def test_a_new_las_file_is_precise_to_a_hundred_millionth_of_the_extent(
    tmp_path, extent, shift, seed, n
):
    xyz = np.random.default_rng(seed).random((n, 3)) * extent + shift
    write_points(tmp_path / "a.las", xyz)
    largest = np.ptp(xyz, axis=0).max()
    rounding = 4 * np.spacing(np.abs(xyz).max())
    assert np.abs(read_points(tmp_path / "a.las").xyz - xyz).max() <= 1e-8 * largest + rounding


def test_decimal_coordinates_become_decimal_las(tmp_path):
    xyz = np.array([[119849.123, 485249.5, -1.25], [119850.001, 485250.0, 3.0]])
    write_points(tmp_path / "a.las", xyz)
    assert_array_equal(laspy.read(tmp_path / "a.las").header.scales, 0.001)
    assert_allclose(read_points(tmp_path / "a.las").xyz, xyz, rtol=1e-15)


def test_copc_can_be_read_and_its_octree_is_not_claimed_for_the_copy(tmp_path):
    source = write_las_with_everything(tmp_path / "a.las")
    las = laspy.read(source)
    las.vlrs.insert(0, laspy.VLR("copc", 1, "", bytes(160)))
    las.write(tmp_path / "a.copc.laz")
    cloud = read_points(tmp_path / "a.copc.laz")
    assert len(cloud) == 60
    write_points(tmp_path / "b.laz", cloud)
    users = [v.user_id for v in laspy.read(tmp_path / "b.laz").vlrs]
    assert "copc" not in users
    assert "someone" in users
    with pytest.raises(PointFileError, match="COPC can be read but not written"):
        write_points(tmp_path / "b.copc.laz", cloud)


# ---- PLY, PCD, E57 ---------------------------------------------------------------------


def test_ply_keeps_comments_and_calls_normals_as_viewers_do(tmp_path, cloud):
    cloud.metadata["ply_comments"] = ["scanned in spring"]
    write_points(tmp_path / "a.ply", cloud)
    ply = plyfile.PlyData.read(tmp_path / "a.ply")
    assert ply.comments == ["scanned in spring"]
    assert {"nx", "ny", "nz"} <= set(ply["vertex"].data.dtype.names)
    assert read_points(tmp_path / "a.ply").metadata["ply_comments"] == ["scanned in spring"]


def test_ply_faces_are_dropped(tmp_path):
    text = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
    text += "property float z\nproperty uchar quality\nelement face 1\n"
    text += "property list uchar int vertex_indices\nend_header\n"
    (tmp_path / "a.ply").write_text(text + "0 0 0 1\n1 0 0 2\n0 1 0 3\n3 0 1 2\n")
    cloud = read_points(tmp_path / "a.ply")
    assert_array_equal(cloud.attributes["quality"], [1, 2, 3])
    assert_array_equal(cloud.xyz, [[0, 0, 0], [1, 0, 0], [0, 1, 0]])


@pytest.mark.parametrize("extension", [".ply", ".pcd"])
def test_float32_coordinates_stay_float32_in_files_for_viewers(tmp_path, extension):
    xyz = np.random.default_rng(0).random((5, 3)).astype(np.float32)
    write_points(tmp_path / f"a{extension}", xyz)
    head = (tmp_path / f"a{extension}").read_bytes()[:200]
    assert b"property float x" in head or b"SIZE 4 4 4" in head
    assert_array_equal(read_points(tmp_path / f"a{extension}").xyz, xyz)


def test_pcd_rows_without_coordinates_are_dropped_and_counted(tmp_path):
    text = "VERSION .7\nFIELDS x y z label\nSIZE 4 4 4 4\nTYPE F F F U\nCOUNT 1 1 1 1\nWIDTH 2\n"
    text += "HEIGHT 2\nVIEWPOINT 1 2 3 1 0 0 0\nPOINTS 4\nDATA ascii\n"
    (tmp_path / "a.pcd").write_text(text + "0 0  0 1\nnan nan nan 2\n1 1 1 3\n1 inf 1 4\n")
    cloud = read_points(tmp_path / "a.pcd")
    assert cloud.n_dropped == 2
    assert_array_equal(cloud.attributes["label"], [1, 3])
    write_points(tmp_path / "b.pcd", cloud)
    assert pypcd4.PointCloud.from_path(tmp_path / "b.pcd").metadata.viewpoint[:3] == (1, 2, 3)


def test_packed_colors_of_pcd_become_red_green_blue_and_are_packed_again(tmp_path):
    rgb = pypcd4.PointCloud.encode_rgb(np.array([[255, 2, 3], [4, 50, 6]], dtype=np.uint8))
    arrays = [np.zeros(2, np.float32)] * 3 + [rgb]
    pypcd4.PointCloud.from_points(arrays, ("x", "y", "z", "rgb"), [np.float32] * 4).save(
        tmp_path / "a.pcd"
    )
    cloud = read_points(tmp_path / "a.pcd")
    assert_array_equal(cloud.attributes["red"], [255, 4])
    assert_array_equal(cloud.attributes["blue"], [3, 6])
    for encoding in ("binary", "ascii"):
        write_points(tmp_path / "b.pcd", cloud, encoding=encoding)
        back = read_points(tmp_path / "b.pcd")
        assert list(back.attributes) == ["red", "green", "blue"]
        assert_array_equal(back.attributes["green"], [2, 50])


def test_e57_scans_are_merged_with_their_poses(tmp_path):
    zeros, ones = np.zeros(2), np.ones(2)
    points = {"cartesianX": ones, "cartesianY": zeros, "cartesianZ": np.array([0.0, 3.0])}
    with pye57.E57(str(tmp_path / "a.e57"), mode="w") as file:
        file.write_scan_raw(points, translation=np.array([10.0, 0, 0]))
        half = np.sqrt(0.5)  # a quarter turn about z takes the x axis to the y axis
        file.write_scan_raw(points, rotation=np.array([half, 0, 0, half]))
    cloud = read_points(tmp_path / "a.e57")
    assert_allclose(cloud.xyz, [[11, 0, 0], [11, 0, 3], [0, 1, 0], [0, 1, 3]], atol=1e-12)
    assert_array_equal(cloud.attributes["scan_index"], [0, 0, 1, 1])


def test_points_that_e57_marks_invalid_are_dropped_and_counted(tmp_path):
    points = {f"cartesian{axis}": np.array([0.0, 1, 2]) for axis in "XYZ"}
    points["cartesianInvalidState"] = np.array([0, 2, 0], dtype=np.int8)
    with pye57.E57(str(tmp_path / "a.e57"), mode="w") as file:
        file.write_scan_raw(points)
    cloud = read_points(tmp_path / "a.e57")
    assert_array_equal(cloud.xyz[:, 0], [0, 2])
    assert cloud.n_dropped == 1


def test_e57_keeps_intensity_and_colors_and_says_what_it_loses(tmp_path, cloud):
    value = np.arange(40)
    colors = {c: (value * 256).astype(np.uint16) for c in ("red", "green", "blue")}
    full = PointCloud(cloud.xyz, {"intensity": value, **colors, "score": value})
    with pytest.warns(UserWarning, match="not written: score"):
        write_points(tmp_path / "a.e57", full)
    back = read_points(tmp_path / "a.e57")
    assert sorted(back.attributes) == ["blue", "green", "intensity", "red"]
    assert_array_equal(back.attributes["red"], value)
    assert_array_equal(back.attributes["intensity"], value)
    # float32 about the center of a cloud of 50 m
    assert np.abs(back.xyz - cloud.xyz).max() <= 25 * 6e-8


def test_e57_refuses_to_lose_the_outlier_mark(tmp_path, cloud):
    with pytest.raises(PointFileError, match="no place to mark outliers"):
        write_points(tmp_path / "a.e57", cloud.xyz, noise=np.ones(40, dtype=bool))


# ---- text and NumPy --------------------------------------------------------------------

TEXTS = {
    "spaces": "1  2 3.5 4\n 5 6 7  8\n",
    "tabs with header": "X\tY\tZ\tlabel\n1\t2\t3.5\t4\n5\t6\t7\t8\n",
    "commas with header": "x,y,z,label\n1,2,3.5,4\n5,6,7,8",
    "semicolons": "1;2;3.5;4\r\n5;6;7;8\r\n",
    "byte order mark": "\ufeffx,y,z,label\n1,2,3.5,4\n5,6,7,8\n",
    "comment header": "//X Y Z label\n1 2 3.5 4\n5 6 7 8\n",
    "other order": "label;z;y;x\n4;3.5;2;1\n8;7;6;5\n",
    "comments and blanks": "# a survey\n\n1 2 3.5 4\n\n5 6 7 8 # last\n",
    "other names": '"easting", "northing", "height", "label"\n1, 2, 3.5, 4\n5, 6, 7, 8\n',
}


@pytest.mark.parametrize("kind", TEXTS)
@pytest.mark.parametrize("extension", [".xyz", ".txt", ".csv"])
def test_text_is_read_however_it_is_laid_out(tmp_path, extension, kind):
    (tmp_path / f"a{extension}").write_text(TEXTS[kind], encoding="utf-8")
    cloud = read_points(tmp_path / f"a{extension}")
    assert_array_equal(cloud.xyz, [[1, 2, 3.5], [5, 6, 7]])
    name = "label" if "label" in TEXTS[kind] else "column_4"
    assert_array_equal(cloud.attributes[name], [4, 8])
    assert cloud.attributes[name].dtype == np.int64


def test_whole_numbers_among_fractions_do_not_make_a_column_integer(tmp_path):
    (tmp_path / "a.xyz").write_text("0 0 0 1\n0 0 0 1.5\n")
    assert_array_equal(read_points(tmp_path / "a.xyz").attributes["column_4"], [1, 1.5])


@pytest.mark.parametrize("dtype", [np.float32, np.float64, np.int32])
def test_a_plain_array_gives_coordinates_and_numbered_columns(tmp_path, dtype):
    table = np.arange(10).reshape(2, 5).astype(dtype)
    np.save(tmp_path / "a.npy", table)
    cloud = read_points(tmp_path / "a.npy")
    assert cloud.xyz.dtype == np.float64
    assert_array_equal(cloud.xyz, table[:, :3])
    assert_array_equal(cloud.attributes["column_5"], table[:, 4])


def test_npz_arrays_of_another_length_are_kept_aside_and_not_applied(tmp_path):
    offset = np.array([1e6, 2e6, 0])
    np.savez(tmp_path / "a.npz", offset=offset, xyz=np.ones((5, 3)), label=np.arange(5))
    cloud = read_points(tmp_path / "a.npz")
    assert_array_equal(cloud.xyz, np.ones((5, 3)))
    assert list(cloud.attributes) == ["label"]
    write_points(tmp_path / "b.npz", cloud.subset(slice(2)))
    with np.load(tmp_path / "b.npz") as archive:
        assert_array_equal(archive["offset"], offset)


@pytest.mark.parametrize("arrays", [{"x": 0, "y": 1, "z": 2}, {"cloud": [0, 1, 2]}])
def test_npz_coordinates_may_have_other_names(tmp_path, arrays):
    table = np.arange(6.0).reshape(2, 3)
    np.savez(tmp_path / "a.npz", **{name: table[:, column] for name, column in arrays.items()})
    assert_array_equal(read_points(tmp_path / "a.npz").xyz, table)


# ---- the cloud itself ------------------------------------------------------------------


def test_a_subset_takes_attributes_along(cloud):
    half = cloud.subset(cloud.attributes["outlier"])
    assert len(half) == cloud.attributes["outlier"].sum() > 0
    assert half.attributes["outlier"].all()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda c: c.subset(np.ones(3, dtype=bool)), "mask has shape"),
        (lambda c: c.with_attributes(score=np.ones(3)), "one entry for each of the 40 points"),
        (lambda c: c.with_attributes(x=np.ones(40)), "taken by the coordinates"),
        (lambda c: PointCloud(np.ones((4, 2))), r"shape \(4, 2\)"),
        (lambda c: PointCloud([["a", "b", "c"]]), "must be numbers"),
    ],
)
def test_clouds_that_make_no_sense_are_refused(cloud, call, message):
    with pytest.raises(ValueError, match=message):
        call(cloud)


# ---- bad input -------------------------------------------------------------------------

BAD_TEXTS = {
    "words.xyz": ("hello\nworld\n", "line 2: 'world' is not a number"),
    "two.csv": ("1,2\n3,4\n", "line 1 has 2 column"),
    "names.csv": ("x,y,z,name\n1,2,3,wall\n", "'wall' is not a number"),
    "ragged.xyz": ("1 2 3\n\n4 5\n", "line 3 has 2 columns, line 1 has 3"),
    "late.xyz": ("1 2 3\n4 b 6\n", "line 2: 'b' is not a number"),
    "comma.csv": ("1,5;2,5;3,5\n", "decimal commas"),
    "twice.csv": ("x,y,z,a,a\n1,2,3,4,5\n", "two columns are named 'a'"),
    "flat.csv": ("x,y,h\n1,2,3\n", "no coordinate named z"),
    "short.csv": ("x,y,z,a\n1,2,3\n", "names 4 columns, line 2 has 3"),
    "header.csv": ("x,y,z\n", "no points"),
    "nan.xyz": ("nan 1 2\n", r"no points with finite coordinates \(1 dropped\)"),
    "text.ply": ("hello\n", "damaged or is of another format"),
    "text.pcd": ("hello\n", "not a PCD file"),
    "text.laz": ("hello\n", "not a LAS/LAZ file"),
    "text.npy": ("hello\n", "NumPy's format NPY"),
    "text.npz": ("hello\n", "NumPy's format NPZ"),
    "text.e57": ("hello\n", "damaged or is of another format"),
    "empty.ply": ("ply\nformat ascii 1.0\nelement face 0\nend_header\n", "no element 'vertex'"),
    "a.foo": ("1 2 3\n", "unknown extension '.foo'; known are .csv .e57 .las"),
    "nothing": ("1 2 3\n", "no extension; known are"),
}


def assert_one_clear_line(error, path):
    message = str(error.value)
    assert message.startswith(f"{path}: ")
    assert "\n" not in message
    assert "allow_pickle=" not in message


@pytest.mark.parametrize("name", BAD_TEXTS)
def test_files_that_are_wrong_get_one_clear_line(tmp_path, name):
    text, message = BAD_TEXTS[name]
    (tmp_path / name).write_text(text)
    with pytest.raises(PointFileError, match=message) as error:
        read_points(tmp_path / name)
    assert_one_clear_line(error, tmp_path / name)


@pytest.mark.parametrize("extension", supported_extensions())
@pytest.mark.parametrize("content", [b"", np.random.default_rng(0).bytes(4000), b"\0" * 4000])
def test_junk_and_empty_files_get_one_clear_line(tmp_path, extension, content):
    path = tmp_path / f"a{extension}"
    path.write_bytes(content)
    with pytest.raises(PointFileError, match=None if content else "is empty") as error:
        read_points(path)
    assert_one_clear_line(error, path)


@pytest.mark.parametrize("part", [0.2, 0.6, 0.95])
@pytest.mark.parametrize("extension", [".las", ".laz", ".ply", ".pcd", ".e57", ".npy", ".npz"])
def test_truncated_files_get_one_clear_line(tmp_path, extension, part):
    path = tmp_path / f"a{extension}"
    write_points(path, np.random.default_rng(0).random((200, 3)))
    whole = path.read_bytes()
    path.write_bytes(whole[: int(part * len(whole))])
    with pytest.raises(PointFileError) as error:
        read_points(path)
    assert_one_clear_line(error, path)


@pytest.mark.parametrize("encoding", ["ascii", "binary", "binary_compressed"])
def test_truncated_pcd_is_recognized_in_every_encoding(tmp_path, encoding):
    path = tmp_path / "a.pcd"
    write_points(path, np.tile(np.eye(3), (50, 1)), encoding=encoding)
    path.write_bytes(path.read_bytes()[:-12])
    with pytest.raises(PointFileError, match=r"truncated or damaged|promises 150 points"):
        read_points(path)


def test_a_header_with_an_absurd_count_is_refused_at_once(tmp_path):
    path = write_las_with_everything(tmp_path / "a.las")
    content = bytearray(path.read_bytes())
    content[100:104] = b"\xff\xff\xff\xff"
    path.write_bytes(content)
    with pytest.raises(PointFileError, match="more metadata records than the file has room for"):
        read_points(path)


@pytest.mark.parametrize("extension", [".las", ".laz", ".ply", ".pcd", ".e57", ".npy", ".npz"])
def test_damaged_headers_never_raise_anything_but_the_one_error(tmp_path, extension):
    path = tmp_path / f"a{extension}"
    write_points(path, np.random.default_rng(0).random((50, 3)))
    whole = path.read_bytes()
    rng = np.random.default_rng(1)
    refused = 0
    for _ in range(30):
        content = bytearray(whole)
        for position in rng.integers(0, min(len(whole), 400), 4):
            content[position] = rng.integers(256)
        path.write_bytes(content)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                read_points(path)
        except PointFileError:
            refused += 1
    assert refused > 0


def test_missing_files_and_folders_are_named(tmp_path):
    with pytest.raises(PointFileError, match=r"a\.las: no such file"):
        read_points(tmp_path / "a.las")
    with pytest.raises(PointFileError, match="is a folder"):
        read_points(tmp_path)


@pytest.mark.parametrize(
    ("extension", "module", "extra"),
    [
        (".las", "laspy", "las"),
        (".laz", "lazrs", "las"),
        (".ply", "plyfile", "formats"),
        (".pcd", "pypcd4", "formats"),
        (".e57", "pye57", "formats"),
    ],
)
def test_a_missing_library_is_named_with_its_extra(tmp_path, monkeypatch, extension, module, extra):
    path = tmp_path / f"a{extension}"
    write_points(path, np.eye(3))
    before = path.read_bytes()
    monkeypatch.setitem(sys.modules, module, None)
    if module == "lazrs":
        monkeypatch.setitem(sys.modules, "laszip", None)
    message = re.escape(f'{module}, which is not installed: pip install "sklearn-mcmd[{extra}]"')
    with pytest.raises(PointFileError, match=message):
        read_points(path)
    with pytest.raises(PointFileError, match=message):
        write_points(path, np.eye(3))
    assert path.read_bytes() == before


# ---- bad output ------------------------------------------------------------------------


def names_that_do_not_fit():
    ones = np.ones(3)
    return [
        (".las", {"a" * 33: ones}, "longer than the 32 bytes"),
        (".ply", {"a b": ones}, "'a b'"),
        (".pcd", {"a b": ones}, "'a b' cannot be stored in PCD"),
        (".npz", {"file": ones}, "'file' is reserved"),
        (".las", {"a": np.array(list("abc"))}, "'a' of dtype <U1 cannot be stored in LAS"),
        (".ply", {"a": np.full(3, 2**60 + 1)}, "'a' of dtype int64 cannot be stored in PLY"),
        (".pcd", {"a": ones * 1j}, "'a' of dtype complex128 cannot be stored in PCD"),
        (".csv", {"a": ones * 1j}, "'a' of dtype complex128 cannot be stored"),
    ]


@pytest.mark.parametrize(("extension", "attributes", "message"), names_that_do_not_fit())
def test_attributes_that_a_format_cannot_hold_are_named(tmp_path, extension, attributes, message):
    path = tmp_path / f"a{extension}"
    with pytest.raises(PointFileError, match=message) as error:
        write_points(path, PointCloud(np.eye(3), attributes))
    assert_one_clear_line(error, path)
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize(
    ("name", "cloud", "options", "message"),
    [
        ("no/a.ply", np.eye(3), {}, r"the folder .*no does not exist"),
        ("folder.ply", np.eye(3), {}, "is a folder"),
        ("a.foo", np.eye(3), {}, "unknown extension"),
        ("a.ply", np.empty((0, 3)), {}, "no points"),
        ("a.ply", np.full((2, 3), np.nan), {}, "NaN or infinity"),
        ("a.ply", np.eye(3), {"encoding": "binary_compressed"}, "known: ascii, binary"),
        ("a.las", np.eye(3), {"encoding": "ascii"}, "unknown for .las; known: only None"),
        ("a.ply", np.eye(3), {"noise": [0, 1, 0]}, "boolean mask"),
        ("a.ply", np.eye(3), {"noise": [True]}, r"shape \(3,\)"),
    ],
)
def test_output_that_makes_no_sense_is_refused(tmp_path, name, cloud, options, message):
    (tmp_path / "folder.ply").mkdir()
    with pytest.raises(ValueError, match=message):
        write_points(tmp_path / name, cloud, **options)
    assert os.listdir(tmp_path) == ["folder.ply"]


@pytest.mark.skipif(
    not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write everywhere"
)
def test_a_folder_without_permission_is_named(tmp_path):
    tmp_path.chmod(0o500)
    with pytest.raises(PointFileError, match="check the permissions"):
        write_points(tmp_path / "a.ply", np.eye(3))
    tmp_path.chmod(0o700)


def test_permission_errors_of_the_system_become_one_clear_line(tmp_path, monkeypatch):
    def touch(self, **kwargs):
        raise PermissionError(13, "Permission denied", str(self))

    monkeypatch.setattr("pathlib.Path.touch", touch)
    with pytest.raises(PointFileError, match="permission denied; check the permissions of"):
        write_points(tmp_path / "a.ply", np.eye(3))


def fail_midway(error):
    def writer(path, cloud):
        path.write_text("half of it")
        raise error

    return writer


@pytest.mark.parametrize("error", [RuntimeError("boom"), OSError(28, "No space left on device")])
def test_a_failure_midway_leaves_the_old_file_and_nothing_else(tmp_path, monkeypatch, error):
    path = tmp_path / "a.xyz"
    path.write_text("1 2 3\n")
    monkeypatch.setitem(_files._FORMATS, ".xyz", (None, fail_midway(error)))
    with pytest.raises(PointFileError, match=r"cannot be written: (boom|no space left)"):
        write_points(path, np.eye(3))
    assert path.read_text() == "1 2 3\n"
    assert os.listdir(tmp_path) == ["a.xyz"]


def test_an_interruption_midway_leaves_the_old_file_and_nothing_else(tmp_path, monkeypatch):
    path = tmp_path / "a.xyz"
    path.write_text("1 2 3\n")
    monkeypatch.setitem(_files._FORMATS, ".xyz", (None, fail_midway(KeyboardInterrupt())))
    with pytest.raises(KeyboardInterrupt):
        write_points(path, np.eye(3))
    assert path.read_text() == "1 2 3\n"
    assert os.listdir(tmp_path) == ["a.xyz"]


def test_a_failed_first_writing_leaves_no_file(tmp_path, monkeypatch):
    monkeypatch.setitem(_files._FORMATS, ".xyz", (None, fail_midway(RuntimeError("boom"))))
    with pytest.raises(PointFileError):
        write_points(tmp_path / "a.xyz", np.eye(3))
    assert os.listdir(tmp_path) == []


@pytest.mark.skipif(os.name != "posix", reason="permission bits and links of POSIX")
def test_a_replaced_file_keeps_its_permissions_and_a_link_its_target(tmp_path):
    path = tmp_path / "a.xyz"
    path.write_text("1 2 3\n")
    path.chmod(0o640)
    (tmp_path / "link.xyz").symlink_to(path)
    write_points(tmp_path / "link.xyz", np.eye(3))
    assert (tmp_path / "link.xyz").is_symlink()
    assert path.stat().st_mode & 0o777 == 0o640
    assert len(read_points(path)) == 3


# ---- real clouds -----------------------------------------------------------------------

FOLDERS = [
    "ahn3_amsterdam_2397",
    "autzen_trim",
    "cad_angle_block",
    "cad_cube_pointfilter",
    "cad_featuretype",
    "fast_gicp_velodyne",
    "jakarto_scanlines",
    "jakarto_street_thinned",
    "laspy_plane_patch",
    "open3d_redwood_fragment",
    "pcl_building_region_growing",
    "pcl_cars_mincut",
    "pcl_lamppost",
]


@pytest.mark.parametrize("folder", FOLDERS)
def test_real_files_hold_as_many_points_as_their_notes_say(shared_data, folder):
    notes = (shared_data / folder / "INFO.md").read_text(encoding="utf-8")
    n_points = int(re.search(r"- points: (\d+)", notes)[1])
    files = [
        p for p in (shared_data / folder).iterdir() if p.suffix.lower() in supported_extensions()
    ]
    assert files
    assert {p.name: len(read_points(p)) for p in files} == {p.name: n_points for p in files}


@pytest.mark.parametrize(
    "name", ["autzen_trim/autzen_trim.laz", "jakarto_scanlines/test_0.02_seconde.las"]
)
def test_real_las_survives_with_results_added(shared_data, tmp_path, name):
    cloud = read_points(shared_data / name)
    score = np.linspace(0, 1, len(cloud), dtype=np.float32)
    write_points(tmp_path / "a.laz", cloud.with_attributes(score=score))
    before, after = laspy.read(shared_data / name), laspy.read(tmp_path / "a.laz")
    for field in before.points.array.dtype.names:
        assert_array_equal(after.points.array[field], before.points.array[field])
    assert_array_equal(after["score"], score)
    kept = [(v.user_id, v.record_id, v.record_data_bytes()) for v in before.vlrs]
    now = [(v.user_id, v.record_id, v.record_data_bytes()) for v in after.vlrs]
    assert [v for v in now if v in kept] == kept
