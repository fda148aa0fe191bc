"""Points of several LAS or LAZ files in one: a header that holds all, and points in its grid."""

import copy

import numpy as np

from sklearn_mcmd.io._grid import LARGEST
from sklearn_mcmd.io._las import cloud_of_points, forget_copc, read_header
from sklearn_mcmd.io._point_cloud import PointFileError

WAVE_PACKETS = 4, 5, 9, 10  # point formats


def joined_header(paths):
    """The first file's header with the finest scales of all. If there is none, an error names a
    file: records that differ in form are no records of one file."""
    first = read_header(paths[0])
    low, high, scales = first.mins, first.maxs, first.scales
    for path in paths:
        other = read_header(path)
        if other.point_format.id in WAVE_PACKETS:
            raise PointFileError(f"{path}: wave packets of several files cannot be one file's")
        if other.global_encoding.gps_time_type != first.global_encoding.gps_time_type:
            raise PointFileError(f"{path}: its GPS times begin elsewhere than those of {paths[0]}")
        if _form(other) != _form(first):
            raise PointFileError(
                f"{path}: has another point format or other attributes than {paths[0]}; write a "
                "folder"
            )
        scales = np.minimum(scales, other.scales)
        low, high = np.minimum(low, other.mins), np.maximum(high, other.maxs)
    header = copy.deepcopy(first)
    header.scales, header.offsets = scales, _offsets(first.offsets, scales, low, high)
    forget_copc(header)
    header.vlrs.extract("LasZipVlr")
    return header


def joined_cloud(cloud, header):
    """Points of one of the files in the grid of the joined header."""
    before, records = cloud.metadata["las_header"], cloud.metadata["las_points"].copy()
    if (before.scales != header.scales).any() or (before.offsets != header.offsets).any():
        steps = np.rint((cloud.xyz - header.offsets) / header.scales)
        if np.abs(steps).max(initial=0) > LARGEST:
            raise PointFileError("its points lie too far outside the bounds of its header")
        for i, axis in enumerate("XYZ"):
            records[axis] = steps[:, i]
    return cloud_of_points(records.view(np.uint8), header)


def _form(header):
    """What must be equal, so that equal bytes mean the same."""
    kinds = [
        (d.name, d.dtype, *(() if d.scales is None else (*d.scales, *d.offsets)))
        for d in header.point_format.extra_dimensions
    ]
    return header.point_format.id, kinds


def _offsets(offsets, scales, low, high):
    """Those of the first file if all points fit, else whole numbers in the middle."""
    for origin in (offsets, np.round((low + high) / 2)):
        if (np.maximum(np.abs(low - origin), np.abs(high - origin)) <= LARGEST * scales).all():
            return origin
    raise PointFileError(
        f"the files span too much for one file with steps of {scales.min():g}; write a folder"
    )
