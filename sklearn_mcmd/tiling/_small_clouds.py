"""Clouds of so few places that other code works on them than on tiles: all in one piece."""

import numpy as np
from sklearn.base import clone

from sklearn_mcmd.tiling._result_files import write_results

__all__ = ["fit_together"]

# Points that may be fitted at once; only copies make a cloud of few places so large.
MOST_COPIES = 1_000_000


def fit_together(estimator, cells, dtype, words, origins=None):
    """An estimator fitted to all points of a cloud in the order of the inputs, and `put`.

    ``put(folder, values, dtype)`` writes values of these points as results. `words` tell where the
    points are, such as " at 600 places", for the error. `origins` are where the sensor was for
    each point of the inputs.
    """
    n_points = int(cells.counts.sum())
    if n_points > MOST_COPIES:
        raise ValueError(f"{n_points:,} points{words} are no cloud to be divided into tiles")
    records = [cells.read(cell) for cell in range(len(cells))]
    rows, points = (np.concatenate([part[name] for part in records]) for name in ("row", "xyz"))
    order = np.argsort(rows)
    fitted = clone(estimator)
    given = {} if origins is None else {"sensor_origin": origins[rows[order]]}
    fitted.fit(points[order].astype(dtype), **given)
    places, ends = np.empty_like(order), np.cumsum([len(part) for part in records])[:-1]
    places[order] = np.arange(len(order))

    def put(folder, values, dtype):
        for cell, some in enumerate(np.split(places, ends)):
            write_results(folder, cell, records[cell]["row"], values[some], dtype)

    return fitted, put
