"""Tables without names whose first three columns are no x, y and z, as it seems."""

from typing import NamedTuple

import numpy as np

from sklearn_mcmd._errors import ParameterError
from sklearn_mcmd.io._no_returns import LARGE
from sklearn_mcmd.io._point_cloud import PointFileError

ROWS = 100_000  # that are looked at


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
