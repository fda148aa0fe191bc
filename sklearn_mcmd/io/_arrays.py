"""NPY and NPZ: NumPy's own files, without pickles."""

import io
import math
import zipfile
from types import SimpleNamespace

import numpy as np

from sklearn_mcmd.io._column_names import (
    attribute_name,
    check_first_columns,
    check_turned,
    coordinate_columns,
)
from sklearn_mcmd.io._point_cloud import PointCloud, PointFileError, check_room, with_cells

MAGIC = np.lib.format.MAGIC_PREFIX
FEW_LOOPED = 2**20  # numbers that take no time
LONGEST_HEADER = 2**14  # bytes of an array; NumPy reads none of more than 10,000 characters
# Bytes from one byte of a ZIP, of the methods that NumPy writes. Others pack a million into one.
FACTORS = {zipfile.ZIP_STORED: 1, zipfile.ZIP_DEFLATED: 1032}


def read_npy(path, columns=None):
    """Read a table (n, >=3), an organized one (rows, columns, >=3), or fields x, y, z."""
    _check_start(path, MAGIC, "NPY")
    with open(path, "rb") as file:
        _check_array(file, path.stat().st_size, "its numbers")
    array = np.load(path, allow_pickle=False)
    shape = array.shape[:2]
    if array.dtype.names is not None:
        records = array.reshape(-1) if array.ndim == 2 else array
        return with_cells(cloud_from_records(records, columns), shape)
    cloud = PointCloud(*_columns(array, columns))
    if columns is None and array.ndim == 2:
        check_first_columns(array, "row 0")
    return with_cells(cloud, shape)


def _columns(array, columns=None):
    """Coordinates of a table (n, >= 3) or (rows, columns, >= 3), and its other columns by names."""
    shape = array.shape
    # The last axis of a grid has x, y, z and little else: it is the shortest, if it is not clear.
    if array.ndim == 3 and (3 <= shape[2] <= 4 or 3 < shape[2] < min(shape[:2])):
        array = array.reshape(-1, shape[2])
    if array.ndim != 2 or array.shape[1] < 3 or array.dtype.kind not in "biuf":
        raise PointFileError(
            f"holds dtype {array.dtype} of shape {shape}; numbers of shape (n, 3) or (rows, "
            "columns, 3), or more at the end, or a structured array with x, y, z are needed"
        )
    check_turned(array.shape)
    names = [f"column_{i}" for i in range(1, array.shape[1] + 1)]
    axes = coordinate_columns(names, columns) if columns else [0, 1, 2]
    others = {name: array[:, i].copy() for i, name in enumerate(names) if i not in axes}
    xyz = array[:, axes] if columns else array[:, :3]  # without a copy, where it can be
    return np.ascontiguousarray(xyz, dtype=np.float64), others


def read_npz(path):
    """Read ``xyz``, or ``x``, ``y``, ``z``, organized or not, or the first array (n, 3)."""
    _check_start(path, b"PK", "NPZ")
    arrays = {}
    with zipfile.ZipFile(path) as archive:
        members = archive.infolist()
        check_room(sum(m.compress_size for m in members), path.stat().st_size, "its members")
        for member in members:
            name, array = member.filename.removesuffix(".npy"), _array_of(archive, member)
            if name in arrays:
                raise PointFileError(f"holds two arrays {name!r}; write it anew")
            if array is not None:
                arrays[name] = array
    tables = [n for n, a in arrays.items() if a.ndim == 2 and a.shape[1] == 3]
    if "xyz" in arrays:
        xyz = arrays.pop("xyz")
    elif {"x", "y", "z"} <= arrays.keys():
        xyz = np.stack([arrays.pop(axis) for axis in "xyz"], axis=-1)
    elif tables:
        xyz = arrays.pop(tables[0])
    else:
        for table in (a for a in arrays.values() if a.ndim == 2):
            check_turned(table.shape)
        shapes = ", ".join(f"{n} {a.shape}" for n, a in arrays.items()) or "nothing"
        raise PointFileError(
            f"needs an array xyz of shape (n, 3), or x, y, z; it holds {shapes[:300]}"
        )
    shape = xyz.shape[:2]
    is_grid, (xyz, columns) = xyz.ndim == 3, _columns(xyz)
    if is_grid:  # others of its shape with it
        grids = {name: a for name, a in arrays.items() if a.shape[:2] == shape}
        arrays |= {name: a.reshape(-1, *a.shape[2:]) for name, a in grids.items()}
    arrays = columns | arrays
    of_points = [name for name, a in arrays.items() if a.ndim in (1, 2) and len(a) == len(xyz)]
    for name in of_points:
        if (other := attribute_name(name)) != name and other in of_points:
            raise PointFileError(
                f"arrays {name!r} and {other!r} would both be {other!r}: rename one"
            )
    attributes = {attribute_name(name): arrays.pop(name) for name in of_points}
    return with_cells(PointCloud(xyz, attributes, {"npz_arrays": arrays} if arrays else {}), shape)


