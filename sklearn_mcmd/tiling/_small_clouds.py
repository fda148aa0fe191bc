"""Clouds of so few places that other code works on them than on tiles: all in one piece."""

import numpy as np
from sklearn.base import clone

__all__ = ["fit_together"]

# Points that may be fitted at once; only copies make a cloud of few places so large.
MOST_COPIES = 1_000_000


def fit_together(estimator, cells, dtype, words, step=None, origins=None):
    """An estimator fitted to all points of a cloud in the order of the inputs.

    Parameters
    ----------
    estimator : estimator
    cells : Cells
    dtype : dtype
        In which points are fitted.
    words : str
        Where the points are, such as " at 600 places", for the error.
    step : float, default=None
        To which coordinates are rounded, if that of these points alone would be another.
    origins : ndarray of shape (n, 3), default=None
        Where the sensor was for each point of the inputs.

    Returns
    -------
    fitted : estimator
    parts : list of (ndarray of int of shape (m,), ndarray of int of shape (m,))
        Of each cell, the rows of the inputs, and those among the points that are fitted.

    Raises
    ------
    ValueError
        If there are too many.
    """
    n_points = int(cells.counts.sum())
    if n_points > MOST_COPIES:
        raise ValueError(f"{n_points:,} points{words} are no cloud to be divided into tiles")
    records = [cells.read(cell) for cell in range(len(cells))]
    rows, points = (np.concatenate([part[name] for part in records]) for name in ("row", "xyz"))
    order = np.argsort(rows)
    fitted = clone(estimator)
    if step is not None:
        fitted._step_of_cloud = step
    given = {} if origins is None else {"sensor_origin": origins[rows[order]]}
    fitted.fit(points[order].astype(dtype), **given)
    places = np.empty_like(order)
    places[order] = np.arange(len(order))
    ends = np.cumsum([len(part) for part in records])[:-1]
    return fitted, list(zip(np.split(rows, ends), np.split(places, ends), strict=True))
