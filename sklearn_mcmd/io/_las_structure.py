"""Checks of a LAS header's counts and positions against the size of the file."""

import os
import struct

from sklearn_mcmd.io._point_cloud import PointFileError

__all__ = ["check_structure"]

SMALLEST_HEADER, LAS_14_HEADER = 227, 375
VLR_HEADER, EVLR_HEADER = 54, 60


def check_structure(path):
    """Refuse impossible counts: laspy would loop over them for hours, or request their memory."""
    with open(path, "rb") as file:
        size = os.fstat(file.fileno()).st_size  # of this file: another may take its name meanwhile
        start = file.read(LAS_14_HEADER)
        if start[:4] != b"LASF":
            raise PointFileError("not a LAS/LAZ file: it does not begin with 'LASF'")
        if len(start) < SMALLEST_HEADER:
            raise PointFileError(f"truncated: {size} bytes are fewer than a LAS header")
        header_size, points_at, n_vlrs = struct.unpack_from("<HII", start, 94)
        format_id, record_length, n_points = struct.unpack_from("<BHI", start, 104)
        evlrs_at = n_evlrs = 0
        if start[25] >= 4:  # the minor version
            if len(start) < LAS_14_HEADER:
                raise PointFileError(f"truncated: {size} bytes are fewer than a LAS 1.4 header")
            evlrs_at, n_evlrs, n_points = struct.unpack_from("<QIQ", start, 235)
        if points_at + bool(n_points) > size:
            raise PointFileError(f"truncated: the points begin at byte {points_at} of {size}")
        if VLR_HEADER * n_vlrs > size - header_size or not _fit(file, evlrs_at, n_evlrs, size):
            raise PointFileError("broken header: more metadata records than the file has room for")
    if format_id & 0xC0 != 0x80 and n_points * record_length > size - points_at:
        raise PointFileError(
            f"truncated: {n_points} points of {record_length} bytes need "
            f"{points_at + n_points * record_length} bytes, the file has {size}"
        )


def _fit(file, position, n_records, size):
    """Whether extended records, each with its own length, end within the file."""
    if EVLR_HEADER * n_records > max(size - position, 0):
        return False
    for _ in range(n_records):
        file.seek(position)
        head = file.read(EVLR_HEADER)
        if len(head) < EVLR_HEADER:
            return False
        position += EVLR_HEADER + struct.unpack_from("<Q", head, 20)[0]
        if position > size:
            return False
    return True
