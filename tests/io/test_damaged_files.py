"""Small files that claim to hold much: refused before libraries request memory for it.

Each is the smallest of its kind that `benchmarks/fuzz_files.py` found.
"""

import io
import struct
import tracemalloc
import zipfile

import numpy as np
import pytest

from sklearn_mcmd.io import PointFileError, read_points, write_points

MOST = 2**22  # bytes that files of a few hundred bytes may take
PLY = b"ply\nformat %s 1.0\nelement %s 99999999\nproperty %s x\nend_header\n0\n"
PCD = b"FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT %s 1 1\nWIDTH 5\nPOINTS %s\nDATA %s\n"


def npy(shape, version=1):
    header = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}}}".encode()
    length = struct.pack("<H" if version == 1 else "<I", len(header))
    return b"\x93NUMPY" + bytes([version, 0]) + length + header


def npz(*members):
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for name, data in members:
            archive.writestr(name, data)
    return buffer.getvalue()


def las(format_id, points_at, n_points):
    """A header of LAS 1.2, and nothing behind it."""
    head = bytearray(227)
    head[:4], head[24:26] = b"LASF", b"\x01\x02"
    head[94:111] = struct.pack("<HIIBHI", 227, points_at, 0, format_id, 20, n_points)
    return bytes(head)


MANY = {
    "a text of 10**8 points": (".ply", PLY % (b"ascii", b"vertex", b"double")),
    "lists in a text": (".ply", PLY % (b"ascii", b"face", b"list uchar int")),
    "lists": (".ply", PLY % (b"binary_little_endian", b"face", b"list uchar int")),
    "columns without end": (".pcd", PCD % (b"3333332", b"4", b"binary") + bytes(48)),
    "columns and no points": (".pcd", PCD % (b"99999999", b"0", b"ascii")),
    "compressed bytes": (
        ".pcd",
        PCD % (b"1", b"5", b"binary_compressed") + struct.pack("<II", 2**30, 60) + bytes(30),
    ),
    "rows": (".npy", npy((10**8, 3)) + bytes(24)),
    "a header": (".npy", b"\x93NUMPY\x02\x00\xff\xff\xff\x3f {"),
    "rows of a member": (".npz", npz(("xyz.npy", npy((10**8, 3)) + bytes(24)))),
    "bytes before the points": (".las", las(0x80, 2**30, 0)),
    "points that seem compressed": (".las", las(0xC0, 227, 10**8) + bytes(30)),
}


@pytest.mark.parametrize("kind", MANY)
def test_what_a_file_has_no_room_for_takes_no_memory(kind, tmp_path):
    extension, data = MANY[kind]
    path = tmp_path / f"a{extension}"
    write_points(tmp_path / f"warm{extension}", np.eye(3))
    read_points(tmp_path / f"warm{extension}")  # imports libraries
    path.write_bytes(data)
    tracemalloc.start()
    try:
        with pytest.raises(PointFileError) as error:
            read_points(path)
        assert tracemalloc.get_traced_memory()[1] < MOST
    finally:
        tracemalloc.stop()
    assert "\n" not in str(error.value)
    assert "not enough memory" not in str(error.value)


def test_a_size_to_decompress_to_is_refused_before_it_is_tried(tmp_path):
    head = PCD % (b"1", b"5", b"binary_compressed")
    (tmp_path / "a.pcd").write_bytes(head + struct.pack("<II", 30, 2**30) + bytes(30))
    with pytest.raises(PointFileError, match="the decompressed points need 1,073,741,824 bytes"):
        read_points(tmp_path / "a.pcd")


def test_an_e57_of_more_points_than_bits_is_refused(tmp_path, monkeypatch):
    path = tmp_path / "a.e57"
    write_points(path, np.eye(3))
    # Checksums and two counts would have to fit, so that the library is asked for another count.
    pye57 = pytest.importorskip("pye57")
    monkeypatch.setattr(pye57.scan_header.ScanHeader, "point_count", 10**9)
    with pytest.raises(PointFileError, match="1,000,000,000 points need 125,000,000 bytes"):
        read_points(path)


@pytest.mark.parametrize("name", ["a\nb", "a\r\n", "\x1b[2J\n"])
def test_an_error_is_one_line_whatever_names_a_file_holds(name, tmp_path):
    (tmp_path / "a.npz").write_bytes(npz((f"{name}.npy", npy((0,)))))
    with pytest.raises(PointFileError, match="it holds") as error:
        read_points(tmp_path / "a.npz")
    assert "\n" not in str(error.value)
    assert "\r" not in str(error.value)


@pytest.mark.filterwarnings("ignore:.*no returns")
def test_what_is_compressed_as_far_as_can_be_is_read(tmp_path):
    """The bounds are those of the compressions, not those of usual files."""
    xyz = np.zeros((200_000, 3))
    xyz[0] = 1  # of which the rest is far from empty
    np.savez_compressed(tmp_path / "a.npz", xyz=xyz)
    assert xyz.nbytes > 900 * (tmp_path / "a.npz").stat().st_size
    assert read_points(tmp_path / "a.npz").n_dropped == len(xyz) - 1
    write_points(tmp_path / "a.pcd", xyz, encoding="binary_compressed")
    assert xyz.nbytes / 2 > 80 * (tmp_path / "a.pcd").stat().st_size
    assert read_points(tmp_path / "a.pcd").n_dropped == len(xyz) - 1
    digits = "".join("0 0 0\n" for _ in range(9))
    (tmp_path / "b.pcd").write_bytes(PCD % (b"1", b"9", b"ascii") + digits[:-1].encode())
    assert len(read_points(tmp_path / "b.pcd")) == 9


def test_archives_of_other_kinds_and_with_other_files_are_read(tmp_path):
    path, xyz = tmp_path / "a.npz", np.zeros((300_000, 3))
    for kind in (zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA):  # of constants more than 1,032 to one
        with zipfile.ZipFile(path, "w", kind) as archive, archive.open("xyz.npy", "w") as file:
            np.save(file, xyz)
        with zipfile.ZipFile(path, "a") as archive:
            archive.writestr("readme.txt", "hello")
        assert len(read_points(path)) == len(xyz)


@pytest.mark.parametrize("data", ["ascii", "binary"])
def test_an_empty_pcd_is_told_to_be_empty(tmp_path, data):
    pytest.importorskip("pypcd4")
    header = "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 0\nHEIGHT 1\n"
    header += f"VIEWPOINT 0 0 0 1 0 0 0\nPOINTS 0\nDATA {data}\n"
    (tmp_path / "a.pcd").write_text(header)
    with pytest.raises(PointFileError, match="holds no points"):
        read_points(tmp_path / "a.pcd")
