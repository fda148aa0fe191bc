"""XYZ, ASC, TXT, CSV and PTS: many layouts of text, with or without a header."""

import codecs
import csv
import re
import sys
import warnings
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import chain, islice
from typing import Any

import numpy as np

from sklearn_mcmd._errors import counted, warn_caller
from sklearn_mcmd.io._column_names import (
    are_names,
    attribute_name,
    check_first_columns,
    coordinate_columns,
    naming_columns,
    no_sentence,
)
from sklearn_mcmd.io._numerals import MISSING, filled, named_nans, number_of, plain_numbers
from sklearn_mcmd.io._point_cloud import (
    COLORS,
    PointCloud,
    PointFileError,
    colors_of_bytes,
    fit_dtype,
    flat_columns,
    warn_of_lost,
)

NUMBERS = {"u1", "i1", "u2", "i2", "u4", "i4", "u8", "i8", "f2", "f4", "f8"}  # dtypes written
LAYOUT: dict[str, Any] = {"encoding": "utf-8", "quotechar": '"'}  # of what NumPy reads
COMMENTS = ("#", "//")  # begin a line that is no row
ROWS_A_TIME = 100_000  # that are read and written at once
LIST = re.compile(r"(?<!\d),|,(?!\d)")  # commas that are no part of a number
GROUPS = re.compile(r"[+-]?\d{1,3}(?: \d{3})*")  # thousands apart, as it may be
WHOLE = r"[+-]?(?:0|[1-9]\d*)"
TWICE = re.compile(rf"{WHOLE},0\d+(,{WHOLE},\d+){{2,}}\s*")  # only decimals begin with zeros
COMMAS = "decimal commas: write points, and no commas between thousands"
IN_DOUBT = re.compile(r"[+-]?[1-9]\d{0,2},\d{3}")  # thousands, or three decimals
LONGEST, MOST_HEADERS = 1_000_000, 10  # characters of a line, and lines before the first row
COLUMNS = {  # what rows may have; the first that a cloud has is written
    ".pts": (("intensity", *COLORS), COLORS, ("intensity",), ()),
    ".xyzn": (("normal_x", "normal_y", "normal_z"), ()),
    ".xyzrgb": (COLORS, ()),
}


def read_text(path, columns=None):
    """Read a table of numbers. Integer columns become int64 or uint64, all others float64."""
    with _opened(path) as file:
        table = _begin(file, columns, path.suffix.lower())
        table.read(chain([table.head.line], file))
    if table.head.names is None and columns is None:
        check_first_columns(table.parts[0], f"line {table.head.number}")
    left_out = [
        f"{table.names[j]} (line {number}: {_decoded(value)[:40]!r})"
        for j, (number, value) in table.words.items()
    ]
    if left_out:
        warn_caller(f"{path}: columns with words are left out: {', '.join(left_out)}")
    attributes: dict[str, np.ndarray] = {}
    for j, name in enumerate(table.names):
        if j in table.positions or j in table.words:
            continue
        if name in attributes:
            raise PointFileError(f"two columns are named {name!r}; rename one")
        values = np.concatenate([part[:, j] for part in table.parts])
        if name == f"column_{j + 1}" and np.isnan(values).all():
            continue  # of trailing delimiters
        if ((values == np.rint(values)) | np.isnan(values)).all():
            if (np.abs(values) >= 2**53).any():  # which double precision may round
                values = _large_integers(path, table, j, values)
            elif table.fields[j].lstrip("+-").isdigit() and not np.isnan(values).any():
                values = values.astype(np.int64)  # class numbers and labels stay integers
        attributes[attribute_name(name)] = values
    if np.count_nonzero(counts := table.head.counts) > 1:
        attributes["scan_index"] = np.repeat(np.arange(len(counts), dtype=np.int32), counts)
    xyz = np.concatenate([part[:, table.positions] for part in table.parts])
    return PointCloud(xyz, _with_bytes(path, attributes))


