"""Files that are damaged, empty, of another kind, or that claim to hold much: one clear line.

Libraries are not asked for memory that a file has no bytes for. Most of the small files that claim
much are the smallest of their kind that `benchmarks/fuzz_files.py` found.
"""

import io
import os
import struct
import tracemalloc
import zipfile

import numpy as np
import pytest

from benchmarks._fuzz_seeds import save_as
from sklearn_mcmd.io import PointFileError, read_points, write_points
from sklearn_mcmd.io._formats import format_of, supported_extensions
from sklearn_mcmd.io._text import read_text

for library in ("laspy", "lazrs", "plyfile", "pypcd4", "pye57"):
    pytest.importorskip(library)

NO_TEXT = [
    e for e in supported_extensions(written=True) if format_of(f"a{e}").read is not read_text
]


def refused(path, message=None):
    """The error of a file in one line, which begins with its name."""
    with pytest.raises(PointFileError, match=message) as error:
        read_points(path)
    assert str(error.value).startswith(f"{path}: ")
    assert not {"\n", "\r"} & set(str(error.value))
    insides = ("allow_pickle=", "pydantic", "dtype", "usecols")
    assert not any(word in str(error.value).removeprefix(f"{path}") for word in insides)
    return str(error.value)


BAD_TEXTS = {
    "words.xyz": ("hello\nworld\n", "holds no row of numbers"),
    "dates.csv": ("day,hour,who\n" + "May 1,one,A\n" * 12, "no x, y, z among the columns day, h"),
    "two.csv": ("1,2\n3,4\n", "line 1 has 2 column"),
    "na.csv": ("1,2,NA\n4,5,6\n", "line 1: 'NA' is not a number; write nan for a point that"),
    "stars.csv": ("***,2,3\n4,5,6\n", r"line 1: '\*\*\*' is not a number"),
    "below.csv": ("x,y,z\nNA,NA,NA\n4,5,6\n", "line 2: 'NA' is not a number"),
    "gap.csv": ("x,y,z\n1,2,3\n4,,6\n", "line 3: '' is not a number"),
    "underscore.csv": ("1,2,3\n4,5_0,6\n", "line 2: '5_0' is not a number"),
    "commas.xyz": ("112,345 213,456 100,123\n", "decimal commas"),  # or thousands apart
    "doubled.csv": ("x,y,z\n1,5,2,25,3,5\n", "header has 3 columns, line 2 has 6; .* decimal com"),
    "unnamed.csv": ("7,216,8,32,9,5\n7,016,8,32,9,5\n", "line 2 has decimal commas: write points"),
    "count.xyz": ("3\n1 2 3\n4 5 6\n", "line 1 promises 3 points, found 2"),
    "thousands.csv": ('x,y,z\n1,2,"312,403"\n', "line 2 has decimal commas: .* between thousands"),
    "more.xyz": ("1\n1 2 3\n4 5 6\n", "line 1 promises 1 point, line 3 is one more"),
    "second.xyz": ("1\n1 2 3\n3\n4 5 6\n", "line 3 promises 3 points, found 1"),
    "ragged.xyz": ("1 2 3\n\n4 5\n", "line 3 has 2 columns, line 1 has 3"),
    "late.xyz": ("1 2 3\n4 b 6\n", "line 2: 'b' is not a number"),
    "grid.asc": ("ncols 2\nnrows 1\ncellsize 5\n3 4\n", "is an ESRI ASCII grid: convert it by"),
    "twice.csv": ("x,y,z,a,a\n1,2,3,4,5\n", "two columns are named 'a'"),
    "flat.csv": ("x,y,t\n1,2,3\n", "no z among the columns x, y, t: say which they are"),
    "header.csv": ("x,y,z\n", "no points"),
    "nan.xyz": ("nan 1 2\n", r"no points with finite coordinates \(1 dropped\)"),
    "text.ply": ("hello\n", "damaged or is of another format"),
    "text.npy": ("hello\n", "NumPy's format NPY"),
    "empty.ply": ("ply\nformat ascii 1.0\nelement face 0\nend_header\n", "no element 'vertex'"),
    "a.foo": ("1 2 3\n", "unknown extension '.foo'; known are ."),
    "nothing": ("1 2 3\n", "no extension; known are"),
}

