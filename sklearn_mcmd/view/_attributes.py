"""Attributes of points as whole numbers of at most 16 bits, with what a page needs to read them.

Clouds of one page share each attribute: its range, its classes, its code.
"""

from typing import Any, NamedTuple

import numpy as np

from sklearn_mcmd.io._point_cloud import COLORS, flat_columns

LONG_TAIL = 20  # ranges of normal values are 6 to 8 times their quartiles' distance
NARROWEST = 1e-300  # width of a code, over its largest value
TOP = 65534  # largest code of a number above the first; code 0 is "no value"
NORMAL_TOP = 4094  # even, so that normals along the axes are exact
# Of kinds of attributes, the columns of which they are made.
PARTS = {"normal": ("normal_x", "normal_y", "normal_z"), "rgb": COLORS}
FEW = 64  # this many distinct whole numbers are classes
MANY = 65_535  # classes of an attribute that is known to hold labels
# Names of attributes that hold labels, and what their values are called.
LABELS = {"region", "segment", "label", "cluster", "instance", "classification", "class"}
CLASSES = (  # of LAS, from 0 on
    "never classified; unclassified; ground; low vegetation; medium vegetation; high vegetation; "
    "building; noise; model key point; water; rail; road; overlap; wire, guard; wire, conductor; "
    "transmission tower; wire connector; bridge deck; high noise"
)
NAMES = {
    "outlier": {0: "regular", 1: "outlier"},
    "true_outlier": {0: "regular", 1: "outlier"},
    "edge": {0: "surface", 1: "edge"},
    "region": {-1: "none"},
    "segment": {-1: "none"},
    "classification": dict(enumerate(CLASSES.split("; "))),
}
NAMES |= {
    "significant": {0: "not significant", 1: "moved"},
    "reason": {0: "compared", 1: "nothing within reach", 2: "no surface", 3: "another surface"},
}
SIGNED = {"distance", "residual"}  # numbers whose 0 is the middle of the colors
OUTLIERS = {"outlier": {1}, "classification": {7, 18}}  # of attributes that the package writes


class ColumnSource(NamedTuple):
    """An attribute: what the page is told about it, and its codes in each cloud."""

    info: dict[str, Any]
    codes: list[list[np.ndarray] | None]


class NumberCode(NamedTuple):
    """Numbers as codes from 1 to 65535, evenly or by the inverse hyperbolic sine.

    value = low + step * (code - 1), or center + width * sinh(low + step * (code - 1)). The second
    is even near the center and logarithmic far away: for scores, whose largest are a million times
    the usual ones. Code 0 stands for NaN and infinity.
    """

    low: float
    step: float
    center: float = 0.0
    width: float | None = None

    @classmethod
    def for_values(cls, values):
        """The code of finite values: exact for whole numbers of a range below 65535."""
        low, high = float(values.min()), float(values.max())
        whole = np.array_equal(values, np.rint(values))
        if whole and high - low <= TOP:
            return cls(low, 1.0)
        q25, q50, q75 = np.quantile(values, [0.25, 0.5, 0.75]).tolist()
        usual = q75 - q25
        # The distance of the quartiles is where the code turns from even to logarithmic.
        if not np.isfinite(high - low) or (usual > 0 and high - low > LONG_TAIL * usual):
            largest = max(abs(low), abs(high))
            # Quotients by a smaller width, or by an infinite one, are no numbers.
            width = min(max(usual or 1.0, NARROWEST * largest), largest)
            ends = np.arcsinh(np.array([low / width - q50 / width, high / width - q50 / width]))
            return cls(float(ends[0]), float(ends[1] - ends[0]) / TOP, q50, width)
        return cls(low, (high - low) / TOP or 1.0)

    def encode(self, values):
        is_finite = np.isfinite(values)
        numbers = np.where(is_finite, values, 0.0)
        if self.width is not None:
            numbers = np.arcsinh(numbers / self.width - self.center / self.width)
        codes = np.clip(np.rint((numbers - self.low) / self.step), 0, TOP) + 1
        return np.where(is_finite, codes, 0).astype(np.uint16)

    def info(self, exact):
        """What the page needs; `error` is absolute near the center, `relative` holds far away."""
        info = {"low": self.low, "step": self.step}
        if self.width is None:
            return info | {"error": 0.0 if exact else self.step / 2}
        info |= {"center": self.center, "width": self.width}
        error = float(self.width * np.sinh(self.step / 2))
        return info | {"error": error, "relative": self.step / 2}