def write_text(path, cloud):
    """Write a table with the fewest digits that give the same numbers when read."""
    columns, is_fixed = flat_columns(cloud.attributes), path.suffix in COLUMNS
    if is_fixed:
        columns = _fitting(path.suffix, columns)
    columns = {n: fit_dtype(n, values, NUMBERS, "a text file") for n, values in columns.items()}
    is_csv = path.suffix == ".csv"
    layout: dict[str, Any] = {"delimiter": "," if is_csv else " ", "lineterminator": "\n"}
    for name in columns:
        if {"\n", "\r"} & set(name):
            raise PointFileError(f"attribute name {name!r} has several lines; rename it")
    has_delimiters = any(set(";,\t") & set(name) for name in columns)
    with open(path, "w", encoding="utf-8", newline="") as file:
        if is_csv or (columns and not is_fixed):  # every program reads .xyz without a header
            quoting = {"quoting": csv.QUOTE_ALL if has_delimiters else csv.QUOTE_MINIMAL}
            csv.writer(file, **layout | quoting).writerow(["x", "y", "z", *columns])
        if path.suffix == ".pts":
            file.write(f"{len(cloud)}\n")
        writer = csv.writer(file, **layout)
        for start in range(0, len(cloud), ROWS_A_TIME):
            rows = slice(start, start + ROWS_A_TIME)
            part = [column[rows] for column in (*cloud.xyz.T, *columns.values())]
            text = [c.astype(str).tolist() if c.dtype.kind == "f" else c.tolist() for c in part]
            writer.writerows(zip(*text, strict=True))


def _opened(path):
    with open(path, "rb") as file:
        is_utf16 = file.read(2) in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
    encoding = "utf-16" if is_utf16 else "utf-8-sig"
    return open(path, encoding=encoding, errors="surrogateescape")


def _large_integers(path, table, j, values):
    """A column read again: exact if 64 bits hold it, else a warning names what is rounded."""
    for dtype in (np.int64, np.uint64):
        with _opened(path) as file, suppress(ValueError, Warning), warnings.catch_warnings():
            warnings.simplefilter("error")  # of integers read as float64
            lines, options = islice(file, table.head.number - 1, None), LAYOUT | {"usecols": j}
            exact = np.loadtxt(lines, dtype, ndmin=1, delimiter=table.delimiter, **options)
            if np.array_equal(exact.astype(float), values):
                return exact
    with _opened(path) as file:
        rows = (table.row(line) for line in islice(file, table.head.number - 1, None))
        cells = (row[j] for row in rows if len(row) == len(table.names))
        if any(int(c) != float(c) for c in cells if re.fullmatch(r"[+-]?\d{16,400}", c)):
            warn_caller(
                f"{path}: integers of {table.names[j]} are rounded to 53 bits: 64 do not hold all"
            )
    return values


@dataclass
class _Head:
    """What stands above the rows, and the first line of these."""

    positions: list  # of x, y, z
    names: list | None = None  # fields of the header that has these
    headers: list = field(default_factory=list)  # fields of each line that is no row
    comments: list = field(default_factory=list)  # fields of each comment that names columns
    last: str = ""  # comment, which may name them, too
    counts: list = field(default_factory=list)  # of points of each scan, empty if not given
    counted_at: int = 0  # number of the last count's line
    delimiter: str | None = None  # None is whitespace
    line: str = ""
    number: int = 0

    def is_row(self, columns):
        """Whether the line is the first row: it has a value for a coordinate. Keep what it says."""
        if self.names is None or len(_fields(self.line, self.delimiter)) != len(self.names):
            self.delimiter = _delimiter(self.line)
        fields = _fields(self.line, self.delimiter)
        if len(fields) == 2 and fields[0].lower() in ("ncols", "nrows"):
            raise PointFileError("is an ESRI ASCII grid: convert it by gdal_translate -of XYZ")
        if len(fields) == 1 and fields[0].isdecimal() and not any(self.counts):  # as in PTS
            self.counts.append(int(fields[0]))
            self.counted_at = self.number
        elif any(_is_value(fields[i]) for i in self.positions if i < len(fields)):
            return True
        else:
            self.headers.append(fields)
            if self.names is None:
                with suppress(PointFileError):  # a title, or raised by `_head`
                    self.positions, self.names = coordinate_columns(fields, columns), fields
        return False