ROWS = "1 2 3\n4 5 6\n"
POINTS = "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 2\nHEIGHT 1\nPOINTS 2\nDATA ascii\n"
BAD_TEXTS |= {  # PCD
    "commas.pcd": (POINTS + "1,5 2,5 3,5\n" * 2, "or damaged: no 2 points of 3 numbers"),
    "one.pcd": ("VERSION 1.0\n" + POINTS + ROWS, "is PCD of version 1.0; .5, .6 and .7 are"),
    "type.pcd": (POINTS.replace("F F F", "F F Q") + ROWS, "broken PCD header: FIELDS x"),
    "size.pcd": (POINTS.replace("SIZE 4 4 4\n", "") + ROWS, "its header has no SIZE"),
    "empty.pcd": (POINTS.replace("2", "0"), "holds no points"),
}
BAD_TEXTS |= {  # names in a comment that hold no coordinates
    "shot.csv": (
        "# SHOT TIME LONGITUDE LATITUDE HEIGHT\n9 8 13.4 52.5 3\n",
        "no x, y among .* SHOT",
    ),
    "ost.csv": ("// time ost nord hoch\n9 1 2 3\n", "no z among the columns time, ost, nord, hoch"),
    "id,.csv": ("#id,a,b,c\n9,1,2,3,\n", "no x, y, z among the columns id, a, b, c"),
    "today.csv": ("# a,b,c,d\n# scanned,by,hand,today\n3,2,1,4\n", "among the columns a, b, c, d"),
}
SIGNS = [  # decimal signs that change: the text, the line, and those above
    ("1,5;2;3\n312.403;2;3", 2, "comma"),  # thousands, as in German
    ("1.5;2;3\n4;5;6\n312,403;2;3", 3, "point"),
    ("452,345.6;2;3\n4;5;6,5", 2, "point"),
    ("1;2;3;0,5\n1.5;2;3;4", 2, "comma"),  # that an attribute had
]
BAD_TEXTS |= {
    f"sign{i}.csv": (text, f"line {line}: .* with a decimal {sign}, as those")
    for i, (text, line, sign) in enumerate(SIGNS)
}
DOUBTS = {  # by the line
    1: [
        "1,234 5,678 9,012\n234 5,678 1,012\n1,234 500 9,013",
        "112,345  213,456\t100,123",
    ],
    2: ['345;567;12\n1;"-567,890";12'],
}
BAD_TEXTS |= {
    f"doubt{line}{i}.csv": (text, f"line {line}: are there thousands or decimals")
    for line, texts in DOUBTS.items()
    for i, text in enumerate(texts)
}


@pytest.mark.parametrize("name", BAD_TEXTS)
def test_files_that_are_wrong_get_one_clear_line(tmp_path, monkeypatch, name):
    text, message = BAD_TEXTS[name]
    (tmp_path / name).write_text(text)
    for at_once in (1, 2, 3, 100):
        monkeypatch.setattr("sklearn_mcmd.io._text.ROWS_A_TIME", at_once)
        refused(tmp_path / name, message)


def test_missing_files_folders_and_names_that_are_too_long_are_named(tmp_path):
    refused(tmp_path / "a.las", "no such file")
    refused(tmp_path, "is a folder")
    refused(tmp_path / ("x" * 260 + ".npy"), "cannot be read: file name too long")


@pytest.mark.parametrize("extension", supported_extensions())
def test_junk_empty_and_truncated_files_get_one_clear_line(tmp_path, extension):
    path, junk = tmp_path / f"a{extension}", np.random.default_rng(0).bytes(4000)
    for content, message in ((b"", "is empty"), (junk, None), (b"\0" * 4000, None)):
        path.write_bytes(content)
        refused(path, message)
    if extension in NO_TEXT:
        write_points(path, np.random.default_rng(0).random((200, 3)))
        whole = path.read_bytes()
        for part in (0.2, 0.6, 0.95):
            path.write_bytes(whole[: int(part * len(whole))])
            refused(path)


