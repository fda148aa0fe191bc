"""LAS headers that cannot be, or that are older or longer than what they describe."""

import struct

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from las_files import change, las_file, las_of, laspy
from sklearn_mcmd.io import PointFileError, read_points, write_points
from sklearn_mcmd.io._las_parts import read_parts
from sklearn_mcmd.tiling import Catalog

N = 50
XYZ = np.round(np.random.default_rng(0).uniform(0, 9, (N, 3)), 3)
XYZ += np.array([362_000, 5_157_000, 100])
MINOR, LENGTH, SCALES = 25, 105, 131  # positions in a header
EXTRA = [(f"f{i}", "f4") for i in range(5)]


def write(path, version="1.4", point_format=6, scales=0.001, extra=()):
    offsets = [362_000.0, 5_157_000.0, 0.0]
    options = {"version": version, "scales": scales, "offsets": offsets, "extra": extra}
    las = las_of(point_format, xyz=XYZ, **options)
    for name, _ in extra:
        las[name] = np.arange(1, N + 1)
    las.write(path)
    return path


def first_part(path):
    return next(read_parts(path, 10))


READERS = pytest.mark.parametrize("read", [read_points, Catalog, first_part])


@READERS
@pytest.mark.parametrize("field", range(6))
def test_scales_and_offsets_that_cannot_be_are_refused(tmp_path, read, field):
    kind, axis = ("scale", "offset")[field // 3], "xyz"[field % 3]
    path = write(tmp_path / "a.las")
    wrong = [0.0, 1e-300, -0.001] if kind == "scale" else [1e17]  # or so far that all is one place
    for value in [np.nan, np.inf, -np.inf, 1e300, *wrong]:
        change(path, SCALES + 8 * field, struct.pack("<d", value))
        with pytest.raises(PointFileError, match=f"broken header: .*{kind} .*of {axis} give no"):
            read(path)


@pytest.mark.parametrize(
    ("scale", "offset"),
    [(1e-6, 5e6), (1e-3, 0.0), (1e-9, 5e6), (1e-3, 1e12), (1.0, 5e6), (1e3, 5e6)],
)
def test_scales_and_offsets_that_can_be_are_read(tmp_path, scale, offset):
    las = las_of(n=18)
    las.X = las.Y = las.Z = np.arange(-9, 9)
    las.write(tmp_path / "a.las")
    change(tmp_path / "a.las", SCALES, struct.pack("<6d", *[scale] * 3, *[offset] * 3))
    xyz = read_points(tmp_path / "a.las").xyz
    assert_array_equal(xyz[:, 0], np.arange(-9, 9) * scale + offset)


@pytest.mark.parametrize("minor", [0, 1])
def test_the_oldest_versions_become_las_1_2_with_the_same_points(tmp_path, minor):
    path = write(tmp_path / "a.las", "1.2", 1)
    before = laspy.read(path).points.array
    change(path, 6, b"\1\1")  # in 1.2 a flag of the GPS times, before a byte without a meaning
    change(path, MINOR, bytes([minor]))
    write_points(tmp_path / "b.laz", read_points(path))
    after = laspy.read(tmp_path / "b.laz")
    assert str(after.header.version) == "1.2"
    assert after.header.global_encoding.value == 0
    assert after.points.array.tobytes() == before.tobytes()


@READERS
@pytest.mark.parametrize(
    ("position", "data", "message"),
    [
        (MINOR - 1, b"\1\5", "LAS 1.5 with a header of 375 bytes"),
        (MINOR - 1, b"\2\0", "LAS 2.0 with a header of 375 bytes"),
        (LENGTH, struct.pack("<H", 20), "header says 20 point_format"),
        (100, b"\xff" * 4, "more metadata records than the file has room for"),
        (243, b"\1\0\0\0", "more metadata records than the file has room for"),
        (247, struct.pack("<Q", 2**33), "truncated: 8589934592 points need"),
    ],
)
def test_headers_that_are_not_known_or_promise_too_much_are_refused(
    tmp_path, read, position, data, message
):
    path = change(write(tmp_path / "a.las"), position, data)
    if position == 243:  # an extended record, which is longer than the file
        change(path, 235, struct.pack("<Q", path.stat().st_size))
        record = struct.pack("<2x16sHQ32x", b"someone", 7, 2**40)
        path.write_bytes(path.read_bytes() + record + bytes(100))
    with pytest.raises(PointFileError, match=message):
        read(path)


# ---- records behind the points -----------------------------------------------------------

COUNTS = {"1.2": (107, "<I"), "1.3": (107, "<I"), "1.4": (247, "<Q")}


def counting(path, version, n_counted, tail=b"", waveforms=False):
    """A file whose header counts fewer points than there are, and bytes behind these."""
    write(path, version, 6 if version == "1.4" else 1)
    if waveforms:
        change(path, 227, struct.pack("<Q", len(path.read_bytes())))
    path.write_bytes(path.read_bytes() + tail)
    position, code = COUNTS[version]
    return change(path, position, struct.pack(code, n_counted))


@READERS
@pytest.mark.parametrize(
    ("version", "waveforms"), [("1.2", False), ("1.3", True), ("1.4", False), ("1.4", True)]
)
def test_records_behind_those_that_the_header_counts_are_told(tmp_path, read, version, waveforms):
    path = counting(tmp_path / "a.las", version, 30, bytes(range(90)) * waveforms, waveforms)
    with pytest.warns(UserWarning, match="a.las: holds 20 records more than its header counts"):
        read(path)


@pytest.mark.parametrize("tail", [b"", b"signature", bytes(4096), "evlr"])
def test_what_is_no_record_behind_the_points_has_no_warning(tmp_path, tail):
    if tail == "evlr":
        las = laspy.read(write(tmp_path / "a.las"))
        las.evlrs = laspy.vlrs.vlrlist.VLRList([laspy.VLR("us", 1, "", bytes(range(200)))])
        las.write(tmp_path / "a.las")
    else:
        counting(tmp_path / "a.las", "1.2", N, tail)
    assert len(read_points(tmp_path / "a.las")) == N


# ---- other counts ------------------------------------------------------------------------


def read_in_parts(path):
    return np.vstack([part.xyz for part in read_parts(path, 15)])


@pytest.mark.parametrize("name", ["a.las", "a.laz"])
@pytest.mark.parametrize("point_format", [1, 6])
def test_the_old_count_is_taken_where_the_new_one_is_0(tmp_path, name, point_format):
    path = write(tmp_path / name, "1.4", point_format)
    change(change(path, 247, bytes(8)), 107, struct.pack("<I", N))
    told = "its header counts 0 points, but 50 where LAS 1.2 does"
    for read in (lambda path: read_points(path).xyz, read_in_parts):
        with pytest.warns(UserWarning, match=told):
            assert_allclose(read(path), XYZ, rtol=1e-15)
    with pytest.warns(UserWarning, match=told):
        assert Catalog(path).counts == [N]


def test_an_old_count_of_more_than_there_is_is_truncated(tmp_path):
    path = change(write(tmp_path / "a.las"), 247, bytes(8))
    change(path, 107, struct.pack("<I", N + 1))
    with pytest.raises(PointFileError, match="truncated: 51 points need"):
        read_points(path)


@pytest.mark.parametrize("name", ["a.las", "a.laz"])
@pytest.mark.parametrize("behind", [0, 2])
def test_a_file_without_points_holds_none_wherever_they_would_begin(tmp_path, name, behind):
    path = las_file(tmp_path / name, n=0)
    begin = struct.unpack_from("<I", path.read_bytes(), 96)[0]
    path.write_bytes(path.read_bytes()[:begin])
    change(path, 96, struct.pack("<I", begin + behind))
    for read in (read_points, Catalog):
        with pytest.raises(PointFileError, match=f"{name}: holds no points"):
            read(path)


# ---- descriptions of extra bytes ---------------------------------------------------------


@pytest.mark.parametrize("name", ["a.las", "a.laz"])
def test_records_shorter_than_their_description_are_refused(tmp_path, name):
    las = laspy.read(write(tmp_path / name, extra=EXTRA[:1]))
    longer = laspy.read(write(tmp_path / "b.las", extra=EXTRA)).header.vlrs.get("ExtraBytesVlr")
    las.vlrs[:] = [*longer, *(r for r in las.vlrs if type(r).__name__ != "ExtraBytesVlr")]
    las.write(tmp_path / name)
    with pytest.raises(PointFileError, match=f"{name}: .*header says 34 point_format .* says 50"):
        read_points(tmp_path / name)


def test_records_longer_than_their_description_keep_the_bytes(tmp_path):
    path = write(tmp_path / "a.las", extra=EXTRA)
    change(path, path.read_bytes().index(b"LASF_Spec"), b"elsewhere")  # no description is left
    cloud = read_points(path)
    assert cloud.attributes["ExtraBytes"].shape == (N, 20)
    write_points(tmp_path / "b.las", cloud)
    kept = laspy.read(tmp_path / "b.las")["ExtraBytes"].view("<f4")
    assert_array_equal(kept[:, 0], np.arange(1, N + 1))


def test_which_value_means_no_data_is_kept_beside_new_attributes(tmp_path):
    depth = laspy.ExtraBytesParams("depth", "f4", no_data=np.array([-9999.0]))
    cloud = read_points(las_file(tmp_path / "a.las", n=N, extra=[depth]))
    write_points(tmp_path / "b.las", cloud.with_attributes(score=np.arange(N)))
    (record,) = laspy.read(tmp_path / "b.las").header.vlrs.get("ExtraBytesVlr")
    no_data = {extra.format_name(): extra.no_data for extra in record.extra_bytes_structs}
    assert no_data == {"depth": [-9999.0], "score": None}