def plan_attributes(clouds, only=None):
    """The attributes of clouds as `ColumnSource`s, values that all points of a cloud share, and
    names of attributes that hold no numbers; `only` are names to keep, of the file or the page.
    """
    tables = [flat_columns(attributes) for attributes in clouds]
    columns = [{k: v for k, v in table.items() if v.dtype.kind in "biuf"} for table in tables]
    pairs = zip(tables, columns, strict=True)
    skipped = sorted({name for table, kept in pairs for name in table.keys() - kept.keys()})
    sources = []
    for name, kind, code in (("normal", "normal", code_normals), ("color", "rgb", _code_colors)):
        joined = _join(columns, PARTS[kind], name, code)
        if any(codes is not None for codes in joined):
            name = free_name(name, {other for table in columns for other in table})
            sources.append(ColumnSource({"name": name, "kind": kind}, joined))
    constants: list[dict] = [{} for _ in columns]
    for name in dict.fromkeys(name for table in columns for name in table):
        arrays = [table.get(name) for table in columns]
        value = _only_value(arrays)
        if value is None:
            sources.append(_single(name, arrays))
        else:
            for kept, values in zip(constants, arrays, strict=True):
                if values is not None:
                    kept[name] = value
    if only is not None:
        wanted = set(only)
        sources = [source for source in sources if is_wanted(source.info, wanted)]
        constants = [{k: v for k, v in kept.items() if k in wanted} for kept in constants]
    return sources, constants, skipped


def free_name(name, taken):
    """The name, or with a number if another attribute has it."""
    free, number = name, 2
    while free in taken:
        free, number = f"{name} ({number})", number + 1
    return free


def code_normals(vectors):
    """Directions on the octahedron, unfolded to a square of 4095 x 4095; 0 for none.

    The angle to the true direction is at most 0.06 degrees.
    """
    vectors = np.asarray(vectors, dtype=np.float64)
    size = np.abs(vectors).sum(axis=1)
    has_length = np.isfinite(size) & (size > 0)
    unit = vectors / np.where(has_length, size, 1.0)[:, None]
    unit[~has_length] = 0.0
    # |x| + |y| + |z| = 1 is an octahedron. Its upper half is a square over x and y, and the lower
    # one folds outward over the four edges of that.
    flat = unit[:, :2]
    folded = (1.0 - np.abs(flat[:, ::-1])) * np.where(flat >= 0, 1.0, -1.0)
    square = np.where(unit[:, 2:] < 0, folded, flat)
    codes = np.rint((square + 1.0) / 2.0 * NORMAL_TOP) + 1
    return [np.where(has_length, codes[:, i], 0).astype(np.uint16) for i in range(2)]


def _code_colors(colors):
    """Colors of 8 bits; larger numbers are taken for 16 bits, and shares for shares."""
    colors = np.nan_to_num(np.asarray(colors, dtype=np.float64))
    largest = colors.max(initial=0.0)
    if largest > 255:
        colors = colors / 257.0
    elif largest <= 1 and not np.array_equal(colors, np.rint(colors)):
        colors = colors * 255.0
    bits = np.rint(np.clip(colors, 0, 255)).astype(np.uint8)
    return [bits[:, i].copy() for i in range(3)]


def _join(columns, names, name, code):
    """Three columns of each cloud as one attribute; they are taken out of the clouds."""
    return [
        code(np.column_stack([table.pop(part) for part in names]))
        if table.keys() >= set(names) and name not in table
        else None
        for table in columns
    ]


def _only_value(arrays):
    """The value that all points of all clouds share, or None."""
    columns = [values for values in arrays if values is not None]
    first = columns[0].ravel()[0]
    if all((values == first).all() for values in columns):
        return first.item()
    return None


def _single(name, arrays):
    numbers = np.concatenate([v.astype(np.float64) for v in arrays if v is not None])
    finite = numbers[np.isfinite(numbers)]
    whole = finite.size > 0 and np.array_equal(finite, np.rint(finite))
    if whole and len(finite) == len(numbers):
        distinct = np.unique(finite)
        if len(distinct) <= (MANY if name.lower() in LABELS else FEW):
            return _classes(name, arrays, distinct)
    is_signed = name.lower() in SIGNED and finite.size > 0 and finite.min() < 0 < finite.max()
    if is_signed:
        finite = np.concatenate([-finite, finite])
    code = NumberCode.for_values(finite) if finite.size else NumberCode(0.0, 1.0)
    codes = [None if v is None else [code.encode(v.astype(np.float64))] for v in arrays]
    exact = whole and code.step == 1.0 and code.width is None
    info = {"name": name, "kind": "number", **code.info(exact)}
    info |= {"signed": True} if is_signed else {}
    return ColumnSource(info | ({"whole": True} if whole else {}), codes)


def _classes(name, arrays, distinct):
    dtype = np.uint8 if len(distinct) <= 256 else np.uint16
    codes = [
        None if v is None else [np.searchsorted(distinct, v.astype(np.float64)).astype(dtype)]
        for v in arrays
    ]
    values = [int(value) for value in distinct]
    words = NAMES.get(name.lower(), {})
    info = {
        "name": name,
        "kind": "class",
        "values": values,
        "names": {str(v): words[v] for v in values if v in words},
    }
    marks = OUTLIERS.get(name.lower(), set())
    outliers = [code for code, value in enumerate(values) if value in marks]
    return ColumnSource(info | ({"outliers": outliers} if outliers else {}), codes)


def is_wanted(info, wanted):
    others = {"normal": {"normal", "normals"}, "rgb": {"color", "rgb"}}.get(info["kind"], set())
    return not wanted.isdisjoint({info["name"], *PARTS.get(info["kind"], ()), *others})
