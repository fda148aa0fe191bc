"""Which columns of a table are x, y and z, by the names that people give them; where there are no
names, whether the first three look like coordinates."""

import re
import unicodedata
from typing import NamedTuple

import numpy as np

from sklearn_mcmd._errors import ParameterError
from sklearn_mcmd.io._no_returns import LARGE
from sklearn_mcmd.io._point_cloud import RESERVED, PointFileError

AXES = {  # without accents; English, German, French, Spanish and Italian
    "x": {"x", "e", "east", "easting", "eastings", "points 0", "rechtswert", "ost", "est", "este"},
    "y": {"y", "n", "north", "northing", "northings", "points 1", "hochwert", "nord", "norte"},
    "z": {"z", "h", "u", "up", "elev", "elevation", "height", "alt", "altitude", "points 2"}
    | {"hohe", "hoehe", "hauteur", "altitud", "altura", "elevacion", "cota"}
    | {"altitudine", "altezza", "elevazione", "quota"},
}
# Names of other columns, which tell that a comment names columns, too.
OTHERS = {"longitude", "lon", "latitude", "lat", "time", "range", "azimuth", "intensity"}
# Words of sentences, which name no columns.
SPEECH = "and at by for from in is of on the to with und aus der die das von mit et de par por con"
# Words beside the axis: "X[m]", "x_ft", "POINT_X", "utm_x", "X coordinate".
BESIDE = {"m", "mm", "cm", "km", "ft", "feet", "usft", "meter", "meters", "metre", "metres"}
BESIDE |= {"coord", "coordinate", "point", "pos", "position", "utm"}
BESIDE |= {"koordinate", "coordonnee", "coordenada", "coordinata"}
ROWS = 100_000  # of a table without names that are looked at
REMEDY = ParameterError(
    "say which they are, as in $columns", columns={"x": "easting", "y": "northing", "z": "height"}
)


def coordinate_columns(names, columns=None):
    """Positions of x, y and z among the names of columns, or as `columns` of `read_points` say."""
    chosen = {axis: [_position(names, column)] for axis, column in (columns or {}).items()}
    sought = [axis for axis in "xyz" if axis not in chosen]
    plain = [_plain(name) for name in names]
    for spelled in ([name.lower() for name in names], plain):  # x, y, z come before other names
        if all(spelled.count(axis) == 1 for axis in sought):
            candidates = chosen | {axis: [spelled.index(axis)] for axis in sought}
            break
    else:
        candidates = chosen | {axis: _of_axis(plain, axis) for axis in sought}
    among = f"among the columns {', '.join(names)[:300]}: {REMEDY}"
    for axis in sought:
        if len(candidates[axis]) > 1:
            which = " or ".join(repr(names[i]) for i in candidates[axis])
            raise PointFileError(f"{axis} may be {which} {among}") from REMEDY
    if missing := [axis for axis in sought if not candidates[axis]]:
        raise PointFileError(f"no {', '.join(missing)} {among}") from REMEDY
    positions = [candidates[axis][0] for axis in "xyz"]
    if len(set(positions)) < 3:
        error = ParameterError("x, y and z need three columns, got $columns", columns=columns)
        raise PointFileError(str(error)) from error
    return positions


def attribute_name(name):
    """What a column that is no coordinate is called."""
    return f"{name}_value" if name.lower() in RESERVED else name


def are_names(fields, told=()):
    """Whether a comment names columns: at least two of its fields are known names, or `told`.

    A letter alone may be a word of a sentence: one does not count without another.
    """
    plain = [_plain(field) for field in fields]
    by_axis = [{plain[i] for i in _of_axis(plain, axis)} for axis in "xyz"]
    n_letters = sum(max(map(len, names), default=0) == 1 for names in by_axis)
    n_axes = sum(map(bool, by_axis)) - (n_letters == 1)
    n_others = len(OTHERS.intersection(" ".join(plain).split()))
    return n_axes + n_others + len(set(told).intersection(fields)) >= 2


def no_sentence(words):
    """Whether words may be names: each is there once and has a letter, none is of a sentence."""
    name = r"(?!v?\d+[.]\d)\W*[^\W\d].*(?<![.:!?])$"  # and no version
    plain = {w.lower() for w in words if re.match(name, w)}
    return len(plain) == len(words) and plain.isdisjoint(SPEECH.split())


