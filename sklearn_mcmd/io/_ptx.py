"""PTX of Leica Cyclone: scans, each with its grid of rays, and its pose."""

from itertools import islice
from math import prod

import numpy as np

from sklearn_mcmd.io._point_cloud import COLORS, PointCloud, PointFileError, check_room, joined

__all__ = ["read_ptx"]

# Lines of a header, and their numbers.
HEADER = ("number of columns", 1), ("number of rows", 1), ("position of the scanner", 3)
HEADER += (("axis of the scanner", 3),) * 3 + (("row of four of the matrix", 4),) * 4
COLUMNS = {4: ("intensity",), 7: ("intensity", *COLORS)}  # after the coordinates
SHORTEST = len("0 0 0 0\n")  # bytes of a point
RIGID = 1e-3  # by which rounded decimals may make a rotation wrong
ROWS_A_TIME = 100_000


def read_ptx(path):
    """Read all scans, each moved by its matrix, as one cloud; rays without a return are dropped."""
    clouds, setups, n_points = [], [], 0
    with open(path, encoding="utf-8-sig", errors="surrogateescape") as file:
        lines = ((i, line) for i, line in enumerate(file, start=1) if line.strip())
        for first in lines:
            shape, position, matrix = _header([first, *islice(lines, len(HEADER) - 1)])
            n_points += prod(shape)
            check_room(SHORTEST * n_points - 1, path.stat().st_size, f"{n_points:,} points")
            table = _table(lines, prod(shape), first[0])
            column, row = np.divmod(np.arange(len(table), dtype=np.int32), max(shape[1], 1))
            kept = table[:, :3].any(axis=1)  # others have 0 0 0
            if not kept.any():
                continue
            attributes = dict(zip(COLUMNS[table.shape[1]], table[kept, 3:].T, strict=True))
            for color in attributes.keys() & set(COLORS):
                whole = attributes[color].clip(0, 255).astype(np.uint8)
                if (whole == attributes[color]).all():
                    attributes[color] = whole
            attributes |= {"row_index": row[kept], "column_index": column[kept]}
            xyz = table[kept, :3] @ matrix[:3, :3] + matrix[3, :3]
            clouds.append(PointCloud(xyz, attributes))
            # Where nothing was moved, points may have been moved before.
            known = min(shape) > 1 and (np.any(matrix != np.eye(4)) or not np.any(position))
            setups.append(matrix[3, :3] if known else np.full(3, np.nan))
    if len(clouds) > 1:
        for i, cloud in enumerate(clouds):
            cloud.attributes["scan_index"] = np.full(len(cloud), i, dtype=np.int32)
    cloud = joined(clouds) if clouds else PointCloud(np.empty((0, 3)))
    cloud.metadata, cloud.n_dropped = {"sensor_origins": np.array(setups)}, n_points - len(cloud)
    return cloud


def _header(lines):
    """Columns and rows, the position, and the matrix by which a row (x, y, z, 1) is multiplied."""
    values = []
    for (number, line), (what, n) in zip(lines, HEADER, strict=False):
        values.append(found := _numbers(line))
        whole = n > 1 or (len(found) == 1 and found[0] >= 0 and found[0] == np.rint(found[0]))
        if len(found) != n or not np.isfinite(found).all() or not whole:
            raise PointFileError(f"line {number}: needs the {what}, has {line.strip()[:60]!r}")
    if len(values) < len(HEADER):
        raise PointFileError(f"truncated: it ends before the {HEADER[len(values)][0]} of a scan")
    matrix = np.array(values[-4:])
    turn = matrix[:3, :3]
    rigid = np.allclose(turn @ turn.T, np.eye(3), rtol=0, atol=RIGID) and np.linalg.det(turn) > 0
    if not rigid or (matrix[:, 3] != (0, 0, 0, 1)).any():
        raise PointFileError(f"line {lines[-4][0]}: the matrix that begins here is no rigid motion")
    return (int(values[0][0]), int(values[1][0])), values[2], matrix


def _table(lines, n, first):
    """The numbers (n, 4 or 7) of the points of a scan, whose header begins in the line `first`."""
    tables, width, left = [np.empty((0, 4))], None, n
    while left and (part := list(islice(lines, min(left, ROWS_A_TIME)))):
        width, left = width or len(_numbers(part[0][1])), left - len(part)
        try:
            table = np.loadtxt([line for _, line in part], comments=None, ndmin=2)
        except ValueError:
            table = np.empty((0, 0))
        if table.shape != (len(part), width) or width not in COLUMNS:
            odd = (at for at in part if len(_numbers(at[1])) != width or width not in COLUMNS)
            number, line = next(odd, part[0])
            raise PointFileError(
                f"line {number}: a point of a scan has 4 numbers, or all have 7 with colors, not "
                f"{line.strip()[:60]!r}"
            )
        tables.append(table)
    if left:
        raise PointFileError(
            f"truncated: the scan of line {first} promises {n:,} points, the file has {n - left:,}"
        )
    return np.concatenate(tables[1:] or tables)


def _numbers(line):
    """The numbers of a line; none where it has words."""
    try:
        return [float(word) for word in line.split()]
    except ValueError:
        return []
