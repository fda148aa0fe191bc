"""LAS and LAZ: every record kept, coordinates as precise as the header allows."""

import struct

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from las_files import las_of, laspy
from sklearn_mcmd.io import PointCloud, read_points, write_points

WKT = 'LOCAL_CS["a site grid",UNIT["metre",1]]'
RANGE = laspy.ExtraBytesParams("range", "u2", scales=np.array([0.01]), offsets=np.array([5.0]))


@pytest.fixture(params=[3, 7], ids=["1.2", "1.4"])
def source(request, tmp_path):
    """A file with a coordinate system, another record, extra dimensions, and a scaled one."""
    las = las_of(
        request.param,
        scales=[0.001, 0.002, 0.0005],
        offsets=[362_327.0, 5_157_620.0, 106.271],
        extra=[("reflectance", "f4"), RANGE, ("beam", "3f8")],
    )
    for axis in "XYZ":
        las[axis] = np.random.default_rng(1).integers(-(2**31), 2**31, 60).astype(np.int32)
    las["range"] = 5 + np.arange(60) * 0.01
    wkt = laspy.vlrs.known.WktCoordinateSystemVlr(WKT)
    las.header.vlrs += [wkt, laspy.VLR("someone", 77, "a note", b"\x01\x02\x03")]
    las.header.global_encoding.wkt = request.param == 7
    las.header.system_identifier = "a scanner"
    las.write(tmp_path / "a.las")
    return tmp_path / "a.las"


@pytest.mark.parametrize("target", ["b.laz", "b.las"])
def test_las_to_las_keeps_every_record_bit_for_bit(tmp_path, source, target):
    cloud = read_points(source)
    write_points(tmp_path / target, cloud)
    before, after = laspy.read(source), laspy.read(tmp_path / target)
    assert_array_equal(cloud.xyz, before.xyz)
    assert after.header.are_points_compressed == target.endswith("z")
    assert after.points.array.dtype == before.points.array.dtype
    assert after.points.array.tobytes() == before.points.array.tobytes()
    assert after.vlrs.get("WktCoordinateSystemVlr")[0].string == WKT
    assert [v.record_data for v in after.vlrs if v.user_id == "someone"] == [b"\x01\x02\x03"]
    assert after.header.global_encoding.wkt == before.header.global_encoding.wkt
    for name in ("system_identifier", "version", "point_format", "scales", "offsets"):
        assert_array_equal(getattr(after.header, name), getattr(before.header, name))


def test_a_subset_of_las_keeps_the_integers_of_the_chosen_points(tmp_path, source):
    mask = np.arange(60) % 3 == 0
    write_points(tmp_path / "b.laz", read_points(source).subset(mask))
    before, after = laspy.read(source), laspy.read(tmp_path / "b.laz")
    assert after.points.array.tobytes() == before.points.array[mask].tobytes()
    assert after.header.point_count == 20
    assert_allclose(after.header.maxs, after.xyz.max(axis=0), rtol=1e-15)


def test_noise_gets_the_class_of_its_point_format_and_nothing_else_changes(tmp_path, source):
    before = laspy.read(source)
    for noise in (np.arange(60) % 4 == 0, np.array([0, 7, 18])[np.arange(60) % 3]):
        write_points(tmp_path / "b.laz", read_points(source), noise=noise)
        after = laspy.read(tmp_path / "b.laz")
        is_high = (noise == 18) & (before.point_format.id > 5)  # which older formats do not define
        expected = np.where(is_high, 18, np.where(noise, 7, np.array(before.classification)))
        assert_array_equal(after.classification, expected)
        after.classification = before.classification
        assert after.points.array.tobytes() == before.points.array.tobytes()


def test_results_are_written_over_results_and_changes_of_attributes_too(tmp_path, source):
    for result in (np.arange(60) % 2 == 0, np.arange(60) / 60, np.arange(60) + 2**53):
        cloud = read_points(source).with_attributes(outlier=result, classification=np.full(60, 2))
        cloud.attributes["intensity"][:] = 5
        write_points(source, cloud)
    las = laspy.read(source)
    assert list(las.point_format.extra_dimension_names).count("outlier") == 1
    assert las["outlier"].dtype == np.int64
    assert_array_equal(las["outlier"], np.arange(60) + 2**53)
    assert "reflectance" in las.point_format.extra_dimension_names
    assert (np.asarray(las.classification) == 2).all()
    assert (las.intensity == 5).all()


def test_values_too_rich_for_a_standard_dimension_are_kept_beside_it(tmp_path, cloud):
    intensity = np.linspace(0, 1, 40, dtype=np.float32)
    with pytest.warns(UserWarning, match="'intensity' does not fit"):
        write_points(tmp_path / "a.las", cloud.with_attributes(intensity=intensity))
    back = read_points(tmp_path / "a.las").attributes
    assert_array_equal(back["intensity_value"], intensity)
    assert (back["intensity"] == 0).all()


# ---- colors ----------------------------------------------------------------------------


