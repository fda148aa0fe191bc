"""Reading and writing by extension: dispatch, whole outputs, one-line errors."""

import errno
import os
import shutil
import warnings
from collections.abc import Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from sklearn_mcmd.io._classes import HIGH_NOISE, LOW_NOISE
from sklearn_mcmd.io._formats import ALL, format_of, no_columns
from sklearn_mcmd.io._no_returns import LEFT_OUT, NoReturns
from sklearn_mcmd.io._point_cloud import PointCloud, PointFileError
from sklearn_mcmd.io._units import degrees_warning


def read_points(
    path: str | os.PathLike[str], *, columns: Mapping[str, str | int] | None = None
) -> PointCloud:
    """Read a point cloud. The extension, in upper or lower case, chooses the format.

    Parameters
    ----------
    path : str or os.PathLike
        A file of one of the extensions that ``help(sklearn_mcmd.io)`` lists.
    columns : dict of str to str or int, default=None
        Which columns of PLY, PCD, PTS, XYZN, XYZRGB, text and NPY are x, y and z: their names, or
        their numbers from 1 on. None, and for what is not told, the names that people use, such as
        easting, northing and elevation.

    Returns
    -------
    PointCloud
        Coordinates as float64 of shape (n, 3), attributes under their names in the file,
        and the metadata that :func:`write_points` needs for a faithful copy.

    Raises
    ------
    PointFileError
        With a message of one line, if the file is missing, empty, damaged or of another format, if
        it holds no points, if no column is known as x, y or z or several may be one, if the first
        of a table without names seems to number or time its points, if a coordinate is no number,
        or if an optional library is not installed.

    Warns
    -----
    UserWarning
        If columns of words, or fields of other formats, are left out. If integers of text are
        rounded. If points are 0, 0, 0 where most coordinates are large, or many are: rays without a
        return. If x and y seem to be degrees, unlike z. If LAS holds more or fewer records than its
        header counts, or a rotation of E57 is not of length 1.

    See Also
    --------
    write_points : Writes a point cloud.
    numpy.loadtxt : For tables of numbers of other shapes.

    Notes
    -----
    Points with a coordinate that is not finite, or that E57 marks invalid, are dropped and counted
    in ``PointCloud.n_dropped``. So are rows of zeros, which scanners write for rays without a
    return: all of PTX, of other formats if there are more than 8, and more than rows with two
    coordinates 0. In E57 they are where the scanner stood.

    *Text* is read :ref:`however it is laid out <text_files>`. Without names of columns, coordinates
    are the first three. Integers are exact up to 64 bits. A count of points may stand above the
    rows, as in PTS, which has ``intensity`` after x, y, z, or colors, or both. XYZN has normals,
    XYZRGB colors, which are from 0 to 1 unless one is larger.

    *NPY* holds a table (n, >= 3), an organized one (rows, columns, >= 3), or a structured array of
    either shape. *NPZ* holds ``xyz``, or ``x``, ``y``, ``z``, organized or not; else its first
    array of shape (n, 3) is taken. Arrays of another length, such as an ``offset``, are not applied
    to the coordinates: they stay in ``metadata["npz_arrays"]``.

    Attributes have one name in all formats, such as ``normal_x`` and ``red, green, blue``.
    ``scan_index`` numbers the scans of a file. ``row_index`` and ``column_index`` tell the cell of
    a point in the grid of its scan, or of an organized PCD, NPY or NPZ of
    ``metadata["grid_shape"]`` rows and columns. Colors of E57 that are no bytes get 16 bits: the
    most that the file states becomes 65535. LAZ has no checksums: a changed bit may go unnoticed.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from sklearn_mcmd.io import read_points
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = Path(folder) / "wall.csv"
    ...     _ = file.write_text("x;y;z;label\\n0;0;1.5;2\\n1;0;1.5;2\\nnan;0;1.5;6\\n")
    ...     cloud = read_points(file)
    >>> cloud, cloud.n_dropped
    (PointCloud(2 points; label), 1)
    """
    path = Path(path)
    with one_clear_line(path, "read"):
        check_file(path)
        file_format = format_of(path)
        if columns is not None and not file_format.columns:
            error = no_columns(columns)
            raise PointFileError(str(error)) from error
        if not set(columns or ()) <= set("xyz"):
            raise PointFileError(f"columns={columns} must tell of x, y or z")
        read = file_format.read
        cloud = read(path) if columns is None else read(path, columns)
        no_returns, kept = NoReturns().add(cloud.xyz), np.isfinite(cloud.xyz, order="F").all(axis=1)
        warning = no_returns.warning(path)
        if no_returns.n_left_out:
            kept &= cloud.xyz.any(axis=1)
        if not kept.all():
            n_dropped = cloud.n_dropped + int(np.count_nonzero(~kept))
            cloud = cloud.subset(kept)
            cloud.n_dropped = n_dropped
            cloud.metadata[LEFT_OUT] = cloud.metadata.get(LEFT_OUT, 0) + no_returns.n_left_out
        if len(cloud) == 0:
            dropped = f" with finite coordinates ({cloud.n_dropped} dropped)"
            raise PointFileError("holds no points" + (dropped if cloud.n_dropped else ""))
    header = cloud.metadata.get("las_header")
    for words in (warning, degrees_warning(path, cloud.xyz, header, columns)):
        if words:
            warnings.warn(words, stacklevel=2)
    return cloud


