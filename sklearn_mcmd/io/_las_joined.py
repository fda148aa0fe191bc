"""Points of several LAS or LAZ files in one: a header that holds all, and points in its form."""

import copy

import numpy as np

from sklearn_mcmd.io._grid import LARGEST
from sklearn_mcmd.io._las import cloud_of_points, forget_copc, import_laspy, read_header
from sklearn_mcmd.io._las_structure import ANGLE_STEP
from sklearn_mcmd.io._point_cloud import PointFileError

# What a point format has besides coordinates: GPS time, colors, near infrared.
PARTS = {
    **{0: set(), 1: {"time"}, 2: {"color"}, 3: {"time", "color"}},
    **{6: {"time"}, 7: {"time", "color"}, 8: {"time", "color", "infrared"}},
}
WAVE_PACKETS = 4, 5, 9, 10  # point formats
FIRST_NEW = 6  # from this format on, angles and flags are stored in another way


def joined_header(paths):
    """The first file's header, with the richest point format, the finest scales, and the extra
    dimensions of all files. If there is none, an error names a file."""
    laspy = import_laspy(compressed=False)
    first = read_header(paths[0])
    dimensions: dict = {}
    header, formats, version = copy.deepcopy(first), set(), first.version
    low, high, scales = first.mins, first.maxs, first.scales
    for path in paths:
        other = read_header(path)
        formats.add(other.point_format.id)
        if other.point_format.id in WAVE_PACKETS:
            raise PointFileError(f"{path}: wave packets of several files cannot be one file's")
        if other.global_encoding.gps_time_type != first.global_encoding.gps_time_type:
            raise PointFileError(f"{path}: its GPS times begin elsewhere than those of {paths[0]}")
        for dimension in other.point_format.extra_dimensions:
            if _kind(dimensions.setdefault(dimension.name, dimension)) != _kind(dimension):
                raise PointFileError(
                    f"{path}: its attribute {dimension.name!r} is of another kind; write a folder"
                )
        version = max(version, other.version)
        scales = np.minimum(scales, other.scales)
        low, high = np.minimum(low, other.mins), np.maximum(high, other.maxs)
    header.scales, header.offsets = scales, _offsets(first.offsets, scales, low, high)
    forget_copc(header)
    header.vlrs.extract("LasZipVlr")
    names = [dimension.name for dimension in first.point_format.extra_dimensions]
    if len(formats) > 1 or names != list(dimensions):
        point_format = laspy.PointFormat(_richest(formats))
        least = laspy.header.Version.from_str("1.4" if point_format.id >= FIRST_NEW else "1.2")
        header.set_version_and_point_format(max(version, least), point_format)
        header.add_extra_dims(
            [
                laspy.ExtraBytesParams(
                    d.name, d.dtype, d.description, d.offsets, d.scales, d.no_data
                )
                for d in dimensions.values()
            ]
        )
    return header


def joined_cloud(cloud, header):
    """Points of one of the files, with their attributes, in the form of the joined header.

    Attributes that the file has not are 0.
    """
    laspy = import_laspy(compressed=False)
    before, old = cloud.metadata["las_header"], cloud.metadata["las_points"]
    records = laspy.ScaleAwarePointRecord.zeros(len(cloud), header=header)
    new = records.array
    if (before.point_format.id < FIRST_NEW) == (header.point_format.id < FIRST_NEW):
        for name in set(old.dtype.names) & set(new.dtype.names):
            new[name] = old[name]
    else:
        for name in header.point_format.dimension_names:
            if name in cloud.attributes:
                records[name] = cloud.attributes[name]
        # Old formats have whole degrees, new ones steps of 0.006.
        new["scan_angle"] = np.rint(cloud.attributes["scan_angle_rank"] / ANGLE_STEP)
    if (before.scales != header.scales).any() or (before.offsets != header.offsets).any():
        steps = np.rint((cloud.xyz - header.offsets) / header.scales)
        if np.abs(steps).max(initial=0) > LARGEST:
            raise PointFileError("its points lie too far outside the bounds of its header")
        for i, axis in enumerate("XYZ"):
            new[axis] = steps[:, i]
    else:
        for axis in "XYZ":
            new[axis] = old[axis]
    return cloud_of_points(new.view(np.uint8), header)


def _richest(formats):
    """The smallest point format with all that some formats have."""
    if len(formats) == 1:
        return next(iter(formats))
    wanted = set().union(*(PARTS[number] for number in formats))
    new = max(formats) >= FIRST_NEW
    return min(n for n, parts in PARTS.items() if wanted <= parts and (n >= FIRST_NEW) == new)


def _offsets(offsets, scales, low, high):
    """Those of the first file if all points fit, else whole numbers in the middle."""
    for origin in (offsets, np.round((low + high) / 2)):
        if (np.maximum(np.abs(low - origin), np.abs(high - origin)) <= LARGEST * scales).all():
            return origin
    raise PointFileError(
        f"the files span too much for one file with steps of {scales.min():g}; write a folder"
    )


def _kind(dimension):
    """What must be equal, so that equal numbers mean the same."""
    factors = ((), ()) if dimension.scales is None else (dimension.scales, dimension.offsets)
    return (dimension.dtype, *map(tuple, factors))
