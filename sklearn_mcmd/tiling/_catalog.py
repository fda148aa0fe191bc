"""A catalog: what one or many point files hold, from their headers."""

import hashlib
import json
import os
from collections.abc import Iterable
from pathlib import Path
from urllib.parse import unquote, urlsplit
from urllib.request import url2pathname

import numpy as np

from sklearn_mcmd._errors import counted, warn_caller
from sklearn_mcmd.io import PointFileError
from sklearn_mcmd.io._files import check_file, one_clear_line
from sklearn_mcmd.io._formats import INDEX, TILED, listed
from sklearn_mcmd.io._las import coordinate_system, read_header
from sklearn_mcmd.io._las_parts import no_returns_of, read_parts
from sklearn_mcmd.io._units import degrees_warning
from sklearn_mcmd.tiling._memory import PART

END = 2**16  # bytes at both ends of a file, which its stamp has a hash of
PROJECTION = "LASF_Projection"  # of the records of the coordinate system


class Catalog:
    """One or many LAS, LAZ or COPC files as one cloud.

    Points are read only where their bounds hold 0, 0, 0, to count rays without a return.

    Parameters
    ----------
    source : str, os.PathLike or an iterable of these
        Files, or a folder, of which the files ``.las`` and ``.laz`` are taken in the order of
        their names. Hidden files and folders in it are left out. Or an index ``.vpc`` of files (a
        virtual point cloud, as QGIS and PDAL's wrench make it), which are taken in its order.

    Attributes
    ----------
    paths : list of Path
    is_many : bool
        Whether it is a folder, an index or several files.
    counts : list of int
        Points of each file, without rays that have no return.
    record_sizes : list of int
        Bytes of each point of a file, when it is not compressed.
    low, high : ndarray of shape (3,)
        Bounds as the headers state them. They may be wrong, and nothing depends on them.
    crs : str or None
        Name or EPSG code of the coordinate system.
    stamps : list of tuple
        Size, time and a hash of the ends of each file, which tell whether it has changed.

    Raises
    ------
    PointFileError
        With a message of one line, if there are no files, if a file is missing, empty, truncated,
        not LAS or without points, or if files are in different coordinate systems.

    See Also
    --------
    process_files : What an estimator finds in the files of a catalog.

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
        self.paths = paths_of(source)
        one = [Path(source)] if isinstance(source, str | os.PathLike) else self.paths[:1]
        self.is_many = self.paths != one
        headers, self.stamps = [], []
        for path in self.paths:
            with one_clear_line(path, "read"):
                if path.suffix.lower() not in TILED:
                    raise PointFileError("several files, or one beyond memory, must be LAS or LAZ")
                check_file(path)
                headers.append(read_header(path))
                if headers[-1].point_count == 0:
                    remedy = "; leave it out" if len(self.paths) > 1 else ""
                    raise PointFileError(f"holds no points{remedy}")
                self.stamps.append(stamp_of(path))
        left_out = [no_returns_of(path).n_left_out for path in self.paths]
        self.counts = [int(h.point_count) - n for h, n in zip(headers, left_out, strict=True)]
        self.record_sizes = [int(header.point_format.size) for header in headers]
        self.low = np.min([header.mins for header in headers], axis=0)
        self.high = np.max([header.maxs for header in headers], axis=0)
        self.crs = coordinate_system(headers[0])
        if degrees := degrees_warning(self.paths[0], np.array([self.low, self.high]), headers[0]):
            warn_caller(degrees)
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
        return f"Catalog({counted(len(self), 'file')}, {counted(self.n_points, 'point')})"


def stamp_of(path):
    """What changes when a file does: its size in bytes, its time in nanoseconds, and a hash of its
    ends, which hold the header."""
    status = path.stat()
    with open(path, "rb") as file:
        digest = hashlib.sha256(file.read(END))
        file.seek(max(0, status.st_size - END))
        digest.update(file.read(END))
    return status.st_size, status.st_mtime_ns, digest.hexdigest()


def check_unchanged(path, stamp):
    """Raise if a file is not as it was when its stamp was taken."""
    with one_clear_line(path, "read"):
        if stamp_of(path) != stamp:
            raise PointFileError("has changed since it was read")


def parts_of(paths, choice=None):
    """Parts of files in order: path, cloud, and which of its points are chosen."""
    for path in paths:
        for cloud in read_parts(path, PART):
            with one_clear_line(path, "read"):
                mask = None if choice is None else choice.of(cloud)
            yield path, cloud, slice(None) if mask is None else mask


def paths_of(source, extensions=TILED):
    """The files that a source stands for: of a folder, those with one of the extensions."""
    if not isinstance(source, str | os.PathLike):
        paths = [Path(path) for path in source]
    elif (folder := Path(source)).is_dir():
        paths = sorted(p for p in folder.iterdir() if p.suffix.lower() in extensions)
        paths = [p for p in paths if not p.name.startswith(".")]  # of others, or left over
        if not paths:
            kinds = "point" if extensions != TILED else listed(TILED, "or")
            raise PointFileError(f"{folder}: is a folder without {kinds} files")
    elif Path(source).suffix.lower() == INDEX:
        with one_clear_line(source, "read"):
            paths = _indexed(Path(source))
    else:
        paths = [Path(source)]
    if not paths:
        raise PointFileError("no files were given")
    return paths


def _indexed(index):
    """The files of a virtual point cloud: a collection of features with assets."""
    check_file(index)
    try:
        features = json.loads(index.read_text(encoding="utf-8"))["features"]
        links = [_link_to_data(feature["assets"]) for feature in features]
    except (ValueError, LookupError, TypeError, AttributeError) as err:
        raise PointFileError("is not an index of a virtual point cloud") from err
    if not links:
        raise PointFileError("is an index without files")
    return [_place(index, link) for link in links]


def _link_to_data(assets):
    """The link of the points themselves, else the first; there may be overviews and the like."""
    data = [a for key, a in assets.items() if key == "data" or "data" in a.get("roles", ())]
    return str([*data, *assets.values()][0]["href"])


def _place(index, link):
    """The path of a link, which may be relative to the index."""
    parts = urlsplit(link)
    if parts.scheme == "file":
        return Path(url2pathname(parts.path))
    if parts.netloc:
        raise PointFileError(f"its file {link} is not on this machine; download it")
    paths = [index.parent / link, index.parent / unquote(link)]
    return next((path for path in paths if path.exists()), paths[0])


def _projection(header):
    """The records of the coordinate system, as they are in the file."""
    records = [*header.vlrs, *(header.evlrs or [])]
    return sorted(
        (record.record_id, bytes(record.record_data_bytes()))
        for record in records
        if record.user_id.rstrip("\0") == PROJECTION
    )
