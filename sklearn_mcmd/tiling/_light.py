"""The intensity of all points, kept as ranks while the inputs are read."""

import os

import numpy as np

from sklearn_mcmd.io import PointFileError
from sklearn_mcmd.io._sensor import LIGHTS, lights_in
from sklearn_mcmd.outliers._model import middle_ranks
from sklearn_mcmd.runtime._chunks import slices
from sklearn_mcmd.tiling._cells import Levels
from sklearn_mcmd.tiling._files import made, mapped
from sklearn_mcmd.tiling._memory import PART

LIGHT = "light.npy"


class LightWriter:
    """Keeps the ranks of intensity of n points beside their cells; it is 0 where a file has none.

    Points that are not chosen have no part in the ranks.
    """

    def __init__(self, folder, n):
        self._folder, self._n, self._first, self._stored = folder, n, 0, {}
        self._levels, self._not_finite = {}, set()

    def take(self, cloud, chosen, path):
        """Take the next points in the order of the inputs; those `chosen`, or all, are judged."""
        rows = slice(self._first, self._first + len(cloud))
        for name, values in lights_in(cloud.attributes).items():
            if name not in self._stored:
                self._stored[name] = made(self._folder / f"{name}.npy", np.float64, (self._n,))
                self._levels[name] = Levels()
            self._stored[name][rows] = values
            values = values if chosen is None else values[chosen]
            self._levels[name].add(*np.unique(values, return_counts=True))
            if not np.isfinite(values).all():
                self._not_finite.add(name)
        self._first = rows.stop

    def close(self, path):
        """Keep the ranks of the first that tells anything; `path` is for errors."""
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
        values, counts = self._levels[told[0]].merged()
        ranks, stored = middle_ranks(counts), self._stored[told[0]]
        for rows in slices(self._n, PART):
            places = np.searchsorted(values, stored[rows])
            stored[rows] = ranks[np.minimum(places, len(ranks) - 1)]
        stored.flush()
        os.replace(self._folder / f"{told[0]}.npy", self._folder / LIGHT)


def stored_light(folder):
    """The ranks of all points in the order of the inputs, on disk."""
    return mapped(folder / LIGHT, "r")
