"""The intensity of all points: kept while the inputs are read, and its ranks among all places."""

import os
from functools import partial

import numpy as np

from sklearn_mcmd.io import PointFileError
from sklearn_mcmd.io._sensor import LIGHTS, lights_in
from sklearn_mcmd.outliers._model import middle_ranks
from sklearn_mcmd.tiling._cells import Levels
from sklearn_mcmd.tiling._memory import check_levels
from sklearn_mcmd.tiling._stored_columns import made, mapped

LIGHT = "light.npy"


class LightWriter:
    """Keeps the intensity of n points beside their cells; it is 0 where a file has none."""

    def __init__(self, folder, n):
        self._folder, self._n, self._first, self._stored = folder, n, 0, {}
        self._not_finite = set()

    def take(self, cloud, chosen, path):
        """Take the next points in the order of the inputs; those `chosen`, or all, are judged."""
        rows = slice(self._first, self._first + len(cloud))
        for name, values in lights_in(cloud.attributes).items():
            if name not in self._stored:
                kept = np.uint16 if values.dtype == np.uint16 else np.float64
                self._stored[name] = made(self._folder / f"{name}.npy", kept, (self._n,))
            self._stored[name][rows] = values
            if not np.isfinite(values if chosen is None else values[chosen]).all():
                self._not_finite.add(name)
        self._first = rows.stop

    def close(self, path):
        """Keep the first that tells anything; `path` is for errors."""
        told = [n for n in LIGHTS if n in self._stored]
        told = [n for n in told if self._stored[n].min() != self._stored[n].max()]
        if not told:
            raise PointFileError(
                f"{path}: intensity is asked for, but the inputs have none, or one for all points"
            )
        if told[0] in self._not_finite:
            raise PointFileError(
                f"{path}: intensity is asked for, but {told[0]} of some points is not finite; "
                "leave these points out, or do without intensity"
            )
        os.replace(self._folder / f"{told[0]}.npy", self._folder / LIGHT)


def stored_light(folder):
    """The intensity of all points in the order of the inputs, on disk; None if it is not kept."""
    return mapped(folder / LIGHT, "r") if (folder / LIGHT).exists() else None


def rank_light(job, memory):
    """Fill light with what `ranks_of_intensity` returns; there is none if that is None."""
    whole, stored = job.whole(), stored_light(job.points)
    if stored is not None:
        report = job.columns.once("ranks", partial(_rank, job, whole, stored, memory))
        if report["n"] == 1:  # which tells nothing
            whole.remove("light")


def _rank(job, whole, stored, memory):
    cells, levels = job.cells, Levels()
    whole.make(light=float)
    for cell in range(len(cells)):
        own = whole.rows(cell)
        largest = np.full(own.stop - own.start, -np.inf)
        np.maximum.at(largest, whole.columns.read(cell, "place_of"), stored[cells.rows(cell)])
        whole.put(cell, light=largest)
        levels.add(*np.unique(largest, return_counts=True))
        check_levels(sum(len(part) for part, _ in levels.parts), memory)
    values, counts = levels.merged()
    ranks = middle_ranks(counts)
    for cell in range(len(cells)):
        largest = whole.rows_of("light", whole.rows(cell))
        whole.put(cell, light=ranks[np.searchsorted(values, largest)])
    return {"n": len(values)}
