"""The formats: what each is called, who reads and writes it, and what it can hold.

Everything that asks or says something of a format reads it here, documents by a test. A new format
is a record here and its reader.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from sklearn_mcmd._errors import ParameterError
from sklearn_mcmd.io import _arrays, _e57, _las, _ptx, _text
from sklearn_mcmd.io import _scan_formats as scans
from sklearn_mcmd.io._point_cloud import PointFileError

__all__ = [
    "ALL",
    "FORMATS",
    "INDEX",
    "SENSORS",
    "TILED",
    "TILED_NAMES",
    "WITH_COLUMNS",
    "format_of",
    "listed",
    "no_columns",
    "supported_extensions",
]

ALL = "all"
INDEX = ".vpc"  # a virtual point cloud, which stands for several files


class Format(NamedTuple):
    """One format. Of its `extensions`, in lower case, each belongs to no other."""

    name: str
    extensions: tuple[str, ...]
    extra: str | None  # that has its library
    kept: str  # of what files of it hold
    read: Callable[..., Any]
    write: Callable[..., Any] | None = None  # None: read only
    columns: bool = False  # whether those of x, y and z may be told
    encodings: tuple[str, ...] = ()
    marks: bool = False  # whether it has its own mark of outliers, which `write` takes as `noise`
    results: str = ALL  # that it holds, as verbs call theirs; "" is none
    tiles: bool = False  # whether clouds larger than memory are read and written in parts
    sensor: str = ""  # what tells where it stood


EVERYTHING, TEXT = "everything numeric", (_text.read_text, _text.write_text)
FORMATS = (
    Format("LAS and LAZ", (".las", ".laz"), "las",
           "everything but waveform samples of LAS 1.3; results become extra dimensions",
           _las.read_las, _las.write_las, marks=True, tiles=True, sensor="LAS's scan angles"),
    Format("COPC", (".copc.laz",), "las", "as LAZ; read only", _las.read_las, tiles=True),
    Format("PLY", (".ply",), "formats", "all fields of points; no faces",
           scans.read_ply, scans.write_ply, columns=True, encodings=("ascii", "binary")),
    Format("PCD", (".pcd",), "formats", "all fields of points, the grid, the viewpoint",
           scans.read_pcd, scans.write_pcd, columns=True, sensor="PCD's VIEWPOINT",
           encodings=("ascii", "binary", "binary_compressed")),
    Format("E57", (".e57",), "formats",
           "coordinates, intensity, colors, rows and columns; no results",
           _e57.read_e57, _e57.write_e57, results="", sensor="E57's poses"),
    Format("PTX", (".ptx",), None, "coordinates, intensity, colors, rows and columns; read only",
           _ptx.read_ptx, sensor="PTX's poses"),
    Format("PTS", (".pts",), None, "coordinates, intensity, colors; no results",
           *TEXT, columns=True, results=""),
    Format("XYZN", (".xyzn",), None, "coordinates and normals",
           *TEXT, columns=True, results="normals"),
    Format("XYZRGB", (".xyzrgb",), None, "coordinates and colors; no results",
           *TEXT, columns=True, results=""),
    Format("text", (".xyz", ".txt", ".csv", ".asc"), None, EVERYTHING, *TEXT, columns=True),
    Format("NPY", (".npy",), None, EVERYTHING, _arrays.read_npy, _arrays.write_npy, columns=True),
    Format("NPZ", (".npz",), None, EVERYTHING, _arrays.read_npz, _arrays.write_npz),
)  # fmt: skip
_BY_EXTENSION = {extension: one for one in FORMATS for extension in one.extensions}
# Extensions of clouds that may be larger than memory.
TILED = tuple(e for one in FORMATS if one.tiles and one.write for e in one.extensions)


def format_of(path, *, written=False):
    """The format of a file, by its extension; raise if it is `written` and can only be read."""
    suffixes = [suffix.lower() for suffix in Path(path).suffixes[-2:]] or [""]
    for extension in ("".join(suffixes), suffixes[-1]):
        if known := _BY_EXTENSION.get(extension):
            if written and not known.write:
                words = "can be read but not written; write another format, such as plain .laz"
                raise PointFileError(f"{known.name} {words}")
            return known
    found = f"unknown extension {suffixes[-1]!r}" if suffixes[-1] else "no extension"
    raise PointFileError(f"{found}; known are {' '.join(supported_extensions())}")


def supported_extensions(*, written: bool = False) -> tuple[str, ...]:
    """The known extensions, or those of files that are `written`, in alphabetical order."""
    return tuple(sorted(e for e, one in _BY_EXTENSION.items() if one.write or not written))


def listed(words, last="and"):
    """Words in a sentence, with commas and `last` before the last one."""
    *others, final = words
    return f"{', '.join(others)} {last} {final}" if others else final


TILED_NAMES = listed(one.name for one in FORMATS if one.tiles and one.write)
WITH_COLUMNS = listed(one.name for one in FORMATS if one.columns)
SENSORS = listed([one.sensor for one in FORMATS if one.sensor], "or")


def no_columns(columns):
    """The error where columns are told of a file that has no such columns."""
    return ParameterError(f"$columns is for {WITH_COLUMNS}", columns=columns)
