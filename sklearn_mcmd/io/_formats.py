"""The formats: what each is called, who reads and writes it, and what it can hold.

Everything that asks or says something of a format reads it here, documents by a test. A new format
is a record here and its reader.
"""

from collections.abc import Callable
from functools import partial
from inspect import signature
from pathlib import Path
from typing import Any, NamedTuple

from sklearn_mcmd._errors import ParameterError
from sklearn_mcmd.io import _arrays, _e57, _las, _ptx, _text
from sklearn_mcmd.io import _scan_formats as scans
from sklearn_mcmd.io._point_cloud import PointFileError

ALL, EVERYTHING = "all", "everything numeric"  # results that a format holds; all it holds
INDEX = ".vpc"  # a virtual point cloud, which stands for several files


class Format(NamedTuple):
    """One format. Of its `extensions`, in lower case, each belongs to no other."""

    name: str
    extensions: tuple[str, ...]
    kept: str  # of what files of it hold
    read: Callable[..., Any]
    write: Callable[..., Any] | None = None  # None: read only
    extra: str | None = None  # that has its library
    results: str = ALL  # that it holds, as verbs call theirs; "" is none
    tiles: bool = False  # whether clouds larger than memory are read and written in parts
    sensor: str = ""  # what tells where it stood

    @property
    def columns(self):
        """Whether those of x, y and z may be given: its reader takes them."""
        return "columns" in signature(self.read).parameters

    @property
    def marks(self):
        """Whether it has its own mark of outliers: its writer takes them as `noise`."""
        return self.write is not None and "noise" in signature(self.write).parameters


las = partial(Format, read=_las.read_las, extra="las", tiles=True)
text = partial(Format, read=_text.read_text, write=_text.write_text)
FORMATS = (
    las(
        name="LAS and LAZ",
        extensions=(".las", ".laz"),
        kept="everything but waveform samples of LAS 1.3; results become extra dimensions",
        write=_las.write_las,
    ),
    las("COPC", (".copc.laz",), "as LAZ; read only"),
    Format(
        name="PLY",
        extensions=(".ply",),
        kept="all fields of points; no faces",
        read=scans.read_ply,
        write=scans.write_ply,
        extra="formats",
    ),
    Format(
        name="PCD",
        extensions=(".pcd",),
        kept="all fields of points, rows and columns, the viewpoint",
        read=scans.read_pcd,
        write=scans.write_pcd,
        extra="formats",
        sensor="PCD's VIEWPOINT",
    ),
    Format(
        name="E57",
        extensions=(".e57",),
        kept="coordinates, intensity, colors, rows and columns; no results",
        read=_e57.read_e57,
        write=_e57.write_e57,
        extra="formats",
        results="",
        sensor="E57's poses",
    ),
    Format(
        name="PTX",
        extensions=(".ptx",),
        kept="coordinates, intensity, colors, rows and columns; read only",
        read=_ptx.read_ptx,
        sensor="PTX's poses",
    ),
    text("PTS", (".pts",), "coordinates, intensity, colors; no results", results=""),
    text("XYZN", (".xyzn",), "coordinates and normals", results="normals"),
    text("XYZRGB", (".xyzrgb",), "coordinates and colors; no results", results=""),
    text("text", (".xyz", ".txt", ".csv", ".asc"), EVERYTHING),
    Format("NPY", (".npy",), EVERYTHING, _arrays.read_npy, write=_arrays.write_npy),
    Format("NPZ", (".npz",), EVERYTHING, _arrays.read_npz, write=_arrays.write_npz),
)
_BY_EXTENSION = {extension: one for one in FORMATS for extension in one.extensions}
# Extensions of clouds that may be larger than memory.
TILED = tuple(e for one in FORMATS if one.tiles and one.write for e in one.extensions)


def format_of(path, *, written=False):
    """The format of a file, by its extension; raise if it is `written` and can only be read."""
    suffixes = [suffix.lower() for suffix in Path(path).suffixes[-2:]] or [""]
    for extension in ("".join(suffixes), suffixes[-1]):
        if file_format := _BY_EXTENSION.get(extension):
            if written and not file_format.write:
                words = "can be read but not written; write another format, such as plain .laz"
                raise PointFileError(f"{file_format.name} {words}")
            return file_format
    reason = f"unknown extension {suffixes[-1]!r}" if suffixes[-1] else "no extension"
    raise PointFileError(f"{reason}; known are {' '.join(supported_extensions())}")


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
