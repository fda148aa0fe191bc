"""PLY, PCD and E57, each by a library for that format."""

import os
import re
import warnings
from types import FunctionType, SimpleNamespace

import numpy as np

from sklearn_mcmd.io._arrays import cloud_from_records
from sklearn_mcmd.io._no_returns import NoReturns
from sklearn_mcmd.io._point_cloud import (
    COLORS,
    PointCloud,
    PointFileError,
    check_room,
    fit_dtype,
    flat_columns,
    import_extra,
)
from sklearn_mcmd.io._text import text_rows

__all__ = ["read_e57", "read_pcd", "read_ply", "write_e57", "write_pcd", "write_ply"]

PLY_DTYPES = {"i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8"}
PCD_DTYPES = PLY_DTYPES | {"i8", "u8"}
# Viewers expect normals in PLY under these names; in all other formats they have ours.
PLY_NORMALS = {"nx": "normal_x", "ny": "normal_y", "nz": "normal_z"}
DENOISED = "outliers removed by sklearn-mcmd"
MERGED = "cloud without setup"  # name of a scan whose pose is no place of a scanner
LONGEST_HEADER = 2**20  # bytes of a PLY's
LONGEST_RUN = 88  # bytes from one byte of a compressed PCD
E57_FIELDS = {
    "intensity": ("intensity", "f4"),
    "red": ("colorRed", "u1"),
    "green": ("colorGreen", "u1"),
    "blue": ("colorBlue", "u1"),
    "row_index": ("rowIndex", "u2"),
    "column_index": ("columnIndex", "u2"),
}


def read_ply(path, columns=None):
    """Read the vertices of a PLY file; faces and other elements are left out."""
    plyfile = import_extra("plyfile", "formats", "PLY")
    _check_ply_values(path)
    ply = plyfile.PlyData.read(str(path))
    if "vertex" not in ply:
        raise PointFileError("has no element 'vertex'")
    vertices = ply["vertex"].data
    lists = [name for name in vertices.dtype.names if vertices.dtype[name].hasobject]
    if lists:
        warnings.warn(f"{path}: list properties are left out: {', '.join(lists)}.", stacklevel=3)
        vertices = vertices[[n for n in vertices.dtype.names if n not in lists]]
    metadata = {"ply_comments": list(ply.comments), "ply_obj_info": list(ply.obj_info)}
    if DENOISED in ply.comments:
        metadata["denoised"] = True
    cloud = cloud_from_records(vertices, columns, metadata=metadata)
    cloud.attributes = _renamed(cloud.attributes, PLY_NORMALS)
    return cloud


def _check_ply_values(path):
    """Refuse a header that tells of more values than bytes; each takes one at least."""
    with open(path, "rb") as file:
        header, _, _ = file.read(LONGEST_HEADER).partition(b"end_header")
        size = os.fstat(file.fileno()).st_size  # of this file: another may take its name meanwhile
    n_values = n_rows = 0
    for n, _ in re.findall(rb"(?:^|[\r\n])\s*(?:element\s+\S+\s+(\d+)|(property))", header):
        n_rows = int(n) if n else n_rows
        n_values += 0 if n else n_rows
    check_room(n_values, size, "its values")


def write_ply(path, cloud, encoding="binary"):
    """Write the vertices of a PLY file, little-endian binary unless ``encoding="ascii"``."""
    plyfile = import_extra("plyfile", "formats", "PLY")
    columns = _renamed(_columns(cloud), {ours: theirs for theirs, ours in PLY_NORMALS.items()})
    columns = {n: fit_dtype(n, v, PLY_DTYPES, "PLY") for n, v in columns.items()}
    records = _records(cloud.xyz, columns)
    plyfile.PlyData(
        [plyfile.PlyElement.describe(records, "vertex")],
        text=encoding == "ascii",
        byte_order="=" if encoding == "ascii" else "<",
        comments=_comments(cloud),
        obj_info=cloud.metadata.get("ply_obj_info", []),
    ).write(str(path))