def _of_axis(plain, axis):
    """Columns that may be an axis. Words come before what means many things: letters, "est"."""
    columns = [i for i, name in enumerate(plain) if name in AXES[axis]]
    return [i for i in columns if len(plain[i]) > 1 and plain[i] != "est"] or columns


def _plain(name):
    """The words of a name in lower case, without accents, units and the like."""
    words = re.findall(r"[^\W\d_]+|\d+", without_accents(name.lower()))
    return " ".join(word for word in words if word not in BESIDE)


def without_accents(text):
    letters = unicodedata.normalize("NFKD", text)
    return "".join(letter for letter in letters if not unicodedata.combining(letter))


def _position(names, column):
    """Position of a column, by its name in any case or by its number from 1 on."""
    names = [unicodedata.normalize("NFC", name) for name in names]
    column = unicodedata.normalize("NFC", str(column))
    for spelled in (names, [name.lower() for name in names]):
        if column in spelled:
            return spelled.index(column)
    if column.isdecimal() and 1 <= int(column) <= len(names):
        return int(column) - 1
    raise PointFileError(f"no column {column!r} among {', '.join(names)[:300]}")


class UnnamedLimits(NamedTuple):
    """Which tables have a row of each coordinate, or numbers, rows or times of points first."""

    rows: int = 5  # that tell: fewer are no plane with a point to spare
    alike: float = 0.1  # share of the usual step within which steps are alike, though rounded
    largest: float = 1.4e8  # of coordinates, in feet around the Earth; seconds since 1970 are more
    week: float = 604_800.0  # seconds of a week, of which times of satellites are
    turned: float = 3.0  # times as many columns as rows, of which there are less than ten


def check_turned(shape):
    """Refuse a table that has a row of each coordinate, as it seems."""
    n_rows, n_columns = shape
    if 3 <= n_rows < min(10, n_columns / UnnamedLimits().turned):
        raise PointFileError(f"holds {n_rows} points of {n_columns:,} columns: transpose it?")


def check_first_columns(table, start):
    """Refuse a table (n, m) that begins, at `start`, with numbers, rows or times of points."""
    check_turned(table.shape)
    table = table[:ROWS]
    at = [j for j, values in enumerate(table.T) if not np.isnan(values).all()][:5]  # no words
    table = table[:, at].astype(np.float64)
    table = table[np.isfinite(table).all(axis=1)]
    limits, n = UnnamedLimits(), len(table)
    if len(at) < 4 or n < limits.rows:
        return
    steps, sizes = np.diff(table, axis=0), np.median(np.abs(table), axis=0)
    small, whole = sizes < LARGE, (table == np.rint(table)).all(axis=0)
    usual = np.median(steps, axis=0)
    alike = (np.abs(steps - usual) <= limits.alike * np.abs(usual)).sum(axis=0)
    # A row and a column of a grid come first: two columns of small whole numbers.
    # Behind x, y, z are integers or shares, as of normals; behind a row and a column are x, y, z.
    is_cell = len(at) == 5 and (whole & small)[:2].all() and table[:, :2].min() >= 0
    is_more = whole[3:].any() or np.abs(table[:, 3:]).max() <= 1
    is_cell &= not whole[2] and not (small[2:4].any() and is_more)
    # A number of each point beside coordinates with decimals; or seconds of the week before large
    # coordinates; or steps that are alike, in more than half of the rows by at least five.
    is_number = whole[0] and not whole[1:3].all() and len(np.unique(table[:, 0])) == n
    before_large = sizes[0] <= limits.week and not (small | whole)[1:3].any()
    rises = steps[:, 0].min() > 0 and 2 * alike[0] - n >= limits.rows
    if (
        is_cell
        or (before_large and ((small[0] and whole[0]) or steps[:, 0].min() >= 0))
        or sizes[0] > limits.largest > sizes[1:3].max()
        or ((is_number or rises) and alike[1] < n - 1)  # no profile, nor one row of a grid
    ):
        error = naming_columns([j + 1 for j in at[1 + is_cell :]])
        raise PointFileError(
            f"{start}: column 1 seems to be a number, a row or a time of points: {error} (x=1,y=2,"
            "z=3 if it is x; x and y change places if north comes first)"
        ) from error


def naming_columns(numbers):
    """The remedy where no names tell which columns are coordinates, by their likely numbers."""
    columns = dict(zip("xyz", numbers, strict=False))
    return ParameterError("say which are x, y and z, as in $columns", columns=columns)