def _head(file, columns):
    """What stands above the first row."""
    chosen = list(columns.values()) if columns else []
    by_number = len(chosen) == 3 and all(str(column).isdecimal() for column in chosen)
    head = _Head([int(column) - 1 for column in chosen] if by_number else [0, 1, 2])
    while True:
        head.line = line = named_nans(_decoded(file.readline(LONGEST)))
        head.number += 1
        if not line or len(head.headers) > MOST_HEADERS:
            first = head.headers[0] if head.headers else []
            if head.names is None and len(first) >= 3:
                coordinate_columns(first, columns)
            header = f" (header: {', '.join(first)[:40]!r})" if head.headers else ""
            raise PointFileError(f"holds no row of numbers{header}, so no points")
        if "\0" in line or (len(line) == LONGEST and not line.endswith("\n")):
            raise PointFileError("is not a text file")
        text = line.strip()
        if text.startswith(COMMENTS):
            text = head.last = text.lstrip("#/ ")
            names = _fields(text)
            # Fields between commas, without blanks or numbers, are names even if none is known.
            is_list = " " not in text and _delimiter(text) and not any(map(_is_value, names))
            if is_list or are_names(names, () if by_number else chosen):
                head.comments.append(names)
        elif text and head.is_row(columns):
            return head


def _begin(file, columns, extension):
    """The table whose rows are to be read, the first of which its head has."""
    head = _head(file, columns)
    fields, is_guess = _row(head.line, head.delimiter, len(head.names or ())), False
    if len(fields) < 3:
        raise PointFileError(f"line {head.number} has {len(fields)} columns, x, y, z are 3")
    if head.names is None:
        head.names, is_guess = _names_above(head, fields, columns)
    if head.names is None:
        # The format names what follows x, y and z.
        n = len(fields) - 3
        layouts = (names for names in COLUMNS.get(extension, ()) if len(names) == n)
        names = ["", "", "", *next(layouts, [""] * n)]
    else:
        # A separator at the end of the header, or of the rows, makes a column without a name.
        if head.names[-1] == "" and len(head.names) == len(fields) + 1:
            head.names = head.names[:-1]
        if fields[-1] == "" and len(fields) == len(head.names) + 1:
            head.names = [*head.names, ""]
        names = head.names
        if len(fields) != len(names):
            words = f"header has {len(names)} columns, line {head.number} has {len(fields)}"
            raise PointFileError(words + _more(fields, head.delimiter, len(names)))
    names = [name or f"column_{i}" for i, name in enumerate(names, start=1)]
    if head.names is not None or columns:
        try:
            head.positions = coordinate_columns(names, columns)
        except PointFileError as err:
            more = "; or x=1,y=2,z=3 if the comment above them names none" * is_guess
            raise PointFileError(f"{err}{more}") from err.__cause__
    table = _Table(head, fields, names)
    table.find_decimals(fields, head.line, head.number)
    return table


def _names_above(head, fields, columns):
    """Names of columns by a line above the first row, if any, and whether that is a guess.

    Lines with as many fields as the row come first, of these the first that has x, y and z. The
    last comment is a guess: of as many words, that make no sentence.
    """
    widths = {len(fields), len(fields) - (fields[-1] == "")}
    lines = [names for names in head.headers + head.comments if len(names) in widths]
    for names in lines:
        with suppress(PointFileError):
            coordinate_columns(names, columns)
            return names, False
    if lines or head.headers:
        return (lines + head.headers)[0], False
    words = _fields(head.last, head.delimiter)
    is_guess = len(words) in widths - {3} and no_sentence(words)
    return (words if is_guess else None), is_guess


