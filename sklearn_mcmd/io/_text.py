"""XYZ, TXT and CSV: many layouts of text, with or without a header; any numeric columns."""

import csv
import re
import warnings
from contextlib import suppress
from itertools import chain, islice
from typing import NamedTuple

import numpy as np

from sklearn_mcmd._errors import counted, warn_caller
from sklearn_mcmd.io._column_names import attribute_name, coordinate_columns, n_known_axes
from sklearn_mcmd.io._point_cloud import (
    PointCloud,
    PointFileError,
    fit_dtype,
    flat_columns,
)

__all__ = ["read_text", "text_rows", "write_text"]

NUMBERS = {"u1", "i1", "u2", "i2", "u4", "i4", "u8", "i8", "f2", "f4", "f8"}
COMMENTS = ("#", "//")
MISSING = {"", "na", "n/a", "null", "none"}
ROWS_A_TIME = 100_000
LONGEST, MOST_HEADERS = 1_000_000, 10  # characters of a line, and lines before the first row


def read_text(path, columns=None):
    """Read a table of numbers. Integer columns become int64 or uint64, all others float64."""
    with _opened(path) as file:
        layout, first = _begin(file, columns)
        tables, words = _tables(chain([first], file), layout)
    n_points = sum(map(len, tables))
    if layout.n_points not in (None, n_points):
        raise PointFileError(f"the file promises {layout.n_points:,} points and holds {n_points:,}")
    left_out = [
        f"{layout.names[j]} (line {number}: {_decoded(value)[:40]!r})"
        for j, (number, value) in words.items()
    ]
    if left_out:
        warn_caller(f"{path}: columns with words are left out: {', '.join(left_out)}")
    attributes = {}
    for j, name in enumerate(layout.names):
        if j in layout.positions or j in words:
            continue
        if name in attributes:
            raise PointFileError(f"two columns are named {name!r}; rename one")
        values = np.concatenate([table[:, j] for table in tables])
        if name == f"column_{j + 1}" and np.isnan(values).all():
            continue  # of trailing delimiters
        if ((values == np.rint(values)) | np.isnan(values)).all():
            if (np.abs(values) >= 2**53).any():
                values = _large_integers(path, layout, j, values)
            elif layout.fields[j].lstrip("+-").isdigit() and not np.isnan(values).any():
                values = values.astype(np.int64)  # class numbers and labels stay integers
        attributes[attribute_name(name)] = values
    return PointCloud(np.concatenate([table[:, layout.positions] for table in tables]), attributes)


def write_text(path, cloud):
    """Write a table with the fewest digits that give the same numbers when read."""
    columns = {
        name: fit_dtype(name, values, NUMBERS, "a text file")
        for name, values in flat_columns(cloud.attributes).items()
    }
    is_csv = path.suffix == ".csv"
    layout = {"delimiter": "," if is_csv else " ", "lineterminator": "\n"}
    for name in columns:
        if {"\n", "\r"} & set(name):
            raise PointFileError(
                f"attribute name {name!r} has several lines, text has one; rename it"
            )
    has_delimiters = any(set(";,\t") & set(name) for name in columns)
    with open(path, "w", encoding="utf-8", newline="") as file:
        if is_csv or columns:  # every program reads .xyz with coordinates alone and no header
            quoting = csv.QUOTE_ALL if has_delimiters else csv.QUOTE_MINIMAL
            csv.writer(file, quoting=quoting, **layout).writerow(["x", "y", "z", *columns])
        writer = csv.writer(file, **layout)
        for rows in text_rows([*cloud.xyz.T, *columns.values()]):
            writer.writerows(rows)


def text_rows(columns):
    """Rows of strings in chunks, each number in its shortest exact form."""
    for start in range(0, len(columns[0]), ROWS_A_TIME):
        part = [column[start : start + ROWS_A_TIME] for column in columns]
        text = [c.astype(str).tolist() if c.dtype.kind == "f" else c.tolist() for c in part]
        yield zip(*text, strict=True)


def _opened(path):
    return open(path, encoding="utf-8-sig", errors="surrogateescape")


