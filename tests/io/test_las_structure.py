"""LAS headers that cannot be, or that are older or longer than what they describe."""

import struct
import warnings

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from sklearn_mcmd.io import PointFileError, read_points, write_points
from sklearn_mcmd.io._las import writing_parts
from sklearn_mcmd.io._las_joined import joined_cloud, joined_header
from sklearn_mcmd.io._las_parts import read_parts
from sklearn_mcmd.tiling import Catalog

laspy = pytest.importorskip("laspy")
pytest.importorskip("lazrs")

N = 50
XYZ = np.round(np.random.default_rng(0).uniform(0, 9, (N, 3)), 3)
XYZ += np.array([362_000, 5_157_000, 100])
MINOR, LENGTH, SCALES = 25, 105, 131  # positions in a header
EXTRA = [f"f{i}" for i in range(5)]


def write(path, version="1.4", point_format=6, scales=(0.001,) * 3, extra=()):
    header = laspy.LasHeader(version=version, point_format=point_format)
    header.scales, header.offsets = scales, [362_000.0, 5_157_000.0, 0.0]
    header.add_extra_dims([laspy.ExtraBytesParams(name, "f4") for name in extra])
    las = laspy.LasData(header)
    for axis, steps in zip("XYZ", ((XYZ - header.offsets) / header.scales).T, strict=True):
        las[axis] = np.rint(steps).astype(np.int32)  # laspy's own would refuse negative scales
    for name in extra:
        las[name] = np.arange(1, N + 1)
    las.write(path)
    return path


def change(path, position, data):
    raw = bytearray(path.read_bytes())
    raw[position : position + len(data)] = data
    path.write_bytes(raw)
    return path


def in_parts(path, target):
    """The same points, read and written piece by piece as one of several files."""
    header = joined_header([path])
    with writing_parts(target) as write_part:
        for part in read_parts(path, 15):
            write_part(joined_cloud(part, header))
    return target


def at_once(path, target):
    write_points(target, read_points(path))
    return target


WAYS = pytest.mark.parametrize("way", [at_once, in_parts])


