"""A catalog: what one or many point files hold, from their headers alone."""

import os
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from sklearn_mcmd.io import PointFileError
from sklearn_mcmd.io._files import one_clear_line
from sklearn_mcmd.io._las import coordinate_system, read_header
from sklearn_mcmd.io._laz import WAVE_PACKET_FORMATS

__all__ = ["EXTENSIONS", "Catalog", "stamp_of"]

EXTENSIONS = (".las", ".laz")
PROJECTION = "LASF_Projection"  # of the records that tell the coordinate system


class Catalog:
    """One or many LAS, LAZ or COPC files as one cloud; no points are read.

    Parameters
    ----------
    source : str, os.PathLike or an iterable of these
        Files, or a folder, of which the files ``.las`` and ``.laz`` are taken in the order of
        their names. Folders in it are not searched.

    Attributes
    ----------
    paths : list of Path
    counts : list of int
        Points of each file.
    record_sizes : list of int
        Bytes of each point of a file, when it is not compressed.
    low, high : ndarray of shape (3,)
        Bounds as the headers state them. They may be wrong, and nothing depends on them.
    crs : str or None
        Name or EPSG code of the coordinate system.
    stamps : list of tuple
        Size and time of each file, which tell whether it has changed.

    Raises
    ------
    PointFileError
        With a message of one line, if there are no files, if a file is missing, empty, truncated,
        not LAS or without points, if two files have the same name, if files are in different
        coordinate systems, or if a LAZ has wave packets.

    See Also
    --------
    write_normals : Normals of all points of a catalog.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from sklearn_mcmd.io import write_points
    >>> from sklearn_mcmd.tiling import Catalog
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     for name in ("a.las", "b.las"):
    ...         write_points(Path(folder) / name, [[0, 0, 0], [1, 2, 3]])
    ...     Catalog(folder)
    Catalog(2 files, 4 points)
    """

    def __init__(self, source: str | os.PathLike[str] | Iterable[str | os.PathLike[str]]) -> None:
        self.paths = _paths(source)
        headers, self.stamps = [], []
        for path in self.paths:
            with one_clear_line(path, "read"):
                headers.append(_checked_header(path))
                self.stamps.append(stamp_of(path))
        self.counts = [int(header.point_count) for header in headers]
        self.record_sizes = [int(header.point_format.size) for header in headers]
        self.low = np.min([header.mins for header in headers], axis=0)
        self.high = np.max([header.maxs for header in headers], axis=0)
        self.crs = coordinate_system(headers[0])
        for path, header in zip(self.paths[1:], headers[1:], strict=True):
            if _projection(header) != _projection(headers[0]):
                first, other = (coordinate_system(h) or "no system" for h in (headers[0], header))
                raise PointFileError(
                    f"{path}: its coordinate system ({other}) is not that of {self.paths[0]} "
                    f"({first}); transform one of them, or give them one by one"
                )

    @property
    def n_points(self) -> int:
        """Points of all files."""
        return sum(self.counts)

    def __len__(self) -> int:
        return len(self.paths)

    def __repr__(self) -> str:
        files = "1 file" if len(self) == 1 else f"{len(self)} files"
        return f"Catalog({files}, {self.n_points:,} points)"


def stamp_of(path):
    """What changes when a file does: its size in bytes, and its time in nanoseconds."""
    status = path.stat()
    return status.st_size, status.st_mtime_ns


def _paths(source):
    if not isinstance(source, str | os.PathLike):
        paths = [Path(path) for path in source]
    elif (folder := Path(source)).is_dir():
        paths = sorted(p for p in folder.iterdir() if p.suffix.lower() in EXTENSIONS)
        if not paths:
            raise PointFileError(f"{folder}: is a folder without .las or .laz files")
    else:
        paths = [Path(source)]
    if not paths:
        raise PointFileError("no files were given")
    names = [path.name for path in paths]
    for path in paths:
        if names.count(path.name) > 1:
            raise PointFileError(f"{path}: several files have this name, and so would the outputs")
    return paths


def _checked_header(path):
    if path.suffix.lower() not in EXTENSIONS:
        raise PointFileError("clouds of several files, or beyond memory, must be LAS or LAZ")
    if not path.exists():
        raise PointFileError("no such file")
    if not path.is_file():
        raise PointFileError("is not a regular file")
    if path.stat().st_size == 0:
        raise PointFileError("is empty (0 bytes)")
    header = read_header(path)
    if header.point_count == 0:
        raise PointFileError("holds no points")
    if not (np.isfinite([header.scales, header.offsets]).all() and np.all(header.scales)):
        raise PointFileError("broken header: scales and offsets must be numbers, and scales not 0")
    if header.point_format.id in WAVE_PACKET_FORMATS:
        raise PointFileError(
            f"point format {header.point_format.id} with wave packets is read in one piece only; "
            "give it more --memory"
        )
    return header


def _projection(header):
    """The records of the coordinate system, as they are in the file."""
    records = [*header.vlrs, *(header.evlrs or [])]
    return sorted(
        (record.record_id, bytes(record.record_data_bytes()))
        for record in records
        if record.user_id.rstrip("\0") == PROJECTION
    )
