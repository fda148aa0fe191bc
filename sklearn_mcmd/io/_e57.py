"""E57 by pye57: scans, moved by their poses, and colors."""

import os
import re
import struct
from types import FunctionType, SimpleNamespace
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np

from sklearn_mcmd._errors import warn_caller
from sklearn_mcmd._extras import import_extra
from sklearn_mcmd.io._las_structure import check_grid
from sklearn_mcmd.io._no_returns import LEFT_OUT, NoReturns
from sklearn_mcmd.io._point_cloud import (
    CELL,
    COLORS,
    SETUPS,
    PointCloud,
    PointFileError,
    check_room,
    colors_of_bytes,
    fit_dtype,
    flat_columns,
    joined_scans,
    warn_of_lost,
)

MERGED = "cloud without setup"  # name of a scan whose pose is no place of a scanner
E57_FIELDS = {  # of our attributes: the name in E57, and the dtype that is written
    "intensity": ("intensity", "f4"),
    "red": ("colorRed", "u1"),
    "green": ("colorGreen", "u1"),
    "blue": ("colorBlue", "u1"),
    "row_index": ("rowIndex", "u2"),
    "column_index": ("columnIndex", "u2"),
}
COLOR_FIELDS = [E57_FIELDS[color][0] for color in COLORS]
PAGE, CHECKSUM = 1024, 4  # bytes
ANY = "{*}"  # of the spaces of names
# What names another place: libe57 would ask the network for schemas, and other readers for others.
ELSEWHERE = re.compile(rb"(?i)schemaLocation|<!DOCTYPE|XInclude|xml-stylesheet")
DEEPEST = 100  # elements in one another; E57 has nine
# Pairs of elements that libe57 compares in some seconds; 30,000 scans of 100 elements have as many.
MOST_COMPARED = 50_000_000


class PoseLimits(NamedTuple):
    """Which poses of scans are taken as they are."""

    unit: float = 1e-3  # of a rotation's length, what differs from 1
    farthest: float = 1e9  # meters of a translation


