"""PLY and PCD, each by a library for that format."""

import io
import os
import re

import numpy as np

from sklearn_mcmd._errors import warn_caller
from sklearn_mcmd._extras import import_extra
from sklearn_mcmd.io._arrays import cloud_from_records
from sklearn_mcmd.io._column_names import without_accents
from sklearn_mcmd.io._point_cloud import (
    COLORS,
    PointFileError,
    check_room,
    fit_dtype,
    flat_columns,
    made_of_bytes,
    with_cells,
)

PLY_DTYPES = {"i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8"}  # that files hold
PCD_DTYPES = PLY_DTYPES | {"i8", "u8"}
# Viewers expect normals in PLY under these names; in all other formats they have ours.
PLY_NORMALS = {"nx": "normal_x", "ny": "normal_y", "nz": "normal_z"}
DENOISED = "outliers removed by sklearn-mcmd"  # comment of PLY
LONGEST_HEADER = 2**20  # bytes of a PLY's
VERSIONS = [".5", "0.5", ".6", "0.6", ".7", "0.7"]  # of PCD, whose points are laid out alike
LONGEST_RUN = 88  # bytes from one byte of a compressed PCD


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
        warn_caller(f"{path}: list properties are left out: {', '.join(lists)}.")
        vertices = vertices[[n for n in vertices.dtype.names if n not in lists]]
    metadata: dict = {"ply_comments": list(ply.comments), "ply_obj_info": list(ply.obj_info)}
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
    elements = re.split(rb"(?:^|[\r\n])\s*element\s+\S+\s+(\d+)", header)[1:]
    n_values = sum(
        int(n_rows) * len(re.findall(rb"[\r\n]\s*property", properties))
        for n_rows, properties in zip(elements[::2], elements[1::2], strict=True)
    )
    check_room(n_values, size, "its values")


def write_ply(path, cloud):
    """Write the vertices of a PLY file, in binary."""
    plyfile = import_extra("plyfile", "formats", "PLY")
    columns = _renamed(_columns(cloud), {ours: theirs for theirs, ours in PLY_NORMALS.items()})
    columns = {n: fit_dtype(n, v, PLY_DTYPES, "PLY") for n, v in columns.items()}
    columns = _spelled({**_axes(cloud.xyz), **columns}, "!-~", "PLY")
    dtype = [(name, values.dtype) for name, values in columns.items()]
    records = np.rec.fromarrays([*columns.values()], dtype=dtype)
    comments = list(cloud.metadata.get("ply_comments", []))
    if cloud.metadata.get("denoised") and DENOISED not in comments:
        comments.append(DENOISED)
    options = {"comments": comments, "obj_info": cloud.metadata.get("ply_obj_info", [])}
    element = plyfile.PlyElement.describe(records, "vertex")
    plyfile.PlyData([element], byte_order="<", **options).write(str(path))


def read_pcd(path, columns=None):
    """Read PCD; packed ``rgb`` becomes red, green, blue; padding is left out."""
    pypcd4 = import_extra("pypcd4", "formats", "PCD")
    with open(path, "rb") as file:
        header = _pcd_header(pypcd4, file)
        _check_pcd(path, file, header)
        try:
            records = _pcd_records(pypcd4, file, header)
        except Exception as err:  # parsers raise errors of many kinds
            told = f"{header.points:,} points of {sum(header.count)} numbers"
            raise PointFileError(f"the points are truncated or damaged: no {told}") from err
    if len(records) != header.points:
        raise PointFileError(f"header promises {header.points} points, there are {len(records)}")
    metadata = {"pcd_viewpoint": tuple(header.viewpoint)}
    if not np.isfinite(header.viewpoint).all():
        warn_caller(f"{path}: VIEWPOINT has numbers that are not finite; it is taken as not known")
    cloud = cloud_from_records(records, columns, metadata=metadata)
    attributes: dict = {}
    for name, values in cloud.attributes.items():
        if name == "rgb" and values.dtype.itemsize == 4 and not attributes.keys() & set(COLORS):
            bits = values.view(np.uint32) >> np.array([[16], [8], [0]], np.uint32) & 255
            attributes |= zip(COLORS, bits.astype(np.uint8), strict=True)
        elif not name.startswith("#$%&~~"):  # pypcd4's name for the padding field "_"
            attributes[name] = values
    cloud.attributes = attributes
    return with_cells(cloud, (header.height, header.width))


