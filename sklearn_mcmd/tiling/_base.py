"""What verbs by tiles have in common: what they are asked, and what they have to work with."""

import warnings
from abc import ABC, abstractmethod
from bisect import bisect_left
from collections.abc import Callable, Sequence
from numbers import Integral
from pathlib import Path
from typing import NamedTuple

import numpy as np
from sklearn.base import clone

from sklearn_mcmd.normals._adaptive_k import SizeLimits
from sklearn_mcmd.normals._sides import Sides
from sklearn_mcmd.planes._base import BaseLocalPlanes
from sklearn_mcmd.planes._whole import Whole
from sklearn_mcmd.runtime._progress import progress_part
from sklearn_mcmd.tiling._beside import SensorPath
from sklearn_mcmd.tiling._catalog import Catalog
from sklearn_mcmd.tiling._cells import Cells, rounding_told
from sklearn_mcmd.tiling._folder import CellResults
from sklearn_mcmd.tiling._halo import HOPS, HOPS_OF_SIZES
from sklearn_mcmd.tiling._memory import WARM_UP, Plan
from sklearn_mcmd.tiling._tasks import Job, fit_cell, run_tasks

AT_ONCE = 100_000  # points whose neighbors are asked for at once
# Of a `Job` that asks for no fit.
IDLE = {"estimator": None, "keep": None, "hops": 0, "width": 0.0}


class TiledRun(NamedTuple):
    """What a verb has to work with, once all points are in cells."""

    catalog: Catalog
    outputs: list[tuple[Path, Path]]  # where each is until all are whole, and where it goes then
    others: list[tuple[Path, Path]]  # files that are moved with them
    cells: Cells
    results: CellResults
    constants: dict  # what is known of the whole cloud, by names
    plan: Plan
    memory: float  # bytes that the run may take

    def do(self, task, work=None, told=None, **fields):
        """Do a task, ``work(cell, job)`` or a fit, on all cells; `fields` are of its `Job`, and
        `told` are those of its `Whole`."""
        known = self.constants
        job = Job(
            points=self.cells.folder,
            found=self.results.folder,
            whole=Whole(self.cells.n_points, **rounding_told(known), **told or {}),
            n_neighbors=known["n_neighbors"],
            n_threads=self.plan.n_threads,
            **IDLE | fields,
        )
        run_tasks(task, work or fit_cell, job, self.plan.n_workers)

    def reports(self, task):
        """The reports of a task on all cells."""
        return [self.results.report(cell, task) for cell in range(len(self.cells))]

    def found(self, name):
        """The arrays of a name, cell by cell."""
        return (self.results.read(cell, name) for cell in range(len(self.cells)))


class TiledVerb(ABC):
    """What one verb knows of its estimator, which has one job a tile; `run_by_tiles` does all else.

    What else it takes are options of `process_files` that mean something to it. `steps` are the
    estimator and all in it that ask for neighbors. With a choice, some points are used.
    """

    task = "fit"  # which has done a tile that an earlier run had finished
    names: Sequence[str] = ("results",)  # of arrays of cells, whose columns outputs are made of
    others: Sequence[Path] = ()  # files to write beside the outputs
    also: Sequence[
        Catalog
    ] = ()  # whose points are in the same cells, with numbers behind the others
    content: Sequence[str] = ()  # what distinguishes outputs of one estimator
    # They warn of some of the points, behind a `NeighborIndex`, as a fit to all does.
    warnings: Sequence[Callable] = ()
    center: Sequence[float] | None = None  # the one position, if all were measured from there

    def __init__(self, *steps, choice=None):
        self.estimator, self.steps, self.choice = steps[0], steps, choice
        self.sensor = SensorPath(None)  # where it was for each point, if at more than one place

    @property
    def n_neighbors(self):
        """The neighbors of which rings of a halo are."""
        return max(map(neighbors_of, self.steps))

    @abstractmethod
    def prepare(self, catalog):
        """Put compiled code on disk for all processes, warn of what is known of the inputs, and
        raise for parameters that are wrong."""

    def beside(self, folder):
        """What else is kept beside the cells of a folder while points are read: objects with
        ``take(cloud, chosen, path)`` and ``close(folder, path)``."""
        return [self.sensor] * self.sensor.moves

    def measure_fit(self, xyz):
        """A fit to some points, of which the memory is measured."""
        clone(self.estimator).fit(xyz)

    @abstractmethod
    def find(self, run):
        """Write the results of all tiles that an earlier run has not done."""

    @abstractmethod
    def make(self, cloud, values, xyz):
        """What to write of a cloud in the form of its output, and which points to mark in it."""

    @abstractmethod
    def report(self, run, total):
        """All other fields of the `RunReport`; `total` is the sum of what is measured."""

    def measure(self, values):
        """What is summed up of the results of points."""
        return 0

    def results(self, run):
        """The `Results` of all tiles."""
        return Results(run.results, run.cells, self.names)


