"""PTS, XYZN and XYZRGB: text whose columns have fixed places after x, y and z."""

import numpy as np

from sklearn_mcmd._errors import warn_caller
from sklearn_mcmd.io._point_cloud import COLORS, PointFileError, colors_of_bytes

COLUMNS = {  # what rows may have; the first that a cloud has is written
    ".pts": (("intensity", *COLORS), COLORS, ("intensity",), ()),
    ".xyzn": (("normal_x", "normal_y", "normal_z"), ()),
    ".xyzrgb": (COLORS, ()),
}


def names_after_xyz(extension, n):
    """Names of n columns after x, y and z, empty where a file without a header tells none."""
    return next((names for names in COLUMNS.get(extension, ()) if len(names) == n), [""] * n)


def with_bytes(path, attributes):
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


def fitting(extension, columns):
    """The columns that a format holds, with a warning of all others."""
    name, (held, rounded) = extension[1:].upper(), colors_of_bytes(columns)
    for color in COLORS:
        values = held.get(color, np.zeros(1))
        if values.dtype.kind not in "iu" or values.min() < 0 or values.max() > 255:
            held = {n: v for n, v in held.items() if n != color}
    names = next(names for names in COLUMNS[extension] if held.keys() >= set(names))
    lost = [n for n in columns if n not in names]
    if "outlier" in lost:
        raise PointFileError(
            f"{name} has no place to mark outliers; write another format, or the inliers alone"
        )
    words = [f"not written: {', '.join(lost)}"] if lost else []
    words += ["rounded to 8 bits: colors"] if rounded and "red" in names else []
    if not names and extension != ".pts":
        words.append(f"few programs read {name} without the last three")
    if words:
        holds = ", ".join(COLUMNS[extension][0])
        warn_caller(f"{name} holds x, y, z and {holds} only; {'; '.join(words)}")
    return {n: held[n] / 255 if extension == ".xyzrgb" else held[n] for n in names}
