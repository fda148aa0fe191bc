"""Which columns of a table are x, y and z, by the names that people give them."""

import re
import unicodedata

from sklearn_mcmd._errors import ParameterError
from sklearn_mcmd.io._point_cloud import RESERVED, PointFileError

AXES = {  # without accents; English, German, French, Spanish and Italian
    "x": {"x", "e", "east", "easting", "eastings", "points 0", "rechtswert", "ost", "est", "este"},
    "y": {"y", "n", "north", "northing", "northings", "points 1", "hochwert", "nord", "norte"},
    "z": {"z", "h", "u", "up", "elev", "elevation", "height", "alt", "altitude", "points 2"}
    | {"hohe", "hoehe", "hauteur", "altitud", "altura", "elevacion", "cota"}
    | {"altitudine", "altezza", "elevazione", "quota"},
}
# Words that tell that a comment names columns.
KNOWN = {"longitude", "lon", "latitude", "lat", "time", "range", "azimuth", "intensity"}
KNOWN = KNOWN.union(*AXES.values())
# Words beside the axis: "X[m]", "x_ft", "POINT_X", "utm_x", "X coordinate".
BESIDE = {"m", "mm", "cm", "km", "ft", "feet", "usft", "meter", "meters", "metre", "metres"}
BESIDE |= {"coord", "coordinate", "point", "pos", "position", "utm"}
BESIDE |= {"koordinate", "coordonnee", "coordenada", "coordinata"}
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
    """Whether a comment names columns: at least two of its fields are `told`, or have known words.

    A letter alone may be a word of a sentence: one does not count without another.
    """
    known = [KNOWN.intersection([words, *words.split()]) for words in map(_plain, fields)]
    n_letters = sum(max(map(len, words), default=0) == 1 for words in known)
    n_told = len(set(told).intersection(fields))
    return sum(map(bool, known)) - (n_letters == 1) + n_told >= 2


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
