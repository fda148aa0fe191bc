"""E57 by pye57: scans, moved by their poses, and colors."""

import os
import re
import warnings
from types import FunctionType, SimpleNamespace

import numpy as np

from sklearn_mcmd.io._point_cloud import (
    COLORS,
    PointCloud,
    PointFileError,
    check_room,
    fit_dtype,
    flat_columns,
    import_extra,
    made_of_bytes,
)

__all__ = ["read_e57", "write_e57"]

MERGED = "cloud without setup"  # name of a scan whose pose is no place of a scanner
E57_FIELDS = {
    "intensity": ("intensity", "f4"),
    "red": ("colorRed", "u1"),
    "green": ("colorGreen", "u1"),
    "blue": ("colorBlue", "u1"),
    "row_index": ("rowIndex", "u2"),
    "column_index": ("columnIndex", "u2"),
}


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
            setups.append(_setup(file, i, header))
            skipped |= set(header.point_fields) - readable
            if not header.point_count:
                continue
            scan = file.read_scan(
                i, intensity=True, colors=True, row_column=True, ignore_missing_fields=True
            )
            xyz = np.column_stack([scan[f"cartesian{axis}"] for axis in "XYZ"])
            attributes = {ours: scan[theirs] for theirs, ours in names.items() if theirs in scan}
            attributes["scan_index"] = np.full(len(xyz), i, dtype=np.int32)
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


def _setup(file, i, header):
    """Where the scanner of a scan stood, NaN if the scan does not tell.

    Merged clouds are written as scans as well. A pose that moves nothing may be theirs, unless
    there is a grid of measurements.
    """
    position = np.asarray(file.scan_position(i), float)[0]
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
        rounded += COLORS if deep and not made_of_bytes(colors) else ()
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
