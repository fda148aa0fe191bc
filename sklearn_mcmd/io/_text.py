"""XYZ, TXT and CSV: whitespace, comma or semicolon; optional header; any numeric columns."""

import csv
import re

import numpy as np

from sklearn_mcmd.io._point_cloud import PointCloud, PointFileError, fit_dtype, flat_columns

__all__ = ["read_text", "split_table", "text_rows", "write_text", "xyz_positions"]

NUMBERS = {"u1", "i1", "u2", "i2", "u4", "i4", "u8", "i8", "f2", "f4", "f8"}
COMMENTS = ("#", "//")
ROWS_A_TIME = 100_000


def read_text(path):
    """Read a table of numbers. Integer columns become int64, all others float64."""
    try:
        skip, names, first, delimiter = _inspect(path)
    except UnicodeDecodeError as err:
        raise PointFileError("is not a text file in UTF-8") from err
    if len(first) < 3:
        raise PointFileError(
            f"line {skip + 1} has {len(first)} column(s); at least 3 (x, y, z) are needed"
        )
    if names is not None and len(names) != len(first):
        raise PointFileError(
            f"the header names {len(names)} columns, line {skip + 1} has {len(first)}"
        )
    with open(path, encoding="utf-8-sig") as file:
        try:
            table = np.loadtxt(file, delimiter=delimiter, skiprows=skip, ndmin=2, quotechar='"')
        except ValueError as err:
            raise PointFileError(_what_is_wrong(path, skip, len(first), delimiter)) from err
    cloud = split_table(table, names)
    written_as = dict(zip(names or _column_names(len(first)), first, strict=True))
    for name, values in cloud.attributes.items():
        # Class numbers and labels stay integers; above 2**53 a float64 does not hold all integers.
        is_integer = written_as[name].strip().lstrip("+-").isdigit()
        if is_integer and (np.abs(values) <= 2**53).all() and (values == np.rint(values)).all():
            cloud.attributes[name] = values.astype(np.int64)
    return cloud


def write_text(path, cloud):
    """Write a table with the fewest digits that give the same numbers when read."""
    columns = {
        name: fit_dtype(name, values, NUMBERS, "a text file")
        for name, values in flat_columns(cloud.attributes).items()
    }
    is_csv = path.suffix == ".csv"
    with open(path, "w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, delimiter="," if is_csv else " ", lineterminator="\n")
        if is_csv or columns:  # every program reads .xyz with coordinates alone and no header
            writer.writerow(["x", "y", "z", *columns])
        for rows in text_rows([*cloud.xyz.T, *columns.values()]):
            writer.writerows(rows)


def text_rows(columns):
    """Rows of strings in chunks, each number in its shortest exact form."""
    for start in range(0, len(columns[0]), ROWS_A_TIME):
        part = [column[start : start + ROWS_A_TIME] for column in columns]
        text = [c.astype(str).tolist() if c.dtype.kind == "f" else c.tolist() for c in part]
        yield zip(*text, strict=True)


def split_table(table, names=None):
    """A cloud from the columns of a table: x, y, z by name, else the first three."""
    if names is None:
        names = _column_names(table.shape[1])
    for name in names:
        if names.count(name) > 1:
            raise PointFileError(f"two columns are named {name!r}; rename one")
    positions = xyz_positions(names) or [0, 1, 2]
    attributes = {name: table[:, i].copy() for i, name in enumerate(names) if i not in positions}
    xyz = table[:, :3] if positions == [0, 1, 2] else table[:, positions]
    return PointCloud(np.ascontiguousarray(xyz, dtype=np.float64), attributes)


def xyz_positions(names):
    """Positions of x, y and z among the names, in upper or lower case, or None without them."""
    exact = [name if name in "xyz" else name.lower() for name in names]
    found = [axis for axis in "xyz" if axis in exact]
    if found and len(found) < 3:
        missing = ", ".join(axis for axis in "xyz" if axis not in exact)
        raise PointFileError(f"no coordinate named {missing} among {', '.join(names)}")
    return [exact.index(axis) for axis in "xyz"] if found else None


def _column_names(n_columns):
    return ["x", "y", "z", *(f"column_{i}" for i in range(4, n_columns + 1))]


def _inspect(path):
    """Lines to skip, column names (or None), the first row's fields, the delimiter."""
    comment = header = None
    with open(path, encoding="utf-8-sig") as file:
        number = 0
        while line := file.readline(1_000_000):
            number += 1
            if "\0" in line or (len(line) == 1_000_000 and not line.endswith("\n")):
                raise PointFileError("is not a text file")
            text = line.strip()
            if not text:
                continue
            if text.startswith(COMMENTS) and header is None:
                comment = text.lstrip("#/").strip()
                continue
            bare = re.sub(r'"[^"]*"', "", text)  # delimiters within quotes do not count
            delimiter = ";" if ";" in bare else "," if "," in bare else None
            fields = _fields(text, delimiter)
            if not _is_row(fields) and _is_row([field.replace(",", ".") for field in fields]):
                raise PointFileError(f"line {number} has decimal commas: replace them by points")
            if _is_row(fields):
                names = None
                if header is not None:
                    names = _names(header, delimiter)
                elif comment is not None:
                    # Only a comment that names x, y, z and every column is a header.
                    candidates = _names(comment, delimiter)
                    if len(candidates) == len(fields) and {"x", "y", "z"} <= {
                        c.lower() for c in candidates
                    }:
                        names = candidates
                return number - 1, names, fields, delimiter
            if header is not None:
                bad = next(f for f in fields if not _is_row([f]))
                raise PointFileError(
                    f"line {number}: {bad.strip()[:40]!r} is not a number; "
                    "columns of text must be removed or encoded"
                )
            header = text
    header = f" (line 1 counts as header: {header[:40]!r})" if header else ""
    raise PointFileError(f"holds no row of numbers{header}, so no points")


def _what_is_wrong(path, skip, n_columns, delimiter):
    """The first line that is no row of the table, numbered as in an editor."""
    with open(path, encoding="utf-8-sig", errors="replace") as file:
        for number, line in enumerate(file, start=1):
            text = line.partition("#")[0].strip()
            if number <= skip or not text:
                continue
            fields = _fields(text, delimiter)
            if len(fields) != n_columns:
                return f"line {number} has {len(fields)} columns, line {skip + 1} has {n_columns}"
            for value in fields:
                if not _is_row([value]):
                    return f"line {number}: {value.strip()[:40]!r} is not a number"
    return "is not a table of numbers in UTF-8"


def _names(header, delimiter):
    """Names of columns. A column without a name, as pandas and R write row names, gets one."""
    fields = _fields(header, delimiter)
    return [name or f"column_{i}" for i, name in enumerate(fields, start=1)]


def _fields(line, delimiter):
    """The fields of a line, without quotes around them."""
    if delimiter is None:
        line = " ".join(line.split())
    row = next(csv.reader([line], delimiter=delimiter or " ", skipinitialspace=True))
    return [field.strip() for field in row]


def _is_row(fields):
    try:
        for value in fields:
            float(value)
    except ValueError:
        return False
    return True