def write_points(
    path: str | os.PathLike[str],
    cloud: "PointCloud | ArrayLike",
    *,
    noise: "ArrayLike | None" = None,
) -> None:
    """Write a point cloud. An existing file is replaced only by a complete new one beside it.

    Parameters
    ----------
    path : str or os.PathLike
        File to write; its extension chooses the format. It may be the file that was read.
    cloud : PointCloud or array-like of shape (n, 3)
        The cloud to write, with all points and all attributes.
    noise : array-like of bool or int of shape (n,), default=None
        Points to mark as outliers: by classification 7 (noise) in LAS and LAZ, where other
        points keep their class; elsewhere by a column ``outlier``. Integers tell low noise, 7, from
        high noise, 18, and other points, 0. Point formats 0 to 5 of LAS define no high noise: there
        it is 7, too.

    Raises
    ------
    PointFileError
        With a message of one line, if the file cannot be written, an attribute has a name or dtype
        that the format cannot hold, LAS has no room for far points at the precision of the others
        (they are named), LAZ would change wave packets, or an optional library is not installed. An
        existing file is then unchanged.
    ValueError
        If ``cloud`` or ``noise`` is not of the stated form.

    Warns
    -----
    UserWarning
        If an attribute cannot be kept, or not exactly. E57 holds finite intensity of single
        precision and colors of 8 bits only, PTS intensity and such colors, XYZN normals, and XYZRGB
        colors. PLY and PCD spell names in ASCII without blanks. In LAS, a value that does not fit
        the dimension of its name goes to an extra dimension ``<name>_value``.

    See Also
    --------
    read_points : Reads a point cloud.

    Notes
    -----
    *LAS, LAZ.* A cloud read from LAS keeps its header, and unchanged coordinates their integers.
    Others are rounded to half a step of the header's scale; an axis where they do not fit integers
    of 32 bits gets a new offset, and a new scale if needed. Other clouds become LAS 1.4, point
    format 6 (7 with colors). Colors of 8 bits, and integers up to 255 but uint16, are multiplied by
    257. Their scale is the coarsest of 1, 0.1 ... 1e-6 that holds all coordinates exactly, else the
    finest power of ten that fits. Far points that would make it coarser than the decimal step of
    most points (0.0001 or more), else than a millionth of the extent of their middle half, are
    refused. Attributes without a standard dimension become extra
    dimensions. LAS 1.0 and 1.1 become 1.2. LAZ with wave packets of several scanner channels
    (formats 9 and 10) is refused, since lazrs would change them. Samples of waveforms inside a
    file are copied from LAS 1.4, but not from LAS 1.3.

    *PLY, PCD.* Files are binary. Coordinates are float32 where that is exact, as viewers expect,
    else float64. Colors of LAS that were made of 8 bits have 8 bits again.

    *E57.* Coordinates are float64 about their median.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from sklearn_mcmd.io import read_points, write_points
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = Path(folder) / "corner.xyz"
    ...     write_points(file, [[0, 0, 0], [1, 0, 0], [0, 1, 9]], noise=[False, False, True])
    ...     print(file.read_text())
    x y z outlier
    0.0 0.0 0.0 0
    1.0 0.0 0.0 0
    0.0 1.0 9.0 1
    """
    path = Path(path)
    with one_clear_line(path, "written"):
        file_format = format_of(path, written=True)
    if not isinstance(cloud, PointCloud):
        cloud = PointCloud(cloud)
    if len(cloud) == 0:
        raise PointFileError(f"{path}: the cloud has no points, there is nothing to write")
    if not np.isfinite(cloud.xyz).all():
        raise PointFileError(f"{path}: xyz holds NaN or infinity; remove those points first")
    options = {}
    if noise is not None:
        noise = _mask(noise, len(cloud))
        if file_format.marks:
            options["noise"] = noise
        elif file_format.results != ALL:
            raise PointFileError(
                f"{path}: {file_format.name} has no place to mark outliers; write another format"
            )
        else:
            cloud = cloud.with_attributes(outlier=noise != 0)
    with replacing(path) as temporary, one_clear_line(path, "written"):
        file_format.write(temporary, cloud, **options)


