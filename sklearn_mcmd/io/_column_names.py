"""Which columns of a table are x, y and z, by the names that people give them."""

import re

from sklearn_mcmd._errors import ParameterError
from sklearn_mcmd.io._point_cloud import RESERVED, PointFileError

__all__ = ["attribute_name", "coordinate_columns", "n_known_axes"]

AXES = {
    "x": {"x", "e", "east", "easting", "eastings", "rechtswert", "points 0"},
    "y": {"y", "n", "north", "northing", "northings", "hochwert", "points 1"},
    "z": {"z", "h", "u", "up", "elev", "elevation", "height", "alt", "altitude", "points 2"},
}
# Words beside the axis: "X[m]", "x_ft", "POINT_X", "utm_x", "X coordinate".
BESIDE = {"m", "mm", "cm", "km", "ft", "feet", "usft", "meter", "meters", "metre", "metres"}
BESIDE |= {"coord", "coordinate", "point", "pos", "position", "utm"}
REMEDY = ParameterError(
    "say which they are, as in $columns", columns={"x": "easting", "y": "northing", "z": "height"}
)


def coordinate_columns(names, columns=None):
    """Positions of x, y and z among the names of columns.

    `columns` has the column of an axis, where it is told: a name, or a number from 1 on. Raise if
    an axis has no column, or several that it may be.
    """
    told = {axis: _position(names, which) for axis, which in (columns or {}).items()}
    lower, plain = [name.lower() for name in names], [_plain(name) for name in names]
    for some in (lower, plain):  # whole sets of x, y, z come before other names
        if all(some.count(axis) == 1 for axis in "xyz" if axis not in told):
            found = {axis: [some.index(axis)] for axis in "xyz" if axis not in told}
            break
    else:
        found = {axis: _of_axis(plain, axis) for axis in "xyz" if axis not in told}
    among = f"among the columns {', '.join(names)[:300]}: {REMEDY}"
    for axis, several in found.items():
        if len(several) > 1:
            which = " or ".join(repr(names[i]) for i in several)
            raise PointFileError(f"{axis} may be {which} {among}") from REMEDY
    missing = [axis for axis, several in found.items() if not several]
    if missing:
        raise PointFileError(f"no {', '.join(missing)} {among}") from REMEDY
    positions = [told[axis] if axis in told else found[axis][0] for axis in "xyz"]
    if len(set(positions)) < 3:
        told = ParameterError("x, y and z need three columns, got $columns", columns=columns)
        raise PointFileError(str(told)) from told
    return positions


def attribute_name(name):
    """What a column that is no coordinate is called."""
    return f"{name}_value" if name.lower() in RESERVED else name


def n_known_axes(names):
    """How many axes have a column that is named as people name them."""
    return sum(bool(_of_axis([_plain(name) for name in names], axis)) for axis in "xyz")


def _of_axis(plain, axis):
    """Columns that may be an axis. Words come before single letters, which mean many things."""
    found = [i for i, name in enumerate(plain) if name in AXES[axis]]
    return [i for i in found if len(plain[i]) > 1] or found


def _plain(name):
    """The words of a name in lower case, without units and the like."""
    words = re.findall(r"[^\W\d_]+|\d+", name.lower())
    return " ".join(word for word in words if word not in BESIDE)


def _position(names, which):
    which = str(which)
    for some in (names, [name.lower() for name in names]):
        if which in some:
            return some.index(which)
    if which.isdecimal() and 1 <= int(which) <= len(names):
        return int(which) - 1
    raise PointFileError(f"no column {which!r} among {', '.join(names)[:300]}")
