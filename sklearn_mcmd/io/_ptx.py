"""PTX of Leica Cyclone: scans, each with its grid of rays, and its pose."""

from itertools import islice
from math import prod

import numpy as np

from sklearn_mcmd.io._point_cloud import CELL, PointCloud, PointFileError, check_room, joined_scans

# Lines of a header, and their numbers.
HEADER = [("number of columns", 1), ("number of rows", 1), ("position of the scanner", 3)]
HEADER += [("axis of the scanner", 3)] * 3 + [("row of four of the matrix", 4)] * 4
VALUES = ("intensity", "red", "green", "blue")  # after the coordinates
# What a point is, for errors.
LIKE = "; points have 4 numbers, or all of a scan have 7 with colors"
SHORTEST = len("0 0 0 0\n")  # bytes of a point
RIGID = 2e-3  # sqrt(3) / 1000 and less, by which three decimals make a rotation wrong


def read_ptx(path):
    """Read all scans, each moved by its matrix, as one cloud; rays without a return are dropped."""
    scans: dict[int, PointCloud] = {}
    setups, n_points = [], 0
    with open(path, encoding="utf-8-sig", errors="surrogateescape") as file:
        lines = ((i, line) for i, line in enumerate(file, start=1) if line.strip())
        for first in lines:
            shape, position, matrix = _header([first, *islice(lines, len(HEADER) - 1)])
            n_points += prod(shape)
            check_room(SHORTEST * n_points - 1, path.stat().st_size, f"{n_points:,} points")
            if not prod(shape):
                continue
            table = _table(lines, prod(shape), first[0])
            # A column of the grid after the other, as the scanner turned.
            cells = np.divmod(np.arange(len(table), dtype=np.int32), np.int32(shape[1]))
            kept = table[:, :3].any(axis=1)  # others have 0 0 0
            if kept.any():
                attributes = dict(zip(VALUES, table[kept, 3:].T, strict=False))
                if table.shape[1] == 7 and np.isin(table[kept, 4:], range(256)).all():
                    attributes |= zip(VALUES[1:], table[kept, 4:].T.astype(np.uint8), strict=True)
                attributes |= zip(CELL[::-1], (cell[kept] for cell in cells), strict=True)
                xyz = table[kept, :3] @ matrix[:3, :3] + matrix[3, :3]
                scans[len(scans)] = PointCloud(xyz, attributes)
                # Where nothing is moved, points may have been moved before.
                is_moved = (matrix != np.eye(4)).any() or not position.any()
                stood = matrix[3, :3] if min(shape) > 1 and is_moved else np.full(3, np.nan)
                setups.append(stood)
    return joined_scans(scans, setups, n_points)


def _header(lines):
    """Columns and rows, the position, and the matrix by which a row (x, y, z, 1) is multiplied."""
    rows = []
    for (number, line), (what, n) in zip(lines, HEADER, strict=False):
        try:
            rows.append(np.array(line.split(), np.uint32 if n == 1 else float))
        except (ValueError, OverflowError):
            rows.append(np.empty(0))
        if rows[-1].shape != (n,) or not np.isfinite(rows[-1]).all():
            raise PointFileError(f"line {number}: needs the {what}, has {line.strip()[:60]!r}")
    if len(rows) < len(HEADER):
        raise PointFileError(f"truncated: it ends before the {HEADER[len(rows)][0]} of a scan")
    matrix, turn = np.array(rows[-4:]), np.array(rows[-4:-1])[:, :3]
    rigid = np.allclose(turn @ turn.T, np.eye(3), rtol=0, atol=RIGID) and np.linalg.det(turn) > 0
    if not rigid or (matrix[:, 3] != (0, 0, 0, 1)).any():
        raise PointFileError(f"line {lines[-4][0]}: the matrix that begins here is no rigid motion")
    return (int(rows[0][0]), int(rows[1][0])), rows[2], matrix


def _table(lines, n, first):
    """The numbers (n, 4 or 7) of the points of a scan, whose header begins in the line `first`."""
    last = first, ""

    def texts():
        nonlocal last
        for i in range(n):
            if (line := next(lines, None)) is None:
                raise PointFileError(f"truncated: scan of line {first}: {i:,} of {n:,} points")
            last = line
            yield last[1]

    try:
        table = np.loadtxt(texts(), comments=None, ndmin=2)
    except ValueError as err:
        if isinstance(err, PointFileError):
            raise
        raise PointFileError(f"line {last[0]}: {last[1].strip()[:60]!r} is no point{LIKE}") from err
    if table.shape[1] not in (4, 7):
        raise PointFileError(f"line {last[0]}: a point of {table.shape[1]} numbers{LIKE}")
    return table