@dataclass
class _Table:
    """Rows below a head, and what reading them shows on the way."""

    head: _Head
    fields: list  # of the first row
    names: list
    parts: list = field(default_factory=list)
    words: dict = field(default_factory=dict)  # columns with words: line and text of the first
    gaps: set = field(default_factory=set)  # columns with gaps
    comma: bool | None = None  # whether commas are decimal: None until a number tells

    def __post_init__(self):
        self.at = self.head.number  # of the next line
        self.delimiter, self.positions = self.head.delimiter, self.head.positions
        if self.delimiter == ",":
            self.comma = False

    def read(self, lines):
        """Read all rows. Where the file tells how many, other scans may follow with their own."""
        left = self.head.counts[-1] if self.head.counts else sys.maxsize
        while part := list(islice(lines, min(ROWS_A_TIME, left) or 1)):
            if left:
                self.parts.append(self._part(part))
                left -= len(self.parts[-1])
            elif any(fields := self.row(plain_numbers(part[0], self.comma))):
                if len(fields) > 1 or not fields[0].isdecimal():
                    raise PointFileError(f"{self._promise()}, line {self.at} is one more")
                left, self.head.counted_at = int(fields[0]), self.at
                self.head.counts.append(left)
            self.at += len(part)
        if self.head.counts and left > 0:
            raise PointFileError(f"{self._promise()}, found {self.head.counts[-1] - left:,}")

    def _promise(self):
        n_points = self.head.counts[-1]
        return f"line {self.head.counted_at} promises {counted(n_points, 'point')}"

    def _part(self, lines):
        """A table of lines: as NumPy reads them, else with other numbers, else cell by cell."""
        if self.delimiter == "," and self.head.names is None:
            for number, line in enumerate(lines, self.at):
                if ",0" in line and TWICE.fullmatch(line):
                    raise PointFileError(f"line {number} has {COMMAS}")
        if max(map(len, lines)) > LONGEST:
            raise PointFileError(f"a line has more than {LONGEST:,} characters: is no table")
        table = None if self.comma else self._parsed(lines)
        if table is None:
            table = self._parsed([plain_numbers(line, self.comma) for line in lines])
        if table is None:
            return self._slow(lines)
        for number, line in enumerate(lines, self.at):
            if self.comma is not None:
                break
            if "." in line:
                self.find_decimals(self.row(line), line, number)
        return table

    def _parsed(self, lines):
        """The table of lines that NumPy can read, else None."""
        converters = dict.fromkeys(self.gaps, filled)
        converters |= dict.fromkeys(self.words, lambda cell: np.nan)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # of a part without rows
                options = {"converters": converters, "comments": None, **LAYOUT}
                table = np.loadtxt(lines, delimiter=self.delimiter, ndmin=2, **options)
        except ValueError:
            return None
        return table if table.shape[1] == len(self.names) else None

    def row(self, line):
        """The fields of a row."""
        return _row(line, self.delimiter, len(self.names))

    def _slow(self, part):
        """A table of lines that NumPy cannot read; columns with words and gaps are remembered."""
        rows, numbers, width = [], [], len(self.names)
        for at, line in enumerate(part, start=self.at):
            fields = self.row(line)
            if not any(fields):
                continue
            if len(fields) != width:
                told = f"; {self._promise()}" if self.head.counts else ""
                words = f"line {at} has {len(fields)} columns, line {self.head.number} has {width}"
                raise PointFileError(words + told + _more(fields, self.delimiter, width))
            self.find_decimals(fields, line, at)
            rows.append(fields)
            numbers.append(at)
        table = np.full((len(rows), width), np.nan)
        for j, cells in enumerate(zip(*rows, strict=True)):
            if j in self.positions:
                table[:, j] = [
                    self._coordinate(cell, line) for cell, line in zip(cells, numbers, strict=True)
                ]
            elif j not in self.words:
                values = [number_of(cell, self.comma) for cell in cells]
                table[:, j] = values  # None becomes NaN
                if None in values:
                    i = values.index(None)
                    self.words[j] = numbers[i], cells[i]
                elif np.isnan(table[:, j]).any():
                    self.gaps.add(j)
        return table

    def find_decimals(self, fields, line, number):
        """Learn from the first number with a comma or point which of them is decimal."""
        if self.comma is None and len(fields) == len(self.names):
            # Of one row coordinates tell before attributes.
            cells = [fields[j] for j in self.positions]
            cells += [cell for j, cell in enumerate(fields) if j not in self.positions]
            self.comma = _decimal(cells, line, number, is_loose=self.delimiter is None)

    def _coordinate(self, cell, number):
        value, words = number_of(cell, self.comma), f"line {number}: {_decoded(cell)[:40]!r}"
        if value is not None and cell.lower() not in MISSING:
            return value
        words += " is not a number"
        likely = [
            j for j, one in enumerate(self.fields, 1) if number_of(one, self.comma) is not None
        ]
        if value is not None:
            words += "; write nan for a point that has no coordinates"
        elif self.head.names is None and number == self.head.number and len(likely) >= 3:
            error = naming_columns(likely)
            raise PointFileError(f"{words}: {error}") from error
        elif self.delimiter != ",":
            if number_of(cell, not self.comma) is not None:
                words += f" with a decimal {'comma' if self.comma else 'point'}, as those above"
        elif re.fullmatch(r"[+-]?\d*,\d+|\d+\s+[+-]?\d+", cell):
            words = f"line {number} has {COMMAS}"
        raise PointFileError(words)


