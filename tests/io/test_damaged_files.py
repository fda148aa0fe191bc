"""Files that are damaged, empty, or of another kind: one clear line."""

import os
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
    "title.csv": ("measured\n1,2,3\n", "header has 1 columns, line 2 has 3"),
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
    "rows.pcd": (POINTS + "1.000 2.000 3.000\n", "header promises 2 points, there are 1"),
    "one.pcd": ("VERSION 1.0\n" + POINTS + ROWS, "is PCD of version 1.0; .5, .6 and .7 are"),
    "type.pcd": (POINTS.replace("F F F", "F F Q") + ROWS, "broken PCD header: FIELDS x"),
    "size.pcd": (POINTS.replace("SIZE 4 4 4\n", "") + ROWS, "its header has no SIZE"),
    "empty.pcd": (POINTS.replace("2", "0"), "holds no points"),
}
SIGN = "with a decimal %s, as those above"
DOUBT = "line %d: are there thousands or decimals"
BAD_TEXTS |= {
    # names in a comment that hold no coordinates
    "shot.csv": ("# SHOT TIME LONGITUDE LATITUDE HEIGHT\n9 8 1 2 3\n", "no x, y among .* SHOT"),
    "ost.csv": ("// time ost nord hoch\n9 1 2 3\n", "no z among the columns time, ost, nord, hoch"),
    "id,.csv": ("#id,a,b,c\n9,1,2,3,\n", "no x, y, z among the columns id, a, b, c"),
    "today.csv": ("# a,b,c,d\n# scanned,by,hand,today\n3,2,1,4\n", "among the columns a, b, c, d"),
    # decimal signs that change, and thousands as in German
    "german.csv": ("1,5;2;3\n312.403;2;3", f"line 2: .* {SIGN % 'comma'}"),
    "english.csv": ("1.5;2;3\n4;5;6\n312,403;2;3", f"line 3: .* {SIGN % 'point'}"),
    "both.csv": ("452,345.6;2;3\n4;5;6,5", f"line 2: .* {SIGN % 'point'}"),
    "attribute.csv": ("1;2;3;0,5\n1.5;2;3;4", f"line 2: .* {SIGN % 'comma'}"),
    "blanks.csv": ("1,234 5,678 9,012\n234 5,678 1,012\n1,234 500 9,013", DOUBT % 1),
    "tab.csv": ("112,345  213,456\t100,123", DOUBT % 1),
    "quotes.csv": ('345;567;12\n1;"-567,890";12', DOUBT % 2),
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


# ---- what has room, or not ----------------------------------------------------------------


def test_an_e57_of_more_points_than_bits_is_refused(tmp_path, monkeypatch):
    path = tmp_path / "a.e57"
    write_points(path, np.eye(3))
    # Checksums and two counts would have to fit, so that the library is asked for another count.
    pye57 = pytest.importorskip("pye57")
    monkeypatch.setattr(pye57.scan_header.ScanHeader, "point_count", 10**9)
    refused(path, "1,000,000,000 points need 125,000,000 bytes")


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
    (tmp_path / "b.pcd").write_text(POINTS.replace("2", "9") + digits[:-1])
    assert len(read_points(tmp_path / "b.pcd")) == 9


def test_archives_with_other_files_are_read(tmp_path):
    path, xyz = tmp_path / "a.npz", np.zeros((30_000, 3))
    for kind in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA):
        np.savez_compressed(path, xyz=xyz)
        with zipfile.ZipFile(path, "a", kind) as archive:
            archive.writestr("readme.txt", "hello")
            archive.mkdir("folder")
        assert len(read_points(path)) == len(xyz)
