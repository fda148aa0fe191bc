"""Checks of a LAS header: counts and positions against the size of the file, and the grid."""

import os
import struct
from typing import NamedTuple

import numpy as np

from sklearn_mcmd.io._point_cloud import PointFileError

SMALLEST_HEADER, LAS_14_HEADER, LAS_15_HEADER = 227, 375, 393  # bytes
VLR_HEADER, EVLR_HEADER = 54, 60  # bytes of the head of a record, and of an extended one
GRID_FIELD, WAVEFORMS_FIELD = 131, 227  # places in a header


class ScaleLimits(NamedTuple):
    """Which scales of coordinates are believed."""

    same_place: float = 1_000.0  # steps in one of double precision, which would be one place


def check_structure(file):
    """Refuse impossible counts: laspy would loop over them for hours, or request their memory.

    Return how many points the header counts, and how many records are behind these if they are
    uncompressed. LAS 1.4 has two counts: of some writers, only that of older versions is not 0.
    """
    size = os.fstat(file.fileno()).st_size  # of this file: another may take its name meanwhile
    file.seek(0)
    start = file.read(LAS_14_HEADER)
    if start[:4] != b"LASF":
        raise PointFileError("not a LAS/LAZ file: it does not begin with 'LASF'")
    if len(start) < SMALLEST_HEADER:
        raise PointFileError(f"truncated: {size} bytes are fewer than a LAS header")
    # Places as in the specification of LAS: from 94 the sizes of the header and of all before the
    # points, from 104 the format (its two high bits are of LAZ), length and number of points, from
    # 235 where extended records begin, their number, and the points again, in 64 bits.
    header_size, points_at, n_vlrs = struct.unpack_from("<HII", start, 94)
    major, minor = start[24:26]
    if (major, minor) > (1, 5) or (minor == 5 and header_size < LAS_15_HEADER):
        told = f"LAS {major}.{minor} with a header of {header_size} bytes is not known"
        raise PointFileError(f"{told}; write it as LAS 1.4 where it was made")
    format_id, record_length, n_points = struct.unpack_from("<BHI", start, 104)
    evlrs_at = n_evlrs = 0
    waveforms_at = int.from_bytes(start[WAVEFORMS_FIELD:][:8] if minor >= 3 else b"", "little")
    if minor >= 4:
        if len(start) < LAS_14_HEADER:
            raise PointFileError(f"truncated: {size} bytes are fewer than a LAS 1.4 header")
        evlrs_at, n_evlrs, n_new = struct.unpack_from("<QIQ", start, 235)
        n_points = n_new or n_points
    if not n_points and points_at > size:
        raise PointFileError("holds no points")
    if points_at + bool(n_points) > size:
        raise PointFileError(f"truncated: the points begin at byte {points_at} of {size}")
    if VLR_HEADER * n_vlrs > size - header_size or not _fit(file, evlrs_at, n_evlrs, size):
        raise PointFileError("broken header: more metadata records than the file has room for")
    is_compressed, end = format_id & 0xC0 == 0x80, points_at + n_points * record_length
    if not is_compressed and end > size:
        raise PointFileError(f"truncated: {n_points} points need {end} bytes, the file has {size}")
    grid = np.frombuffer(start, "<f8", 6, GRID_FIELD).reshape(2, 3)
    for axis, scale, offset in zip("xyz", *grid, strict=True):
        check_grid(axis, scale, offset)
    file.seek(min(end, size))
    if is_compressed or not any(file.read(record_length)):  # no record, or padding
        return n_points, 0
    behind = [at for at in (evlrs_at * (n_evlrs > 0), waveforms_at, size) if at >= end]
    return n_points, (min(behind) - end) // record_length


def check_grid(axis, scale, offset):
    """Refuse a scale that puts all points at one place about the offset, or beyond all bounds.

    Coordinates are integers times scale plus offset, so a negative scale would turn an axis.
    """
    with np.errstate(invalid="ignore"):
        finest = np.spacing(max(abs(offset), 1.0))
    if not finest / ScaleLimits().same_place <= scale <= 1 / np.finfo(float).eps:
        raise PointFileError(
            f"broken header: scale {scale:g} and offset {offset:g} of {axis} give no coordinates"
        )


def _fit(file, position, n_records, size):
    """Whether extended records, each with its own length, end within the file."""
    for _ in range(n_records):
        if position + EVLR_HEADER > size:
            return False
        file.seek(position)
        position += EVLR_HEADER + struct.unpack_from("<Q", file.read(EVLR_HEADER), 20)[0]
    return not n_records or position <= size