def write_pcd(path, cloud):
    """Write binary PCD, of an organized cloud with rows and columns as fields."""
    pypcd4 = import_extra("pypcd4", "formats", "PCD")
    columns = _columns(cloud)
    if all(c in columns and columns[c].dtype == np.uint8 for c in COLORS):
        # PCL has a color in the low 24 bits of a float.
        red, green, blue = (columns.pop(c).astype(np.uint32) for c in COLORS)
        columns["rgb"] = (red << 16 | green << 8 | blue).view(np.float32)
    columns = {n: fit_dtype(n, v, PCD_DTYPES, "PCD") for n, v in columns.items()}
    columns = _spelled({**_axes(cloud.xyz), **columns}, r"A-Za-z0-9_.\-", "PCD")
    pcd = pypcd4.PointCloud.from_points(
        list(columns.values()), list(columns), [v.dtype for v in columns.values()]
    )
    pcd.metadata.viewpoint = cloud.metadata.get("pcd_viewpoint", pcd.metadata.viewpoint)
    pcd.save(str(path), pypcd4.Encoding.BINARY)


def _pcd_header(pypcd4, file):
    """The header as of version .7, which is all that pypcd4 reads."""
    told = {}
    for raw in iter(lambda: file.readline(10_000), b""):
        key, *values = raw.decode("utf-8", errors="replace").split() or ["#"]
        if not key.startswith("#"):
            told[key.upper()] = values
        if key.upper() == "DATA" or len(told) > 20:
            break
    missing = [key for key in ("FIELDS", "SIZE", "TYPE", "POINTS", "DATA") if not told.get(key)]
    if missing:
        raise PointFileError(f"not a PCD file: its header has no {', '.join(missing)}")
    told.setdefault("COUNT", ["1"] * len(told["FIELDS"]))  # PCL allows its absence
    told["TYPE"], told["DATA"] = [one.upper() for one in told["TYPE"]], [told["DATA"][0].lower()]
    if (version := " ".join(told.pop("VERSION", [".7"]))) not in VERSIONS:
        raise PointFileError(f"is PCD of version {version[:40]}; .5, .6 and .7 are known")
    lines = [f"{key} {' '.join(values)}" for key, values in told.items()]
    try:
        return pypcd4.MetaData.parse_header(lines)
    except ValueError as err:
        raise PointFileError(f"broken PCD header: {', '.join(lines)[:300]}") from err


def _check_pcd(path, file, header):
    begin = file.tell()
    room = path.stat().st_size - begin
    n_bytes = sum(size * count for size, count in zip(header.size, header.count, strict=False))
    if header.data == "ascii":
        n_bytes = 2 * sum(header.count)  # a digit and what ends it
        room += 1
    elif header.data != "binary":
        n_stored, n_decompressed = np.frombuffer(file.read(8).ljust(8, b"\0"), "<u4").tolist()
        file.seek(begin)
        check_room(n_stored, room, "the compressed points")
        room *= LONGEST_RUN
        check_room(n_decompressed, room, "the decompressed points")
    check_room(sum(header.count), path.stat().st_size, "the columns")
    check_room(n_bytes * header.points, room, f"{header.points:,} points")


def _pcd_records(pypcd4, file, header):
    dtype = header.build_dtype()
    if header.data == "binary" or not header.points:
        return np.fromfile(file, dtype, header.points)
    if header.data != "ascii":
        whole = io.BytesIO(header.compose_header().encode() + file.read())
        return pypcd4.PointCloud.from_fileobj(whole).pc_data
    # pypcd4 splits at single spaces, but many files pad columns to a width, and some have commas.
    return np.atleast_1d(np.loadtxt((line.replace(b",", b" ") for line in file), dtype))


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
        if colors.dtype == np.uint16 and made_of_bytes(colors):
            columns |= zip(COLORS, (colors >> 8).astype(np.uint8), strict=True)
    return columns


def _spelled(columns, characters, format_name):
    """The columns under names of the characters that a format holds, with a warning of new ones."""
    names = {}
    for name in columns:
        bare = re.sub(f"[^{characters}]+", "_", without_accents(name))
        names[name] = bare if bare.strip("_") else "attribute"
        while names[name] != name and names[name] in [*columns, *[*names.values()][:-1]]:
            names[name] += "_"
    if changed := ", ".join(f"{old!r} as {new}" for old, new in names.items() if old != new):
        warn_caller(f"names in {format_name} are ASCII without blanks; written: {changed}")
    return {names[name]: values for name, values in columns.items()}


def _renamed(attributes, names):
    """Rename attributes, except where the new name is already in use."""
    return {
        names[name] if name in names and names[name] not in attributes else name: values
        for name, values in attributes.items()
    }