def _comments(cloud):
    comments = cloud.metadata.get("ply_comments", [])
    marked = DENOISED in comments or not cloud.metadata.get("denoised")
    return comments if marked else [*comments, DENOISED]


def read_pcd(path, columns=None):
    """Read PCD; packed ``rgb`` becomes red, green, blue; padding is left out."""
    pypcd4 = import_extra("pypcd4", "formats", "PCD")
    with open(path, "rb") as file:
        lines = _pcd_header(file)
        try:
            header = pypcd4.MetaData.parse_header(lines)
        except ValueError as err:
            raise PointFileError(f"broken PCD header: {' '.join(str(err).split())[:200]}") from err
        _check_pcd(path, file, header)
        try:
            records = _pcd_records(pypcd4, path, file, header)
        except Exception as err:  # parsers raise errors of many kinds
            reason = " ".join(str(err).partition(";")[0].split())[:200]
            raise PointFileError(f"the point data is truncated or damaged: {reason}") from err
    if len(records) != header.points:
        raise PointFileError(
            f"the header promises {header.points} points, the file holds {len(records)}"
        )
    metadata = {"pcd_viewpoint": tuple(header.viewpoint)}
    cloud = cloud_from_records(records, columns, metadata=metadata)
    attributes = {}
    for name, values in cloud.attributes.items():
        if name.startswith("#$%&~~"):  # pypcd4's name for the padding field "_"
            continue
        if name == "rgb" and values.dtype.itemsize == 4 and not attributes.keys() & set(COLORS):
            packed = values.view(np.uint32)
            for color, shift in zip(COLORS, (16, 8, 0), strict=True):
                attributes[color] = (packed >> shift & 255).astype(np.uint8)
        else:
            attributes[name] = values
    cloud.attributes = attributes
    return cloud


def write_pcd(path, cloud, encoding="binary"):
    """Write PCD as one row of points: binary, binary_compressed or ascii."""
    pypcd4 = import_extra("pypcd4", "formats", "PCD")
    columns = _columns(cloud)
    if all(c in columns and columns[c].dtype == np.uint8 for c in COLORS):
        red, green, blue = (columns.pop(c).astype(np.uint32) for c in COLORS)
        columns["rgb"] = (red << 16 | green << 8 | blue).view(np.float32)
    for name in columns:
        if not re.fullmatch(r"[A-Za-z0-9_.\-]+", name):
            raise PointFileError(
                f"attribute name {name!r} cannot be stored in PCD: use letters, digits, '_'"
            )
    columns = {n: fit_dtype(n, v, PCD_DTYPES, "PCD") for n, v in columns.items()}
    columns = {**_axes(cloud.xyz), **columns}
    pcd = pypcd4.PointCloud.from_points(
        list(columns.values()), list(columns), [v.dtype for v in columns.values()]
    )
    pcd.metadata.viewpoint = cloud.metadata.get("pcd_viewpoint", pcd.metadata.viewpoint)
    if encoding != "ascii":
        pcd.save(str(path), pypcd4.Encoding(encoding))
        return
    # pypcd4 writes ten decimals, which are too few for small and for packed numbers.
    with open(path, "w", encoding="ascii", newline="\n") as file:
        pcd.metadata.data = pypcd4.Encoding.ASCII
        file.write(pcd.metadata.compose_header())
        for rows in text_rows(list(columns.values())):
            file.writelines(f"{' '.join(map(str, row))}\n" for row in rows)