def _decimal(cells, line, number, is_loose):
    """Whether commas are decimal in some cells of a line, None if no number tells.

    Quotes, and rows that are `is_loose`, between blanks, leave thousands open.
    """
    is_loose &= all("," not in cell or IN_DOUBT.fullmatch(cell) for cell in cells)
    for cell in cells:
        points, commas = number_of(cell), number_of(cell, comma=True)
        if {",", "."} & set(cell) and {points, commas} != {None}:
            is_quoted = f'"{cell}"' in line
            if points is None and IN_DOUBT.fullmatch(cell) and (is_quoted or is_loose):
                way = "without quotes" if is_quoted else "with a point"
                raise PointFileError(
                    f'line {number}: are there thousands or decimals behind the comma of "{cell}"? '
                    f"Write it {way} if decimals, and without commas if thousands"
                )
            return points is None
    return None


def _more(fields, delimiter, width):
    """What to say of a row of more columns, which may have decimals in columns of their own."""
    more = len(fields) > width and all(cell.lstrip("+-").isdecimal() for cell in fields)
    return "; if it has decimal commas, write points" * (more and delimiter == ",")


def _is_value(cell):
    """Whether a cell belongs to a row: a number or what resembles one, but no words."""
    resembles = re.match(r"[+-]?[.,]?\d|[^\w\s\[(]+$", cell)
    return bool(cell) and (resembles is not None or number_of(cell) is not None)


def _delimiter(line):
    """Semicolon, tab or comma; None is whitespace. Those within quotes do not count."""
    bare = re.sub(r'"[^"]*"', "q", line)
    if ";" in bare:
        return ";"
    cells = bare.split("\t")[:3]
    if len(cells) == 3 and all(cell.strip() and not LIST.search(cell) for cell in cells):
        return "\t"
    if "," not in bare or LIST.search(bare) or all(map(GROUPS.fullmatch, bare.strip().split(","))):
        return "," if "," in bare else None
    # Each comma is within a number between blanks: a decimal one, or of thousands before a point.
    words = [c for c in bare.split() if {number_of(c), number_of(c, comma=True)} == {None}]
    return "," if any("," in word for word in words) or len(bare.split()) < 3 + len(words) else None


def _row(line, delimiter, width):
    """The fields of a row without a comment after them, unless the sign # belongs to the row."""
    line = named_nans(line)
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


def _with_bytes(path, attributes):
    """The attributes with colors of 8 bits; colors that are no such are left as they are.

    Those of XYZRGB go from 0 to 1. Where one is larger, a program wrote 0 to 255.
    """
    extension = path.suffix.lower()
    if extension not in COLUMNS or not attributes.keys() >= set(COLORS):
        return attributes
    colors = np.array([attributes[color] for color in COLORS], float)
    shares = extension == ".xyzrgb" and colors.max() <= 1
    colors *= 255 if shares else 1
    whole = np.rint(colors)
    off = np.abs(colors - whole).max()
    if not (whole.min() >= 0 and whole.max() <= 255 and (shares or off == 0)):
        return attributes
    if off > 255 * 0.0005:  # more than three decimals leave
        warn_caller(f"{path}: colors are rounded to 8 bits")
    return attributes | dict(zip(COLORS, whole.astype(np.uint8), strict=True))


def _fitting(extension, columns):
    """The columns that a format holds, with a warning of all others."""
    format_name, (columns, are_rounded) = extension[1:].upper(), colors_of_bytes(columns)
    kept = {
        name: values
        for name, values in columns.items()
        if name not in COLORS
        or (values.dtype.kind in "iu" and values.min() >= 0 and values.max() <= 255)
    }
    names = next(names for names in COLUMNS[extension] if kept.keys() >= set(names))
    lost = [name for name in columns if name not in names]
    if "outlier" in lost:
        raise PointFileError(f"{format_name} has no place to mark outliers; write another format")
    holds = f"{format_name} holds x, y, z and {', '.join(COLUMNS[extension][0])}"
    warn_of_lost(holds, lost, COLORS if are_rounded and "red" in names else ())
    return {name: kept[name] / 255 if extension == ".xyzrgb" else kept[name] for name in names}