def write_npy(path, cloud):
    """Write a plain (n, 3) array, or a structured one if there are attributes."""
    array = cloud.xyz
    if cloud.attributes:
        fields: list[tuple] = [(axis, np.float64) for axis in "xyz"]
        fields += [(name, a.dtype, a.shape[1:]) for name, a in cloud.attributes.items()]
        arrays = [*cloud.xyz.T, *cloud.attributes.values()]
        array = np.rec.fromarrays(arrays, dtype=fields, shape=len(cloud))
    with open(path, "wb") as file:  # by Python, as NumPy does not name a full disk as the reason
        np.save(SimpleNamespace(write=file.write), array, allow_pickle=False)


def write_npz(path, cloud):
    """Write ``xyz``, every attribute and the source's other arrays, uncompressed."""
    arrays = {**cloud.metadata.get("npz_arrays", {}), **cloud.attributes}
    for name in arrays.keys() & {"file", "allow_pickle"}:
        raise PointFileError(f"attribute name {name!r} is reserved in NPZ; rename it")
    if any(a.dtype.hasobject for a in arrays.values()):
        raise PointFileError("attributes that hold Python objects cannot be stored in NPZ")
    np.savez(path, xyz=cloud.xyz, **arrays)


def _check_start(path, magic, format_name):
    """Check the first bytes. NumPy would take any other file as a pickle and advise to load it."""
    with open(path, "rb") as file:
        if file.read(len(magic)) != magic:
            raise PointFileError(f"is not a file in NumPy's format {format_name}")


def _array_of(archive, member):
    """The array of a member of an NPZ, None if it is something else, as a text."""
    factor = FACTORS.get(member.compress_type)
    if factor is None and member.filename.endswith(".npy"):
        raise PointFileError(
            f"{member.filename!r} is compressed as NumPy does not (ZIP method "
            f"{member.compress_type}), by which few bytes may hide gigabytes; use savez_compressed"
        )
    if factor is None:
        return None
    with archive.open(member) as file:
        if file.read(len(MAGIC)) != MAGIC:
            return None
        file.seek(0)
        room = min(member.file_size, factor * member.compress_size)
        _check_array(file, room, f"the numbers of {member.filename!r}")
        file.seek(0)
        return np.lib.format.read_array(file, allow_pickle=False)


def _check_array(file, room, what):
    """Check that the numbers a header tells of can be there; NumPy takes their memory first.

    Of none, each takes a byte all the same: there are loops over columns without rows.
    """
    file = io.BytesIO(file.read(LONGEST_HEADER))
    is_first = np.lib.format.read_magic(file) == (1, 0)
    readers = np.lib.format.read_array_header_1_0, np.lib.format.read_array_header_2_0
    shape, _, dtype = readers[0 if is_first else 1](file)
    if dtype.hasobject:
        raise PointFileError("holds pickled objects, which are never loaded; write numbers")
    check_room(math.prod(shape) * dtype.itemsize, room, what)
    check_room(_n_looped(shape, dtype), max(room, FEW_LOOPED), what)


def _n_looped(shape, dtype):
    """Numbers of an array, as if axes of length 0 had length 1."""
    base, inner = dtype.subdtype or (dtype, ())
    n_fields = sum(_n_looped((), base[name]) for name in base.names or ())
    return math.prod(n or 1 for n in (*shape, *inner)) * max(n_fields, 1)


def cloud_from_records(records, columns=None, **kwargs):
    """A cloud from a structured array; `columns` is as of `coordinate_columns`."""
    names = list(records.dtype.names)
    axes = [names[i] for i in coordinate_columns(names, columns)]
    xyz = np.column_stack([np.asarray(records[axis], dtype=np.float64) for axis in axes])
    # Copies, so that the records and a memory map of the file can be freed.
    others = [name for name in names if name not in axes]
    attributes = {attribute_name(name): records[name].copy() for name in others}
    return PointCloud(xyz, attributes, **kwargs)