def read_e57(path):
    """Read all scans of an E57 file, each moved by its pose, as one cloud."""
    pye57 = import_extra("pye57", "formats", "E57")
    names = {theirs: ours for ours, (theirs, _) in E57_FIELDS.items()}
    readable = {*names, *pye57.e57.SUPPORTED_POINT_FIELDS}
    parts, setups, skipped, n_points = [], [], set(), 0
    with pye57.E57(os.fsencode(path)) as file:
        for i in range(file.scan_count):
            header = file.get_header(i)
            n_points += header.point_count
            check_room(n_points // 8, path.stat().st_size, f"{n_points:,} points")
            position = np.asarray(file.scan_position(i), float)[0]
            setups.append(_setup(position, header))
            skipped |= set(header.point_fields) - readable
            if not header.point_count:
                continue
            scan = file.read_scan(
                i, intensity=True, colors=True, row_column=True, ignore_missing_fields=True
            )
            xyz = np.column_stack([scan[f"cartesian{axis}"] for axis in "XYZ"])
            attributes = {ours: scan[theirs] for theirs, ours in names.items() if theirs in scan}
            attributes["scan_index"] = np.full(len(xyz), i, dtype=np.int32)
            no_returns = NoReturns().add(xyz - position)  # zeros, moved by the pose
            if no_returns.n_left_out:
                warnings.warn(no_returns.warning(f"{path}, scan {i}"), stacklevel=3)
                kept = (xyz != position).any(axis=1)
                xyz, attributes = xyz[kept], {name: a[kept] for name, a in attributes.items()}
            parts.append((xyz, attributes))
    if not parts:
        return PointCloud(np.empty((0, 3)))
    shared = set.intersection(*(set(attributes) for _, attributes in parts))
    skipped |= {name for _, attributes in parts for name in attributes if name not in shared}
    if skipped:
        warnings.warn(
            f"{path}: fields that not every scan has, or that pye57 cannot read, are left out: "
            f"{', '.join(sorted(skipped))}.",
            stacklevel=3,
        )
    if len(parts) == 1:
        shared.discard("scan_index")
        setups = [setups[int(parts[0][1]["scan_index"][0])]]
    xyz = np.concatenate([xyz for xyz, _ in parts])
    merged = {
        name: np.concatenate([attributes[name] for _, attributes in parts])
        for name in parts[0][1]
        if name in shared
    }
    metadata = {"sensor_origins": np.array(setups)}
    return PointCloud(xyz, merged, metadata, n_dropped=n_points - len(xyz))


def _setup(position, header):
    """Where the scanner of a scan stood, by its pose; NaN if the scan does not tell.

    Merged clouds are written as scans as well. A pose that moves nothing may be theirs, unless
    there is a grid of measurements.
    """
    has_grid = {"rowIndex", "columnIndex"} <= set(header.point_fields)
    merged = "name" in header.scan_fields and header["name"].value() == MERGED
    if merged or not header.has_pose() or not (position.any() or has_grid):
        return np.full(3, np.nan)
    return position


def write_e57(path, cloud):
    """Write one E57 scan, with a pose in the middle of its points."""
    pye57 = import_extra("pye57", "formats", "E57")
    write_scan = _in_double_precision(pye57)
    center = np.round(np.median(cloud.xyz, axis=0))
    local = cloud.xyz - center
    data = {f"cartesian{axis}": np.ascontiguousarray(local[:, i]) for i, axis in enumerate("XYZ")}
    columns, lost, rounded = flat_columns(cloud.attributes), [], []
    if all(c in columns and columns[c].dtype == np.uint16 for c in COLORS):
        colors = np.array([columns[c] for c in COLORS])
        deep = colors.max() > 255
        rounded += COLORS if deep and not _made_of_bytes(colors) else ()
        columns |= zip(COLORS, (colors >> (8 if deep else 0)).astype(np.uint8), strict=True)
    for name, values in columns.items():
        theirs, code = E57_FIELDS.get(name, (name, None))
        try:
            data[theirs] = fit_dtype(name, values, {code}, "E57")
        except PointFileError:
            if name != "intensity" or values.dtype.kind not in "iuf":
                lost.append(name)
                continue
            rounded.append(name)
            with np.errstate(over="ignore"):
                data[theirs] = values.astype(code)
    if not np.isfinite(data.get("intensity", 0)).all():
        lost.append("intensity")
        del data["intensity"]
    for group in (COLORS, ("row_index", "column_index")):  # written together or not at all
        fields = [E57_FIELDS[name][0] for name in group]
        if not all(f in data for f in fields):
            lost += [n for n, f in zip(group, fields, strict=True) if data.pop(f, None) is not None]
    told = {"not written": lost, "rounded": [name for name in rounded if name not in lost]}
    if lost or rounded:
        warnings.warn(
            "E57 holds coordinates, finite intensity of single precision and colors of 8 bits only"
            + "".join(f"; {how}: {', '.join(names)}" for how, names in told.items() if names),
            stacklevel=3,
        )
    file = pye57.E57(os.fsencode(path), mode="w")
    try:
        write_scan(file, data, name=MERGED, translation=center)
        file.close()
    except Exception as err:
        if hasattr(file, "image_file"):
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


def _pcd_header(file):
    lines = []
    for raw in iter(lambda: file.readline(10_000), b""):
        line = raw.decode("utf-8", errors="replace").strip()
        if line and not line.startswith("#"):
            lines.append(line)
        if line.startswith("DATA") or len(lines) > 20:
            break
    keys = {line.split()[0] for line in lines}
    missing = [k for k in ("FIELDS", "SIZE", "TYPE", "POINTS", "DATA") if k not in keys]
    if missing:
        raise PointFileError(f"not a PCD file: its header has no {', '.join(missing)}")
    if len(lines) > 10 and not lines[-1].endswith("ascii"):  # pypcd4 would read on in the points
        raise PointFileError("its header has more than 10 lines, which only DATA ascii may have")
    if "COUNT" not in keys:  # PCL allows its absence; pypcd4 does not
        fields = next(line for line in lines if line.startswith("FIELDS")).split()[1:]
        lines.insert(0, "COUNT " + " ".join("1" for _ in fields))
    return lines


def _check_pcd(path, file, header):
    room = path.stat().st_size - file.tell()
    n_bytes = sum(size * count for size, count in zip(header.size, header.count, strict=False))
    if header.data == "ascii":
        n_bytes = 2 * sum(header.count)  # a digit and what ends it
        room += 1
    elif header.data != "binary":
        n_stored, n_decompressed = np.frombuffer(file.read(8).ljust(8, b"\0"), "<u4").tolist()
        check_room(n_stored, room, "the compressed points")
        room *= LONGEST_RUN
        check_room(n_decompressed, room, "the decompressed points")
    check_room(sum(header.count), path.stat().st_size, "the columns")
    check_room(n_bytes * header.points, room, f"{header.points:,} points")


def _pcd_records(pypcd4, path, file, header):
    if header.data != "ascii":
        return pypcd4.PointCloud.from_path(path).pc_data
    # pypcd4 splits at single spaces, but many files pad columns to a width.
    dtype = header.build_dtype()
    return np.atleast_1d(np.loadtxt(file, dtype)) if header.points else np.empty(0, dtype)


def _axes(xyz):
    """Columns x, y, z: float32 where that is exact, as PCL and viewers expect, else float64."""
    with np.errstate(over="ignore"):
        single = xyz.astype(np.float32)
    kept = single if np.array_equal(single, xyz) else xyz
    return {axis: kept[:, i] for i, axis in enumerate("xyz")}


def _columns(cloud):
    """Attributes as columns. Colors of LAS that were made of 8 bits have 8 bits again."""
    columns = flat_columns(cloud.attributes)
    if "las_points" in cloud.metadata and all(c in columns for c in COLORS):
        colors = np.array([columns[c] for c in COLORS])
        if colors.dtype == np.uint16 and _made_of_bytes(colors):
            columns |= zip(COLORS, (colors >> 8).astype(np.uint8), strict=True)
    return columns


def _made_of_bytes(colors):
    """Whether colors of 16 bits were made of 8, which then hold them."""
    low = colors & 255
    return not low.any() or (low == colors >> 8).all()


def _records(xyz, columns):
    columns = {**_axes(xyz), **columns}
    records = np.empty(len(xyz), dtype=[(name, c.dtype) for name, c in columns.items()])
    for name, column in columns.items():
        records[name] = column
    return records


def _renamed(attributes, names):
    """Rename attributes, except where the new name is already in use."""
    return {
        names[name] if name in names and names[name] not in attributes else name: values
        for name, values in attributes.items()
    }
