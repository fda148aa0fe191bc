"""The point cloud that readers return and writers take, and the one error of both."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import prod
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sklearn_mcmd._errors import warn_caller

RESERVED = {"x", "y", "z", "xyz"}  # which attributes cannot be called
COLORS = ("red", "green", "blue")  # names of the attributes of a color
SETUPS = "sensor_origins"  # in the metadata: (n_scans, 3), NaN where a scan tells none
CELL = ("row_index", "column_index")  # of a point in the grid of an organized cloud or a scan
SHAPE = "grid_shape"  # of an organized cloud, in its metadata: rows and columns


class PointFileError(ValueError):
    """A point file cannot be read or written; the message is one line that says why.

    An error of an underlying library is its ``__cause__``.
    """


@dataclass(eq=False, repr=False)
class PointCloud:
    """Coordinates, attributes of each point, and metadata of the file.

    Parameters
    ----------
    xyz : array-like of shape (n, 3)
        Coordinates in the units of the file, kept as float64.
    attributes : dict of str to ndarray of shape (n,) or (n, m), default={}
        Other values of each point: ``intensity``, ``classification``, ``normal_x``, results to
        be written. The names ``x``, ``y``, ``z`` and ``xyz`` are reserved for the coordinates.
    metadata : dict, default={}
        Data for a faithful copy of the source file: ``las_header`` and ``las_points``
        (the raw records, so that integer coordinates are kept), ``ply_comments``,
        ``ply_obj_info``, ``pcd_viewpoint``, ``grid_shape`` (rows, columns), ``npz_arrays``. Also
        ``denoised``, whether outliers were removed, which LAS, LAZ and PLY tell, and where the
        scanner of each scan of E57 or PTX stood, ``sensor_origins``, NaN where that is not known.
    n_dropped : int, default=0
        Number of points of the file that were left out, because a coordinate was not finite,
        or the file says that there is no point. ``metadata["n_no_returns"]`` of them were warned of
        as rows of zeros.

    Raises
    ------
    ValueError
        If ``xyz`` is not numeric of shape (n, 3), or an attribute's length is not n.

    See Also
    --------
    sklearn_mcmd.io.read_points : Read one from a file.
    sklearn_mcmd.io.write_points : Write one to a file.

    Examples
    --------
    >>> from sklearn_mcmd.io import PointCloud
    >>> cloud = PointCloud([[0, 0, 0], [1, 0, 0], [0, 1, 9]])
    >>> cloud = cloud.with_attributes(outlier=[False, False, True])
    >>> cloud.subset(~cloud.attributes["outlier"])
    PointCloud(2 points; outlier)
    """

    xyz: NDArray[np.float64]
    attributes: dict[str, NDArray[Any]] = field(default_factory=dict)
    metadata: dict[str, Any] = field(default_factory=dict)
    n_dropped: int = 0

    if TYPE_CHECKING:  # arguments may be array-like; fields are arrays

        def __init__(
            self,
            xyz: "ArrayLike",
            attributes: "Mapping[str, ArrayLike]" = ...,
            metadata: Mapping[str, Any] = ...,
            n_dropped: int = 0,
        ) -> None: ...

    def __post_init__(self) -> None:
        xyz = np.asarray(self.xyz)
        if xyz.ndim != 2 or xyz.shape[1] != 3 or xyz.dtype.kind not in "biuf":
            raise ValueError(f"xyz must be numbers (n, 3), got {xyz.dtype} of {xyz.shape}.")
        self.xyz = xyz.astype(np.float64, copy=False)
        self.attributes = {
            str(name): np.asarray(values) for name, values in self.attributes.items()
        }
        for name, values in self.attributes.items():
            if name.lower() in RESERVED:
                raise ValueError(f"Attribute name {name!r} is for coordinates: choose another.")
            if values.ndim not in (1, 2) or len(values) != len(xyz):
                raise ValueError(
                    f"Attribute {name!r} of shape {values.shape} needs {len(xyz)} entries."
                )

    def __len__(self) -> int:
        return len(self.xyz)

    def __repr__(self) -> str:
        names = f"; {', '.join(self.attributes)}" if self.attributes else ""
        return f"PointCloud({len(self)} point{'s' * (len(self) != 1)}{names})"

    def subset(self, selection: NDArray[np.bool_] | NDArray[np.integer] | slice) -> "PointCloud":
        """The chosen points with their attributes and the file's metadata.

        Parameters
        ----------
        selection : ndarray of bool of shape (n,), ndarray of int, or slice
            A mask, or the positions to keep.

        Returns
        -------
        PointCloud
            A new cloud; arrays are copies unless ``selection`` is a slice.
        """
        if not isinstance(selection, slice):
            selection = np.asarray(selection)
            if selection.size == 0 and selection.dtype != bool:
                selection = selection.astype(np.intp)
            if selection.dtype == bool and selection.shape != (len(self),):
                raise ValueError(f"The mask must have shape ({len(self)},), got {selection.shape}.")
        metadata = dict(self.metadata)
        if "las_points" in metadata:
            metadata["las_points"] = metadata["las_points"][selection]
        attributes = {name: values[selection] for name, values in self.attributes.items()}
        return PointCloud(self.xyz[selection], attributes, metadata, self.n_dropped)

    def with_attributes(self, **arrays: "ArrayLike") -> "PointCloud":
        """The same points with attributes added or replaced.

        Parameters
        ----------
        **arrays : array-like of shape (n,) or (n, m)
            Name and values. ``normals`` of shape (n, 3) is written as ``normal_x``,
            ``normal_y``, ``normal_z``; any other table as ``name_0``, ``name_1`` ...

        Returns
        -------
        PointCloud
            A new cloud that shares the unchanged arrays with this one.
        """
        return PointCloud(
            self.xyz, {**self.attributes, **arrays}, dict(self.metadata), self.n_dropped
        )


def check_room(needed, room, what):
    """Refuse counts that the bytes of a file cannot hold: libraries would request their memory."""
    if needed > room:
        raise PointFileError(f"damaged: {what} need {needed:,} bytes, there are {room:,}")


def flat_columns(attributes):
    """Attributes as one-dimensional columns, for formats that hold no others."""
    columns = {}
    for name, values in attributes.items():
        if values.ndim == 1:
            parts = {name: values}
        elif name == "normals" and values.shape[1] == 3:
            parts = {f"normal_{axis}": values[:, i] for i, axis in enumerate("xyz")}
        else:
            parts = {f"{name}_{i}": values[:, i] for i in range(values.shape[1])}
        for part, column in parts.items():
            if part in columns or (part != name and part in attributes):
                raise PointFileError(f"two attributes would both be written as {part!r}")
            columns[part] = column
    return columns


def colors_of_bytes(columns):
    """Columns with colors of 16 bits as 8, and whether that rounds them."""
    if not all(c in columns and columns[c].dtype == np.uint16 for c in COLORS):
        return columns, False
    colors = np.array([columns[c] for c in COLORS])
    deep = colors.max() > 255
    whole = (colors >> (8 if deep else 0)).astype(np.uint8)
    rounded = deep and not made_of_bytes(colors)
    return columns | dict(zip(COLORS, whole, strict=True)), rounded


def made_of_bytes(colors):
    """Whether colors of 16 bits were made of 8, which then hold them."""
    low = colors & 255
    return not low.any() or (low == colors >> 8).all()


def joined(clouds, called="clouds"):
    """One cloud of several, with the attributes that all of them have; others are warned of."""
    shapes = [{name: a.shape[1:] for name, a in cloud.attributes.items()} for cloud in clouds]
    shared = [n for n, shape in shapes[0].items() if all(s.get(n) == shape for s in shapes)]
    if lost := sorted(set().union(*shapes) - set(shared)):
        warn_caller(f"attributes that not all {called} have are left out: {', '.join(lost)}")
    return PointCloud(
        np.concatenate([cloud.xyz for cloud in clouds]),
        {name: np.concatenate([cloud.attributes[name] for cloud in clouds]) for name in shared},
    )


def joined_scans(scans, setups, n_points):
    """One cloud of scans, by their numbers, of the points that a file holds, valid or not.

    `setups` tells where the scanner of each stood. Colors of 8 bits get 16 if others have them.
    """
    if not scans:
        return PointCloud(np.empty((0, 3)), n_dropped=n_points)
    if len(scans) == 1:
        ((number, cloud),) = scans.items()
        setups = [setups[number]]
    else:
        for number, scan in scans.items():
            scan.attributes["scan_index"] = np.full(len(scan), number, np.int32)
        colors = [(c.attributes, n) for c in scans.values() for n in COLORS if n in c.attributes]
        if any(attributes[name].dtype == np.uint16 for attributes, name in colors):
            for attributes, name in colors:
                if attributes[name].dtype == np.uint8:
                    attributes[name] = attributes[name] * np.uint16(257)
        cloud = joined([*scans.values()], "scans")
    cloud.metadata[SETUPS] = np.array(setups)
    cloud.n_dropped = n_points - len(cloud)
    return cloud


def warn_of_lost(holds, lost, rounded):
    """Warn of columns that a format cannot hold, or not exactly; `holds` tells what it can."""
    ways = {"not written": lost, "rounded": [name for name in rounded if name not in lost]}
    words = [f"; {way}: {', '.join(names)}" for way, names in ways.items() if names]
    if words:
        warn_caller(f"{holds} only{''.join(words)}")


def with_results(cloud, results):
    """The cloud with results, which replace input attributes written under the same names."""
    replaced = [
        name
        for name, values in cloud.attributes.items()
        if name not in results and not flat_columns({name: values}).keys().isdisjoint(results)
    ]
    if replaced:
        warn_caller(f"the results replace what the input calls {', '.join(replaced)}")
    kept = {name: values for name, values in cloud.attributes.items() if name not in replaced}
    return PointCloud(cloud.xyz, {**kept, **results}, dict(cloud.metadata), cloud.n_dropped)


def without_outliers(cloud, kept):
    """The points that are kept, marked as denoised."""
    left = cloud.subset(kept)
    left.metadata["denoised"] = True
    return left


def denoised_before(path):
    """What to say where a file is to be denoised that was before."""
    return (
        f"{path}: outliers were removed from it before; without them others stand alone, so that "
        "more goes each time: denoise the original instead"
    )


def fit_dtype(name, values, allowed, format_name):
    """``values`` in the first dtype of the format that holds them exactly."""
    kind = values.dtype.kind
    whole = ["i4", "u4", "f8", "f4", "u2", "u1"]
    wider = {"b": ["u1"], "i": whole, "u": whole, "f": ["f4", "f8"]}
    for code in [values.dtype.str[1:], *wider.get(kind, [])]:
        if code in allowed and kind in wider:
            with np.errstate(over="ignore", invalid="ignore"):
                cast = values.astype(code, copy=False)
                back = cast.astype(values.dtype, copy=False)
            if np.array_equal(back, values, equal_nan=kind == "f"):
                return cast
    raise PointFileError(
        f"attribute {name!r} of dtype {values.dtype} cannot be stored in {format_name}; convert it"
    )


def with_cells(cloud, shape):
    """The cloud of all cells row by row, where it is a grid of this shape and not of one row."""
    is_grid = len(shape) == 2 and min(shape) > 1 and prod(shape) == len(cloud)
    if is_grid and cloud.attributes.keys().isdisjoint(CELL):
        cells = np.divmod(np.arange(len(cloud), dtype=np.int32), np.int32(shape[1]))
        cloud.attributes |= zip(CELL, cells, strict=True)
        cloud.metadata[SHAPE] = tuple(shape)
    return cloud
