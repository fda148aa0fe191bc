"""LAS and LAZ: every record kept, coordinates as precise as the header allows."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from sklearn_mcmd.io import PointCloud, PointFileError, read_points, write_points

laspy = pytest.importorskip("laspy")
pytest.importorskip("lazrs")

WKT = 'LOCAL_CS["a site grid",UNIT["metre",1]]'


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


@pytest.mark.parametrize(("point_format", "high"), [(3, 7), (6, 18), (7, 18)])
def test_high_noise_is_class_18_where_the_point_format_defines_it(tmp_path, point_format, high):
    version = "1.2" if point_format < 6 else "1.4"
    source = write_las_with_everything(tmp_path / "a.las", version, 7 if point_format > 6 else 3)
    if point_format == 6:
        source = tmp_path / "plain.las"
        write_points(source, np.eye(3)[np.arange(60) % 3])
    noise = np.array([0, 7, 18])[np.arange(60) % 3]
    cloud = read_points(source)
    write_points(tmp_path / "b.las", cloud, noise=noise)
    expected = np.where(noise == 0, cloud.attributes["classification"], noise)
    expected[noise == 18] = high
    found = read_points(tmp_path / "b.las").attributes["classification"]
    assert_array_equal(found, expected)


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


@pytest.mark.parametrize("extension", [".csv", ".npz", ".ply", ".pcd", ".e57"])
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


def test_dark_colors_of_las_and_colors_of_sixteen_bits_stay(tmp_path):
    source = write_las_with_everything(tmp_path / "a.las", "1.4", 7)
    las = laspy.read(source)
    las.red = las.green = las.blue = np.arange(len(las)) % 200
    las.write(tmp_path / "dark.las")
    deep = read_points(tmp_path / "dark.las")
    write_points(tmp_path / "b.las", deep)
    assert_array_equal(laspy.read(tmp_path / "b.las").red, las.red)
    write_points(tmp_path / "b.ply", deep)
    assert_array_equal(read_points(tmp_path / "b.ply").attributes["red"], las.red)


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


@settings(max_examples=60)
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


def test_a_header_with_an_absurd_count_is_refused_at_once(tmp_path):
    path = write_las_with_everything(tmp_path / "a.las")
    content = bytearray(path.read_bytes())
    content[100:104] = b"\xff\xff\xff\xff"
    path.write_bytes(content)
    with pytest.raises(PointFileError, match="more metadata records than the file has room for"):
        read_points(path)


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


@pytest.mark.parametrize("name", ["a.las", "a.laz"])
def test_ranges_of_extra_attributes_are_not_told_wrong(tmp_path, name):
    """laspy takes them from the first points of the parts that it writes."""
    values = np.array([1, 5, -2], np.float32)
    write_points(tmp_path / name, PointCloud(np.zeros((3, 3)), {"quality": values}))
    with laspy.open(tmp_path / name) as reader:
        (record,) = reader.header.vlrs.get("ExtraBytesVlr")
    (described,) = record.extra_bytes_structs
    assert described.format_name() == "quality"
    assert described.min in (None, -2)
    assert described.max in (None, 5)