@pytest.mark.parametrize("extension", [".npy", ".npz"])
def test_no_pickle_is_loaded(tmp_path, extension):
    loaded = tmp_path / "loaded"

    class Trap:
        def __reduce__(self):
            return os.mkdir, (str(loaded),)

    save = np.save if extension == ".npy" else np.savez
    save(tmp_path / f"a{extension}", np.array([[Trap()] * 3]))
    refused(tmp_path / f"a{extension}", "pickled objects, which are never loaded")
    assert not loaded.exists()


# ---- what has no room --------------------------------------------------------------------

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
        assert "not enough memory" not in refused(path)
        assert tracemalloc.get_traced_memory()[1] < MOST
    finally:
        tracemalloc.stop()


def test_a_size_to_decompress_to_is_refused_before_it_is_tried(tmp_path):
    head = PCD % (b"1", b"5", b"binary_compressed")
    (tmp_path / "a.pcd").write_bytes(head + struct.pack("<II", 30, 2**30) + bytes(30))
    refused(tmp_path / "a.pcd", "the decompressed points need 1,073,741,824 bytes")


def test_an_e57_of_more_points_than_bits_is_refused(tmp_path, monkeypatch):
    path = tmp_path / "a.e57"
    write_points(path, np.eye(3))
    # Checksums and two counts would have to fit, so that the library is asked for another count.
    pye57 = pytest.importorskip("pye57")
    monkeypatch.setattr(pye57.scan_header.ScanHeader, "point_count", 10**9)
    refused(path, "1,000,000,000 points need 125,000,000 bytes")


def test_a_line_of_millions_of_numbers_is_no_row(tmp_path):
    (tmp_path / "a.xyz").write_text("1 2 3\n" + "1 " * 600_000 + "\n")
    refused(tmp_path / "a.xyz", "a line has more than 1,000,000 characters")


def test_an_error_is_one_line_whatever_names_a_file_holds_and_however_many(tmp_path):
    members = ((f"a\n\x1b[2J{i}.npy", npy((0,))) for i in range(999))
    (tmp_path / "a.npz").write_bytes(npz(*members))
    assert len(refused(tmp_path / "a.npz", "it holds a")) < 600


@pytest.mark.filterwarnings("ignore:.*no returns")
def test_what_is_compressed_as_far_as_can_be_is_read(tmp_path):
    """The bounds are those of the compressions, not those of usual files."""
    xyz = np.zeros((200_000, 3))
    xyz[0] = 1  # of which the rest is far from empty
    np.savez_compressed(tmp_path / "a.npz", xyz=xyz)
    assert xyz.nbytes > 900 * (tmp_path / "a.npz").stat().st_size
    assert read_points(tmp_path / "a.npz").n_dropped == len(xyz) - 1
    write_points(tmp_path / "a.pcd", xyz)
    save_as(tmp_path / "a.pcd", "binary_compressed")
    assert xyz.nbytes / 2 > 80 * (tmp_path / "a.pcd").stat().st_size
    assert read_points(tmp_path / "a.pcd").n_dropped == len(xyz) - 1
    digits = "".join("0 0 0\n" for _ in range(9))
    (tmp_path / "b.pcd").write_bytes(PCD % (b"1", b"9", b"ascii") + digits[:-1].encode())
    assert len(read_points(tmp_path / "b.pcd")) == 9


def test_archives_with_other_files_are_read(tmp_path):
    path, xyz = tmp_path / "a.npz", np.zeros((30_000, 3))
    for kind in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA):
        np.savez_compressed(path, xyz=xyz)
        with zipfile.ZipFile(path, "a", kind) as archive:
            archive.writestr("readme.txt", "hello")
            archive.mkdir("folder")
        assert len(read_points(path)) == len(xyz)