def read_e57(path):
    """Read all scans of an E57 file, each moved by its pose, as one cloud."""
    pye57 = import_extra("pye57", "formats", "E57")
    scans = _checked_scans(path)
    readable = set(pye57.e57.SUPPORTED_POINT_FIELDS)
    clouds, setups, skipped, n_points, n_told = {}, [], set(), 0, 0
    with pye57.E57(os.fsencode(path)) as file:
        for i in range(file.scan_count):
            header = file.get_header(i)
            n_points += header.point_count
            check_room(n_points // 8, path.stat().st_size, f"{n_points:,} points")
            rotation, translation = _pose(path, i + 1, scans[i])
            setups.append(_setup(header, translation))
            skipped |= set(header.point_fields) - readable
            if not header.point_count:
                continue
            xyz, attributes = _scan(pye57, file, header)
            no_returns = NoReturns().add(xyz)  # in the frame of the scan
            if no_returns.n_left_out:
                n_told += no_returns.n_left_out
                warn_caller(no_returns.warning(f"{path}, scan {i + 1}"))
                kept = xyz.any(axis=1)
                xyz, attributes = xyz[kept], {name: a[kept] for name, a in attributes.items()}
            if header.has_pose():
                xyz = file.to_global(xyz, rotation, translation)
            clouds[i] = PointCloud(xyz, attributes)
    if skipped:
        warn_caller(f"{path}: pye57 cannot read fields {', '.join(sorted(skipped))}")
    cloud = joined_scans(clouds, setups, n_points)
    cloud.metadata[LEFT_OUT] = n_told
    return cloud


def _checked_scans(path):
    """The scans in the XML, and no XML by which libe57 would end the process, or read wrongly."""
    with open(path, "rb") as file:
        if (start := file.read(48))[:8] != b"ASTM-E57" or len(start) < 48:
            raise PointFileError("damaged or is of another format: it does not begin as E57 does")
        at, length = struct.unpack_from("<QQ", start, 24)
        check_room(at + length, os.fstat(file.fileno()).st_size, "points and XML")
        # Where the XML begins counts checksums, its length does not: read whole pages of it.
        file.seek(at - at % PAGE)
        n_pages = (at % PAGE + length) // (PAGE - CHECKSUM) + 2
        xml = b"".join(file.read(PAGE)[:-CHECKSUM] for _ in range(n_pages))
    xml = xml[min(at % PAGE, PAGE - CHECKSUM) :][:length]
    if elsewhere := ELSEWHERE.search(xml.replace(b"\0", b"")):  # of UTF-16, too
        words = elsewhere[0].decode()
        raise PointFileError(f"its XML names another place ({words}): get it without that")
    root = ElementTree.fromstring(xml)
    level, depth, n_compared = [root], 0, 0
    while level:
        for node in level:
            _, _, name = node.tag.rpartition("}")
            if node.get("type") == "CompressedVector" and node.find(f"{ANY}prototype") is None:
                raise PointFileError(f"damaged: {name} does not say what it holds: no prototype")
            if node.get("type") == "ScaledInteger" and name.startswith(("cartesian", "spherical")):
                check_grid(name, float(node.get("scale", 1)), float(node.get("offset", 0)))
            # libe57 compares the names in an element, and all that is in a vector of one kind.
            is_vector, of_any = node.get("type") == "Vector", node.get("allowHeterogeneousChildren")
            compared = node if not is_vector else () if of_any == "1" else node.iter()
            n_compared += sum(1 for _ in compared) ** 2
        level, depth = [child for node in level for child in node], depth + 1
        if n_compared > MOST_COMPARED or depth > DEEPEST:
            raise PointFileError(
                f"damaged: its XML is {depth} elements deep, with {n_compared:,} pairs to compare"
            )
    return root.findall(f"{ANY}data3D/*")


def _pose(path, number, scan):
    """Rotation and translation of a scan. Zeros are no rotation, as other programs take them."""
    limits, parts = PoseLimits(), []
    for part, axes, values in (("rotation", "wxyz", [1, 0, 0, 0]), ("translation", "xyz", [0] * 3)):
        if (told := scan.find(f"{ANY}pose/{ANY}{part}")) is not None:
            values = [told.findtext(ANY + axis, "nan") or 0 for axis in axes]
        parts.append(values)
    try:
        rotation, translation = (np.array(values, float) for values in parts)
        length = np.linalg.norm(rotation)
        if not (np.isfinite(length) and np.abs(translation).max() < limits.farthest):
            raise ValueError
    except ValueError:
        turn, move = (" ".join(map(str, values)) for values in parts)
        raise PointFileError(
            f"scan {number}: broken pose: rotation {turn}, translation {move}; get the file anew"
        ) from None
    if abs(length - 1) > limits.unit:
        taken = "its direction" if length > limits.unit else "no rotation"
        warn_caller(f"{path}: scan {number}: rotation has length {length:.3g}; {taken} is taken")
    return rotation if length > limits.unit else np.eye(1, 4)[0], translation


def _scan(pye57, file, header):
    """Coordinates as they are in a scan, and attributes, of all points that are not invalid."""
    dtypes, n = pye57.e57.SUPPORTED_POINT_FIELDS, header.point_count
    data, buffers = {}, pye57.libe57.VectorSourceDestBuffer()
    for field in dtypes.keys() & set(header.point_fields):
        # pye57 reads colors as bytes; single precision holds those of 16 bits, too.
        data[field] = np.empty(n, "f" if field in COLOR_FIELDS else dtypes[field])
        # The last two arguments: numbers are converted to this dtype, and scaled.
        buffer = pye57.libe57.SourceDestBuffer(file.image_file, field, data[field], n, True, True)
        buffers.append(buffer)
    if (n_read := header.points.reader(buffers).read()) != n:
        raise PointFileError(f"a scan promises {n:,} points and holds {n_read:,}")
    system = header.get_coordinate_system(pye57.e57.COORDINATE_SYSTEMS)
    prototype = pye57.libe57.StructureNode(header.points.prototype())
    invalid = data.get(f"{system.name.lower()}InvalidState")
    if invalid is not None:
        data = {field: values[invalid == 0] for field, values in data.items()}
    xyz = np.column_stack([data[field] for field in system.value])
    if system.name == "SPHERICAL":
        xyz = pye57.utils.convert_spherical_to_cartesian(xyz)
    data |= _colors(
        header, prototype, {f: np.nan_to_num(data[f]) for f in COLOR_FIELDS if f in data}
    )
    return xyz, {ours: data[theirs] for ours, (theirs, _) in E57_FIELDS.items() if theirs in data}


def _colors(header, prototype, colors):
    """Integers up to 255 as they are; of others, the most that the file states becomes 65535."""
    nodes, limits = [prototype[field] for field in colors], header.node
    most = max((getattr(n, "scaledMaximum", n.maximum)() for n in nodes), default=0)
    if colors and limits.isDefined("colorLimits"):
        most = min(most, max(limits["colorLimits"][f"{f}Maximum"].value() for f in colors))
    if most > 65535:  # neither tells
        most = max(values.max(initial=0) for values in colors.values())
    if most <= 255 and all(type(node).__name__ == "IntegerNode" for node in nodes):
        return {field: values.astype(np.uint8) for field, values in colors.items()}
    most, factor = max(most, 0), 65535 / most if most > 0 else 0.0
    return {f: np.rint(v.clip(0, most) * factor).astype(np.uint16) for f, v in colors.items()}


def _setup(header, position):
    """Where the scanner of a scan stood, NaN if the scan does not tell.

    Merged clouds are written as scans as well. A pose that moves nothing may be theirs, unless
    there is a grid of measurements.
    """
    has_grid = {"rowIndex", "columnIndex"} <= set(header.point_fields)
    merged = "name" in header.scan_fields and header["name"].value() == MERGED
    if merged or not header.has_pose() or not (position.any() or has_grid):
        return np.full(3, np.nan)
    return position


def write_e57(path, cloud):
    """Write one E57 scan, with the pose of a single setup, or one in the middle of its points."""
    pye57 = import_extra("pye57", "formats", "E57")
    write_scan = _in_double_precision(pye57)
    setups = np.reshape(cloud.metadata.get(SETUPS, []), (-1, 3)).astype(float)
    stood = np.isfinite(setups).all(axis=1)
    has_grid = set(CELL) <= cloud.attributes.keys()
    keep = len(setups) == 1 and stood[0] and (setups.any() or has_grid)  # as `_setup` reads
    center = setups[0] if keep else np.round(np.median(cloud.xyz, axis=0))
    local = cloud.xyz - center
    data = {f"cartesian{axis}": np.ascontiguousarray(local[:, i]) for i, axis in enumerate("XYZ")}
    columns, of_colors = colors_of_bytes(flat_columns(cloud.attributes))
    lost, rounded = [], [*COLORS] if of_colors else []
    for name, values in columns.items():
        theirs, code = E57_FIELDS.get(name, (name, None))
        try:
            data[theirs] = fit_dtype(name, values, {code}, "E57")
        except PointFileError:
            if name == "intensity" and values.dtype.kind in "iuf":
                rounded.append(name)
                with np.errstate(over="ignore"):
                    data[theirs] = values.astype(code)
            else:
                lost.append(name)
    if not np.isfinite(data.get("intensity", 0)).all():
        lost.append("intensity")
        del data["intensity"]
    for group in (COLORS, CELL):  # written together or not at all
        fields = [E57_FIELDS[name][0] for name in group]
        if not all(f in data for f in fields):
            lost += [n for n, f in zip(group, fields, strict=True) if data.pop(f, None) is not None]
    if stood.any() and not keep:
        lost.append("poses of the scans")
    holds = "E57 holds coordinates, finite intensity of single precision and colors of 8 bits"
    warn_of_lost(holds, lost, rounded)
    file = pye57.E57(os.fsencode(path), mode="w")
    try:
        write_scan(file, data, name=None if keep else MERGED, translation=center)
        file.close()
    except Exception as err:
        del file.image_file  # else pye57 closes it again, and prints an error
        if re.search("error_?write_?failed", str(err), re.IGNORECASE):
            raise PointFileError("cannot be written: the disk may be full") from err
        raise


def _in_double_precision(pye57):
    """pye57's function that writes a scan, for which single precision is fixed, with double."""
    written = pye57.E57.write_scan_raw
    library = pye57.libe57
    double = SimpleNamespace(**{**vars(library), "E57_SINGLE": library.E57_DOUBLE})
    names = {**written.__globals__, "libe57": double}
    function = FunctionType(written.__code__, names, argdefs=written.__defaults__)
    function.__kwdefaults__ = written.__kwdefaults__
    return function