def check_file(path):
    """Refuse what is no file, or has no bytes."""
    if not path.exists():
        raise PointFileError("no such file")
    if path.is_dir():
        raise PointFileError("is a folder; a point file is needed")
    if not path.is_file():
        raise PointFileError("is not a regular file")
    if path.stat().st_size == 0:
        raise PointFileError("is empty (0 bytes)")


def check_writable(path, folder=None):
    """The file behind a path, which links lead to; raise if it cannot be written in its folder."""
    target = Path(os.path.realpath(path))
    folder = target.parent if folder is None else folder
    with one_clear_line(path, "written"):
        if not folder.is_dir():
            raise PointFileError(f"the folder {folder} does not exist")
        if target.is_dir():
            raise PointFileError("is a folder; name a file in it")
        if target.exists() and not target.is_file():
            raise PointFileError("is not a regular file")
        if target.exists() and not os.access(target, os.W_OK):
            raise PointFileError("the file is write-protected")
    return target


def _mask(noise, n_points):
    noise = np.asarray(noise)
    if noise.dtype.kind not in "biu" or noise.shape != (n_points,):
        raise ValueError(
            f"noise must be a mask, or classes, ({n_points},), got {noise.dtype} of {noise.shape}."
        )
    if noise.dtype != bool and not np.isin(noise, (0, LOW_NOISE, HIGH_NOISE)).all():
        raise ValueError(
            f"noise must be 0, {LOW_NOISE} (low) or {HIGH_NOISE} (high), got {np.unique(noise)}."
        )
    return noise


@contextmanager
def replacing(path):
    """A temporary name beside ``path``; its file replaces ``path`` when the block succeeds.

    It is then on the disk, with its name.
    """
    target = check_writable(path)  # a link stays a link: the file behind it is replaced
    temporary = target.with_name(f".mcmd-{os.urandom(8).hex()}{target.suffix.lower()}")
    try:
        with one_clear_line(path, "written"):
            temporary.touch(exist_ok=False)
        with naming(path):
            yield temporary
        with one_clear_line(path, "written"):
            sync_file(temporary)
            if target.exists():
                shutil.copymode(target, temporary)
            os.replace(temporary, target)
            sync_names(target.parent)
    finally:
        with suppress(OSError):  # a disk that cannot be written to was reported above
            temporary.unlink()


def sync_file(path):
    """Wait until the bytes of a file are on the disk."""
    with open(path, "rb+") as file:
        os.fsync(file.fileno())


def sync_names(folder):
    """Wait until the names in a folder are on the disk."""
    with suppress(OSError):  # a system, or a disk, that has no call for it
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


@contextmanager
def naming(path, action="written"):
    """Name the file in the system's errors."""
    try:
        yield
    except OSError as err:
        raise system_error(path, action, err) from err


@contextmanager
def one_clear_line(path, action):
    """Turn any error into a PointFileError that begins with the file's name."""
    try:
        yield
    except (PointFileError, ImportError) as err:  # which says how to install what is missing
        words = " ".join(str(err).split())  # names in files may have several lines
        raise PointFileError(f"{path}: {words}") from err.__cause__
    except OSError as err:
        raise system_error(path, action, err) from err
    except MemoryError as err:
        raise PointFileError(f"{path}: cannot be {action}: not enough memory, or broken") from err
    except BaseException as err:
        is_panic = type(err).__name__ == "PanicException"  # of Rust, in lazrs: no Exception
        if not (is_panic or isinstance(err, Exception)):
            raise  # Ctrl-C and the like have nothing to do with the file
        hint = "" if action == "written" else "; it seems damaged or is of another format"
        raise PointFileError(f"{path}: cannot be {action}{hint}: {_first_line(err)}") from err


def system_error(path, action, err):
    """The PointFileError for an error of the operating system; it names the user's file."""
    reason = (err.strerror or _first_line(err)).lower()
    if err.errno in (errno.EACCES, errno.EPERM, errno.EROFS):
        reason += f"; check the permissions of {path.parent if action != 'read' else path}"
    return PointFileError(f"{path}: cannot be {action}: {reason}")


def _first_line(err):
    lines = [line.strip() for line in str(err).splitlines() if line.strip()]
    return lines[0][:200] if lines else type(err).__name__