class Results:
    """Results of all cells in the order of the points, of which each is asked for once.

    They are the columns of the arrays of some names, one after the other.
    """

    def __init__(self, results, cells, names):
        self._results, self._cells, self._names = results, cells, names
        # Of each cell, the first result that was not taken, and the row of its point.
        self._starts, self._rows = [0] * len(cells), [0.0] * len(cells)

    def take(self, first, n, n_expected=None):
        """Results (n, n_columns) of points from the row `first` on; 0 or NaN of those without."""
        some, n_found = self._stored(0), 0
        width, dtype = sum(part.shape[1] for part in some), np.result_type(*some)
        values = np.full((n, width), np.nan if dtype.kind == "f" else 0, dtype)
        for cell in range(len(self._cells)):
            if self._rows[cell] >= first + n:
                continue
            rows, start = self._cells.rows(cell), self._starts[cell]
            stop = bisect_left(rows, first + n, start)
            own = [part[start:stop] for part in self._stored(cell)]
            values[rows[start:stop].astype(np.int64) - first] = np.hstack(own)
            n_found += stop - start
            self._starts[cell] = stop
            self._rows[cell] = rows[stop] if stop < len(rows) else np.inf
        if n_expected is not None and n_found != n_expected:  # a fault of ours
            raise RuntimeError(f"{n_expected - n_found} of {n_expected} points have no results")
        return values

    def of_cells(self):
        """The same, cell by cell."""
        for cell in range(len(self._cells)):
            yield np.hstack(self._stored(cell))

    def _stored(self, cell):
        return [self._results.mapped(cell, name) for name in self._names]


def neighbors_of(estimator):
    """The neighbors that an estimator asks for; of its own number, most."""
    return SizeLimits().around if estimator.n_neighbors == "auto" else int(estimator.n_neighbors)


def hops_of(normals):
    """The hops of neighbors on which normals depend."""
    return HOPS_OF_SIZES if normals.n_neighbors == "auto" else HOPS


def without_sides(normals):
    """The estimator of who asks for no sides; raises for what tiles cannot do."""
    check_estimator(normals, BaseLocalPlanes)
    Sides(normals.orientation, normals.sensor_origin, np.zeros((1, 3)))
    return normals


def check_estimator(estimator, kind):
    """Raise if an estimator is of another kind, or its results depend on the whole cloud."""
    name = type(estimator).__name__
    if not isinstance(estimator, kind):
        raise ValueError(f"{name} cannot work by tiles: it is no {kind.__name__}.")
    if estimator.n_neighbors is None:
        raise ValueError(
            f"{name} cannot work by tiles with n_neighbors=None: the whole cloud is one "
            "neighborhood."
        )
    if np.ndim(getattr(estimator, "sensor_origin", 0)) == 2:
        raise ValueError(
            "sensor_origin of an estimator is one position by tiles. For outliers and normals "
            "process_files takes positions of all points."
        )
    if not isinstance(estimator.random_state, Integral):
        raise ValueError(
            f"random_state={estimator.random_state!r} must be an int, so that all tiles make the "
            "same trials."
        )


def warm_up(estimator):
    """An estimator fitted to some points; compiled code is then on disk for all processes."""
    sizes = {n: k for n, k in estimator.get_params().items() if n.endswith("n_neighbors")}
    fewer = {name: min(k, WARM_UP) for name, k in sizes.items() if isinstance(k, Integral)}
    points = np.random.default_rng(0).uniform(size=(3_000, 3)) * [1, 1, 0.01]
    points[:1_500, 2] *= 100
    with warnings.catch_warnings(), progress_part(0.0, 0.0):
        warnings.simplefilter("ignore")
        return clone(estimator).set_params(**fewer).fit(points)


def in_halo(part, values, asked=True):
    """What a cell says of the points of others, or of those `asked`: their cells, numbers there,
    and a value of each."""
    others = ~part.own & asked
    return np.column_stack([part.homes[others], part.at[others], values[others]])


def overlaps(run):
    """Of each pair of cells, what the first says of points of the second: numbers of both cells,
    rows in its halo, and of these numbers in the second and values."""
    for cell, halo in enumerate(run.found("halo")):
        halo = halo.astype(np.int64)
        for home in np.unique(halo[:, 0]).tolist():
            rows = np.flatnonzero(halo[:, 0] == home)
            yield cell, home, rows, *halo[rows, 1:].T