def _large_integers(path, layout, j, values):
    """A column read again: exact if all its values are integers, else what is rounded is named."""
    for dtype in (np.int64, np.uint64):
        with _opened(path) as file, suppress(ValueError, Warning), warnings.catch_warnings():
            warnings.simplefilter("error")  # of integers read as float64
            exact = np.loadtxt(
                islice(file, layout.first - 1, None), dtype, delimiter=layout.delimiter,
                usecols=j, ndmin=1, encoding="utf-8", quotechar='"',
            )  # fmt: skip
            if np.array_equal(exact.astype(float), values):
                return exact
    width = len(layout.names)
    with _opened(path) as file:
        rows = (
            _row(line, layout.delimiter, width) for line in islice(file, layout.first - 1, None)
        )
        cells = (row[j] for row in rows if len(row) == width)
        if any(int(c) != float(c) for c in cells if re.fullmatch(r"[+-]?\d{16,400}", c)):
            warn_caller(
                f"{path}: integers of {layout.names[j]} are rounded to 53 bits, because the "
                "column has gaps, or no 64 bits hold all of it"
            )
    return values


class _Layout(NamedTuple):
    """How a table is laid out: its first row, columns, and what the file says of itself."""

    first: int  # number of the first row's line
    fields: list  # of the first row
    delimiter: str | None  # None is whitespace
    names: list
    positions: list  # of x, y, z
    n_points: int | None  # None if the file does not say


def _begin(file, columns):
    """The layout, and the line of the first row. A row has a value for a coordinate."""
    told = list(columns.values()) if columns else []
    numbered = len(told) == 3 and all(str(which).isdecimal() for which in told)
    positions = [int(which) - 1 for which in told] if numbered else [0, 1, 2]
    headers, comment, known, n_points, delimiter, number = [], None, None, None, None, 0
    while True:
        line, number = _decoded(file.readline(LONGEST)), number + 1
        if not line or len(headers) > MOST_HEADERS:
            if known is None and headers and len(headers[0]) >= 3:
                coordinate_columns(headers[0], columns)
            header = f" (header: {', '.join(headers[0])[:40]!r})" if headers else ""
            raise PointFileError(f"holds no row of numbers{header}, so no points")
        if "\0" in line or (len(line) == LONGEST and not line.endswith("\n")):
            raise PointFileError("is not a text file")
        text = line.strip()
        if not text:
            continue
        if text.startswith(COMMENTS):
            names = _fields(text.lstrip("#/ "))
            if comment is None and n_known_axes(names) >= 2:
                comment = names
            continue
        if known is None or len(_fields(line, delimiter)) != len(known):
            delimiter = _delimiter(line)
        fields = _fields(line, delimiter)
        if len(fields) == 1 and fields[0].isdecimal() and n_points is None:  # as in PTS
            n_points = int(fields[0])
        elif any(_is_value(fields[i]) for i in positions if i < len(fields)):
            break
        else:
            headers.append(fields)
            if known is None:
                with suppress(PointFileError):  # a title, or raised below
                    positions, known = coordinate_columns(fields, columns), fields
    fields = _row(line, delimiter, len(known or ()))
    if len(fields) < 3:
        raise PointFileError(
            f"line {number} has {counted(len(fields), 'column')}; at least 3 (x, y, z) are needed"
        )
    if known is None and headers:
        known = next((some for some in headers if len(some) == len(fields)), headers[0])
    if known is None and comment is not None and len(comment) == len(fields):
        known = comment
    if known is not None:
        if known[-1] == "" and len(known) == len(fields) + 1:
            known = known[:-1]
        if fields[-1] == "" and len(fields) == len(known) + 1:
            known = [*known, ""]
        if len(fields) != len(known):
            raise PointFileError(
                f"the header names {len(known)} columns, line {number} has {len(fields)}"
            )
    names = known or [""] * len(fields)
    names = [name or f"column_{i}" for i, name in enumerate(names, start=1)]
    if known is not None or columns:
        positions = coordinate_columns(names, columns)
    return _Layout(number, fields, delimiter, names, positions, n_points), line