@pytest.mark.parametrize(
    ("field", "value"),
    [(i, value) for i in range(6) for value in (np.nan, np.inf, -np.inf, 1e300)]
    + [(i, value) for i in range(3) for value in (0.0, 1e-300)],
)
def test_scales_and_offsets_that_cannot_be_are_refused(tmp_path, field, value):
    path = change(write(tmp_path / "a.las"), SCALES + 8 * field, struct.pack("<d", value))
    kind, axis = ("scale", "offset")[field // 3], "xyz"[field % 3]
    for read in (read_points, Catalog, lambda path: next(read_parts(path, 10))):
        with pytest.raises(PointFileError, match=f"broken header: .*{kind} .*of {axis} give no"):
            read(path)


@pytest.mark.parametrize("axis", range(3))
def test_an_offset_that_takes_the_place_of_all_coordinates_of_an_axis_is_refused(tmp_path, axis):
    path = change(write(tmp_path / "a.las"), SCALES + 24 + 8 * axis, struct.pack("<d", 1e17))
    for read in (read_points, Catalog):
        with pytest.raises(PointFileError, match=f"offset 1e\\+17 of {'xyz'[axis]} give no"):
            read(path)


@pytest.mark.parametrize(("scale", "offset"), [(1e-6, 5e6), (1e-3, 0.0), (1e-9, 0.0), (1e-3, 1e12)])
def test_offsets_that_can_be_are_read(tmp_path, scale, offset):
    path = write(tmp_path / "a.las")
    change(path, SCALES, struct.pack("<6d", *[scale] * 3, *[offset] * 3))
    assert len(np.unique(read_points(path).xyz[:, 0])) == N


@pytest.mark.parametrize("scale", [1e-9, 1e-3, -1e-3, 1.0, 1000.0])
def test_scales_that_can_be_are_read(tmp_path, scale):
    header = laspy.LasHeader(version="1.4", point_format=6)
    header.scales, header.offsets = np.full(3, scale), np.full(3, 5e6)
    las = laspy.LasData(header)
    las.X = las.Y = las.Z = np.arange(-9, 9)
    las.write(tmp_path / "a.las")
    assert_array_equal(read_points(tmp_path / "a.las").xyz[:, 0], np.arange(-9, 9) * scale + 5e6)


@WAYS
@pytest.mark.parametrize("name", ["b.las", "b.laz"])
def test_negative_scales_keep_the_bounds_in_order(tmp_path, way, name):
    path = write(tmp_path / "a.las", scales=[-0.001, 0.001, -0.01])
    target = way(path, tmp_path / name)
    xyz, header = read_points(target).xyz, laspy.open(target).header
    assert_allclose(xyz, read_points(path).xyz, rtol=0, atol=1e-9)
    assert_allclose([header.mins, header.maxs], [xyz.min(axis=0), xyz.max(axis=0)])


@WAYS
@pytest.mark.parametrize("minor", [0, 1])
@pytest.mark.parametrize("name", ["b.las", "b.laz"])
def test_the_oldest_versions_become_las_1_2_with_the_same_points(tmp_path, way, minor, name):
    path = write(tmp_path / "a.las", "1.2", 1)
    before = laspy.read(path).points.array
    change(path, 6, b"\1\1")  # in 1.2 a flag of the GPS times, before a byte without a meaning
    change(path, MINOR, bytes([minor]))
    after = laspy.read(way(path, tmp_path / name))
    assert str(after.header.version) == "1.2"
    assert after.header.global_encoding.value == 0
    assert after.points.array.tobytes() == before.tobytes()


@pytest.mark.parametrize(("major", "minor"), [(1, 5), (1, 6), (2, 0)])
def test_versions_whose_header_is_not_known_are_refused(tmp_path, major, minor):
    path = change(write(tmp_path / "a.las"), MINOR - 1, bytes([major, minor]))
    for read in (read_points, Catalog):
        with pytest.raises(PointFileError, match=f"LAS {major}.{minor} with a header of 375 bytes"):
            read(path)


COUNTS = {"1.2": (107, "<I"), "1.3": (107, "<I"), "1.4": (247, "<Q")}


def counting(path, version, n_counted, tail=b"", waveforms=False):
    """A file whose header counts fewer points than there are, and bytes behind these."""
    write(path, version, 6 if version == "1.4" else 1)
    if waveforms:
        change(path, 227, struct.pack("<Q", len(path.read_bytes())))
    path.write_bytes(path.read_bytes() + tail)
    position, code = COUNTS[version]
    return change(path, position, struct.pack(code, n_counted))


@pytest.mark.parametrize("version", COUNTS)
@pytest.mark.parametrize("waveforms", [False, True])
def test_records_behind_those_that_the_header_counts_are_told(tmp_path, version, waveforms):
    behind = waveforms and version != "1.2"
    path = counting(tmp_path / "a.las", version, 30, bytes(range(90)) * behind, behind)
    for read in (read_points, Catalog, lambda path: next(read_parts(path, 10))):
        with pytest.warns(UserWarning, match="a.las: holds 20 records more than its header counts"):
            read(path)


def test_extended_records_are_no_points(tmp_path):
    path = write(tmp_path / "a.las")
    las = laspy.read(path)
    las.evlrs = laspy.vlrs.vlrlist.VLRList([laspy.VLR("us", 1, "", bytes(range(200)))])
    las.write(path)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        read_points(path)
    change(path, *[247, struct.pack("<Q", 49)])
    with pytest.warns(UserWarning, match="a.las: holds 1 record more than its header counts"):
        read_points(path)


@pytest.mark.parametrize("tail", [b"", b"signature", bytes(4096)], ids=["none", "short", "padding"])
def test_what_is_no_record_behind_the_points_has_no_warning(tmp_path, tail):
    path = counting(tmp_path / "a.las", "1.2", N, tail)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert len(read_points(path)) == N


def shortened(path, n_bytes):
    """The same file with records of so many bytes, though its header describes more."""
    raw = path.read_bytes()
    (at,), (length,) = struct.unpack_from("<I", raw, 96), struct.unpack_from("<H", raw, LENGTH)
    points = np.frombuffer(raw[at:], np.uint8).reshape(N, length)[:, :n_bytes]
    path.write_bytes(raw[:at] + points.tobytes())
    return change(path, LENGTH, struct.pack("<H", n_bytes))


@WAYS
@pytest.mark.parametrize(("n_bytes", "n_there"), [(34, 1), (36, 1), (46, 4), (30, 0)])
def test_described_attributes_that_records_lack_are_0(tmp_path, way, n_bytes, n_there):
    path = shortened(write(tmp_path / "a.las", extra=EXTRA), n_bytes)
    message = f"describes 20 extra bytes of each point, its points have {n_bytes - 30}"
    with pytest.warns(UserWarning, match=message):
        back = laspy.read(way(path, tmp_path / "b.las"))
    assert_allclose(back.xyz, XYZ, rtol=1e-15)
    for i, name in enumerate(EXTRA):
        assert_array_equal(back[name], np.arange(1, N + 1) if i < n_there else np.zeros(N))


def test_a_laz_with_descriptions_longer_than_its_records_is_read(tmp_path):
    path = write(tmp_path / "a.laz", extra=EXTRA[:1])
    las = laspy.read(path)
    whole = laspy.read(write(tmp_path / "b.las", extra=EXTRA)).header.vlrs.get("ExtraBytesVlr")
    las.vlrs[:] = [*whole, *(r for r in las.vlrs if type(r).__name__ != "ExtraBytesVlr")]
    las.write(path)
    with pytest.warns(UserWarning, match="describes 20 extra bytes"):
        cloud = read_points(path)
    assert_array_equal(cloud.attributes["f0"], np.arange(1, N + 1))
    assert not cloud.attributes["f4"].any()
    with pytest.warns(UserWarning, match="describes 20 extra bytes"):
        parts = list(read_parts(path, 10))
    assert_allclose(np.concatenate([part.xyz for part in parts]), XYZ, rtol=1e-15)


def test_records_longer_than_their_description_keep_the_bytes(tmp_path):
    path = write(tmp_path / "a.las", extra=EXTRA)
    raw = path.read_bytes()
    position = raw.index(b"LASF_Spec")
    change(path, position, b"elsewhere")  # the description is gone
    cloud = read_points(path)
    assert cloud.attributes["ExtraBytes"].shape == (N, 20)
    write_points(tmp_path / "b.las", cloud)
    assert_array_equal(
        laspy.read(tmp_path / "b.las")["ExtraBytes"].view("<f4")[:, 0], np.arange(1, N + 1)
    )


def test_records_shorter_than_their_point_format_are_refused(tmp_path):
    path = change(write(tmp_path / "a.las"), LENGTH, struct.pack("<H", 20))
    with pytest.raises(
        PointFileError, match="points of 20 bytes, of which point format 6 needs 30"
    ):
        read_points(path)


def test_which_value_means_no_data_is_kept_beside_new_attributes(tmp_path):
    header = laspy.LasHeader(version="1.4", point_format=6)
    header.add_extra_dim(laspy.ExtraBytesParams("depth", "f4", no_data=np.array([-9999.0])))
    las = laspy.LasData(header)
    las.xyz, las.depth = XYZ - XYZ[0], np.full(N, -9999.0)
    las.write(tmp_path / "a.las")
    cloud = read_points(tmp_path / "a.las").with_attributes(score=np.arange(N))
    write_points(tmp_path / "b.las", cloud)
    (record,) = laspy.read(tmp_path / "b.las").header.vlrs.get("ExtraBytesVlr")
    told = {extra.format_name(): extra.no_data for extra in record.extra_bytes_structs}
    assert told == {"depth": [-9999.0], "score": None}