@pytest.mark.parametrize("extension", [".csv", ".ply", ".pcd", ".e57"])
@pytest.mark.parametrize("dtype", [np.uint8, np.int64])
@pytest.mark.filterwarnings("ignore:E57 holds")
def test_eight_bit_colors_fill_the_sixteen_bits_of_las_and_come_back(tmp_path, extension, dtype):
    red = np.linspace(0, 255, 40).astype(dtype)
    names = ("red", "green", "blue")
    cloud = PointCloud(np.arange(120.0).reshape(40, 3), dict.fromkeys(names, red))
    write_points(tmp_path / f"a{extension}", cloud)
    write_points(tmp_path / "a.las", read_points(tmp_path / f"a{extension}"))
    las = laspy.read(tmp_path / "a.las")
    assert las.point_format.id == 7
    assert_array_equal(las.red, red * 257.0)
    if extension in (".ply", ".pcd", ".e57"):  # viewers expect 8 bits of them
        write_points(tmp_path / f"b{extension}", read_points(tmp_path / "a.las"))
        back = read_points(tmp_path / f"b{extension}").attributes
        assert all(back[name].dtype == np.uint8 for name in names)
        assert_array_equal(back["blue"], red)


@pytest.mark.parametrize("values", [np.arange(60) % 200, np.arange(60) * 186], ids=["dark", "16"])
def test_dark_colors_of_las_and_colors_of_sixteen_bits_stay(tmp_path, values):
    las = las_of(7)
    las.red = las.green = las.blue = values
    las.write(tmp_path / "a.las")
    for extension in (".las", ".ply", ".pcd"):
        write_points(tmp_path / f"b{extension}", read_points(tmp_path / "a.las"))
        assert_array_equal(read_points(tmp_path / f"b{extension}").attributes["red"], values)


# ---- coordinates -----------------------------------------------------------------------


@pytest.mark.parametrize(("factor", "shift"), [(1, 0.0004), (1, 3.0), (1, -5e6), (1000, 0.0)])
def test_moved_points_are_rounded_to_half_a_step_of_a_grid_that_holds_them(
    tmp_path, source, factor, shift
):
    cloud = read_points(source)
    cloud.xyz = cloud.xyz * [factor, 1, 1] + [shift, 0, 0]
    write_points(tmp_path / "b.las", cloud)
    before, las = laspy.read(source), laspy.read(tmp_path / "b.las")
    step = las.header.scales[0]
    assert step == before.header.scales[0] or factor > 1
    assert step <= max(1e-8 * np.ptp(cloud.xyz[:, 0]), 0.001)
    # Half a step, and the float64 rounding of coordinates up to 1e7.
    assert np.abs(las.xyz[:, 0] - cloud.xyz[:, 0]).max() <= 0.5001 * step + 4e-9
    assert_array_equal(las.Y, before.Y)
    assert_array_equal(las.Z, before.Z)


# ---- records ---------------------------------------------------------------------------


def test_copc_can_be_read_and_its_octree_is_not_claimed_for_the_copy(tmp_path, source):
    las = laspy.read(source)
    las.vlrs.insert(0, laspy.VLR("copc", 1, "", bytes(160)))
    las.write(tmp_path / "a.copc.laz")
    cloud = read_points(tmp_path / "a.copc.laz")
    assert len(cloud) == 60
    write_points(tmp_path / "b.laz", cloud)
    users = [v.user_id for v in laspy.read(tmp_path / "b.laz").vlrs]
    assert "copc" not in users
    assert "someone" in users


def test_ranges_of_extra_attributes_are_not_told_wrong(tmp_path):
    """laspy takes them from the first points of the parts that it writes."""
    values = np.array([1, 5, -2], np.float32)
    write_points(tmp_path / "a.las", PointCloud(np.zeros((3, 3)), {"quality": values}))
    (record,) = laspy.open(tmp_path / "a.las").header.vlrs.get("ExtraBytesVlr")
    (described,) = record.extra_bytes_structs
    assert (described.min in (None, -2), described.max in (None, 5)) == (True, True)


SAMPLES = bytes(range(200))
RECORD = struct.pack("<2x16sHQ32x", b"LASF_Spec", 65535, len(SAMPLES)) + SAMPLES


def las_with_waveforms(path, point_format):
    """Three points whose samples are behind them, as the specification has it."""
    las = las_of(point_format, n=3)
    las.points.array["wavepacket_offset"] = 60 + 50 * np.arange(3)
    las.points.array["wavepacket_size"] = 50
    if point_format > 5:
        las.scanner_channel[:] = 0  # of which LAZ takes one
    las.write(path)
    content = bytearray(path.read_bytes())
    start = len(content)
    struct.pack_into("<Q", content, 227, start)
    if point_format > 5:
        other = struct.pack("<2x16sHQ32x", b"someone", 3, 5) + b"hello"
        struct.pack_into("<QI", content, 235, start, 2)
        struct.pack_into("<Q", content, 227, start + len(other))
        content += other
    path.write_bytes(content + RECORD)
    return path


@pytest.mark.parametrize("target", ["b.las", "b.laz"])
@pytest.mark.parametrize("point_format", [9, 10])
def test_the_header_says_where_samples_of_waveforms_are_after_points_were_removed(
    tmp_path, point_format, target
):
    cloud = read_points(las_with_waveforms(tmp_path / "a.las", point_format))
    write_points(tmp_path / target, cloud.subset(slice(2)))
    content = (tmp_path / target).read_bytes()
    (start,) = struct.unpack_from("<Q", content, 227)
    assert content[start : start + len(RECORD)] == RECORD
    points = laspy.read(tmp_path / target).points.array
    assert (points["wavepacket_offset"] == [60, 110]).all()


def test_samples_that_cannot_be_copied_are_not_promised(tmp_path):
    cloud = read_points(las_with_waveforms(tmp_path / "a.las", 4))
    with pytest.warns(UserWarning, match="waveform samples .* are not copied"):
        write_points(tmp_path / "b.laz", cloud)
    assert struct.unpack_from("<Q", (tmp_path / "b.laz").read_bytes(), 227) == (0,)