def _tables(lines, layout):
    """The table in parts, and the first word of each column that has words: its line and itself."""
    tables, number, words, gaps = [], layout.first, {}, set()
    while part := list(islice(lines, ROWS_A_TIME)):
        converters = dict.fromkeys(gaps, _filled) | dict.fromkeys(words, lambda cell: np.nan)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # of a part without rows
                table = np.loadtxt(
                    part, delimiter=layout.delimiter, converters=converters, ndmin=2,
                    encoding="utf-8", quotechar='"',
                )  # fmt: skip
        except ValueError:
            table = np.empty((0, 0))
        if table.shape[1] != len(layout.names):
            table = _slow_table(part, number, layout, words, gaps)
        tables.append(table)
        number += len(part)
    return tables, words


def _filled(cell):
    value = _number(cell.strip())
    if value is None:
        raise ValueError
    return value


def _slow_table(part, number, layout, words, gaps):
    """A table of lines that NumPy cannot read; columns with words and gaps are remembered."""
    rows, numbers, width = [], [], len(layout.names)
    for at, line in enumerate(part, start=number):
        fields = _row(line, layout.delimiter, width)
        if not any(fields):
            continue
        if len(fields) != width:
            raise PointFileError(
                f"line {at} has {len(fields)} columns, line {layout.first} has {width}"
            )
        rows.append(fields)
        numbers.append(at)
    table = np.full((len(rows), width), np.nan)
    for j, cells in enumerate(zip(*rows, strict=True)):
        if j in layout.positions:
            table[:, j] = [_coordinate(*cell) for cell in zip(cells, numbers, strict=True)]
        elif j not in words:
            values = [_number(cell) for cell in cells]
            table[:, j] = values  # None becomes NaN
            if None in values:
                i = values.index(None)
                words[j] = numbers[i], cells[i]
            elif np.isnan(table[:, j]).any():
                gaps.add(j)
    return table


def _number(cell):
    """The number of a cell, NaN where it is missing, and None of words."""
    try:
        return float(cell) if "_" not in cell else None
    except ValueError:
        return np.nan if cell.lower() in MISSING else None


def _coordinate(cell, number):
    value = _number(cell)
    if value is not None and cell.lower() not in MISSING:
        return value
    if re.fullmatch(r"[+-]?\d*,\d+|\d+\s+[+-]?\d+", cell):
        raise PointFileError(f"line {number} has decimal commas: replace them by points")
    remedy = "" if value is None else "; write nan for a point that has no coordinates"
    raise PointFileError(f"line {number}: {_decoded(cell)[:40]!r} is not a number{remedy}")


def _is_value(cell):
    """Whether a cell belongs to a row: a number or what resembles one, but no words."""
    resembles = re.match(r"[+-]?[.,]?\d|[^\w\s\[(]+$", cell)
    return bool(cell) and (resembles is not None or _number(cell) is not None)


def _delimiter(line):
    """Semicolon, tab or comma; None is whitespace. Those within quotes do not count."""
    bare = re.sub(r'"[^"]*"', "q", line)
    if ";" in bare:
        return ";"
    cells = bare.split("\t")[:3]
    if len(cells) == 3 and all(cell.strip() and "," not in cell for cell in cells):
        return "\t"
    return "," if "," in bare else None


def _row(line, delimiter, width):
    """The fields of a row without a comment after them, unless the sign # belongs to the row."""
    fields, whole = (_fields(text, delimiter) for text in (line.partition("#")[0], line))
    return whole if len(whole) == width else fields


def _fields(line, delimiter=""):
    """The fields of a line, without quotes around them."""
    if delimiter == "":
        delimiter = _delimiter(line)
    line = " ".join(line.split()) if delimiter is None else line.strip(" \r\n")
    row = next(csv.reader([line], delimiter=delimiter or " ", skipinitialspace=True), [])
    return [field.strip() for field in row]


def _decoded(text):
    """Text with bytes that are not UTF-8 taken as Latin-1."""
    if text.isascii() or not any("\udc80" <= character <= "\udcff" for character in text):
        return text
    return text.encode("utf-8", "surrogateescape").decode("latin-1")
