"""One run of any verb by tiles: points into cells, results of all tiles, outputs in order."""

import shutil
import time
import warnings
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from contextlib import contextmanager
from numbers import Integral
from pathlib import Path
from typing import NamedTuple

import numpy as np
from sklearn.base import clone

from sklearn_mcmd._errors import warn_caller
from sklearn_mcmd._validation import check_sizes
from sklearn_mcmd.io import PointFileError
from sklearn_mcmd.io._las_parts import no_returns_of
from sklearn_mcmd.runtime._chunks import ahead
from sklearn_mcmd.runtime._interrupts import ignoring_interrupts
from sklearn_mcmd.runtime._progress import progress_part, report_share
from sklearn_mcmd.tiling._catalog import Catalog, parts_of
from sklearn_mcmd.tiling._cells import GROUND, Cells, CellWriter, GroundWriter, WholeCloud
from sklearn_mcmd.tiling._folder import WorkFolder, key_of
from sklearn_mcmd.tiling._memory import Plan, check_tile_size, parse_memory, plan_run, usual_memory
from sklearn_mcmd.tiling._outputs import move_outputs, resume_moves, targets_of, write_outputs
from sklearn_mcmd.tiling._result_files import Results
from sklearn_mcmd.tiling._sensor_origins import SensorPath
from sklearn_mcmd.tiling._stored_columns import StoredColumns
from sklearn_mcmd.tiling._stored_light import LightWriter
from sklearn_mcmd.tiling._sweeps import Sweeps, TilingError, fails_for_good

SCATTERED = 0.07  # the share of the time after which all points are in cells, for the progress
FOUND = 0.93  # the same of the results of all tiles
WARM_UP = 100  # neighbors at most that load or compile the code


class RunReport(NamedTuple):
    """What a run came to.

    Attributes
    ----------
    n_points, n_tiles, n_workers : int
    n_resumed : int
        Tiles that an earlier run had finished; of outliers, those whose planes it had.
    removed_fraction : float
        Mean share of a neighborhood that was removed; of outliers, their share.
    seconds : float
    n_outliers : int
        Also of edges, before these are looked for.
    n_exact : int
        Of these, those that may be outliers only because most of their neighbors lie exactly in
        one plane.
    n_regions, n_inside : int
        Regions, and points in any of them.
    largest : list of int
        Points of the largest regions.
    n_edges : int
        Points of edges.
    n_judged : int
        Points that were judged for outliers.
    n_used : int
        Points that were judged or used to judge others: not withheld, and of
        the classes asked for.
    together : str
        Where hundreds of outliers lie together, in words; "" if nowhere.
    n_upright : int
        Normals of upright faces.
    sensor : dict of str to str
        Of outliers: "sensor", where it was; "by rays", points that are outliers by rays alone; and
        "doubt", what speaks against the position. Empty if none was known.
    """

    n_points: int
    n_tiles: int
    n_workers: int
    n_resumed: int
    removed_fraction: float
    seconds: float
    n_outliers: int = 0
    n_exact: int = 0
    n_regions: int = 0
    n_inside: int = 0
    largest: Sequence[int] = ()
    n_edges: int = 0
    n_judged: int = 0
    n_used: int = 0
    together: str = ""
    n_upright: int = 0
    sensor: Mapping[str, str] = {}


class TiledRun(NamedTuple):
    """What a verb has to work with, once all points are in cells."""

    catalog: Catalog
    targets: list[Path]
    folder: WorkFolder
    cells: Cells
    plan: Plan
    memory: float  # bytes that the run may take

    @property
    def n_threads(self):
        """Threads of a process that works on all places at once."""
        return self.plan.n_workers * self.plan.n_threads

    def xyz(self, cell):
        """The coordinates of the points of a cell."""
        return StoredColumns(self.folder.columns, len(self.cells)).xyz(self.cells, cell)

    def sweeps(self, steps):
        """The `Sweeps` of these steps."""
        return Sweeps(self.plan.n_workers, steps)


class TiledVerb(ABC):
    """What one verb knows of its estimator, which has one job a tile; `run_by_tiles` does all else.

    `content` distinguishes outputs of one estimator. With a choice, some points are used.
    """

    options: tuple[str, ...] = ()  # those of `process_files` that mean something to it
    last_sweep = "normals"  # which has done a tile that an earlier run had finished
    needs_ground = False  # whether the points of the ground get cells of their own
    needs_light = False  # whether the intensity of all points is kept
    sensor: SensorPath | None = None  # where it was for each point, if at more than one place
    asked = ""  # what else results depend on that sweeps find

    def __init__(self, estimator, content="", choice=None):
        self.estimator, self.content, self.choice = estimator, content, choice

    @abstractmethod
    def prepare(self, catalog):
        """Put compiled code on disk for all processes, warn of what is known of the inputs, and
        raise for parameters that are wrong. Returns the work, and the numbers of features and
        neighbors that `plan_run` takes."""

    @abstractmethod
    def find(self, run):
        """Write the results of all tiles that an earlier run has not done."""

    @abstractmethod
    def make(self, cloud, values, xyz):
        """What to write of a cloud in the form of its output, and which points to mark in it."""

    @abstractmethod
    def report(self, run, total):
        """All other fields of the `RunReport`; `total` is the sum of what is measured."""

    def results(self, run):
        """The `Results` of all tiles."""
        return Results(run.folder.columns, run.cells)

    def others(self, folder):
        """Files that are moved with the outputs: where they are, and their names."""
        return []

    def measure(self, values):
        """What is summed up of the results of points."""
        return 0


def run_by_tiles(verb, source, target, memory, n_jobs, tile_size, restart):
    """Run a verb, or go on where an earlier run has ended; returns its `RunReport`."""
    begin = time.perf_counter()
    check_tile_size(tile_size)
    memory = usual_memory() if memory is None else parse_memory(memory)
    catalog = source if isinstance(source, Catalog) else Catalog(source)
    targets = targets_of(catalog, Path(target))
    folder = WorkFolder(target, catalog.paths)
    try:
        with _kept(folder):
            if not restart and (report := resume_moves(verb, catalog, targets, folder)):
                return RunReport(**report)._replace(n_resumed=report["n_tiles"])
            if verb.sensor is not None:
                verb.sensor.check(catalog.n_points)
            work, n_features, k = verb.prepare(catalog)
            plan = plan_run(
                catalog.n_points, memory, n_jobs, n_features, tile_size, work=work, n_neighbors=k
            )
            _put_in_cells(verb, catalog, folder, plan, restart)
            cells, columns = Cells(folder.cells), folder.columns
            run = TiledRun(catalog, targets, folder, cells, plan, memory)
            n_resumed = sum(columns.is_done(cell, verb.last_sweep) for cell in range(len(cells)))
            with progress_part(SCATTERED, FOUND):
                verb.find(run)
            with progress_part(FOUND, 1.0, "writing"):
                found = verb.report(run, write_outputs(run, verb))
            report = RunReport(
                n_points=catalog.n_points,
                n_tiles=len(cells),
                n_workers=plan.n_workers,
                n_resumed=n_resumed,
                seconds=time.perf_counter() - begin,
                **found,
            )
            move_outputs(verb, catalog, targets, folder, report._asdict())
        return report
    except ValueError as err:
        if not folder.goes_on or folder.path.exists():
            raise
        warn_caller(f"{err}; an earlier run may have left it damaged, so this one begins anew")
    return run_by_tiles(verb, catalog, target, memory, n_jobs, tile_size, True)


@contextmanager
def _kept(folder):
    """Remove the folder of a run at its end; keep it where that is early, with points in cells, if
    the same run may go on from there."""
    try:
        yield
        with ignoring_interrupts():
            folder.remove()
    except (Exception, KeyboardInterrupt, SystemExit) as err:
        has_begun = folder.key is not None
        is_of_use = folder.constants is not None and not (has_begun and fails_for_good(err))
        if not is_of_use and not folder.moves.exists():
            folder.remove()
        if folder.constants is None or not has_begun:
            raise
        kept = f"what was done is kept in {folder.path}, and the same run goes on from there"
        if isinstance(err, Exception) and not isinstance(err, Warning):  # the user may raise these
            said = str(err).removesuffix(".") or type(err).__name__
            raise TilingError(f"{said}; {kept}") from err
        warn_caller(kept)
        raise
    finally:
        folder.release()


def warm_up(estimator, n_points=3_000):
    """An estimator fitted to so many points; compiled code is then on disk for all processes."""
    sizes = {n: k for n, k in estimator.get_params().items() if n.endswith("n_neighbors")}
    fewer = {name: min(k, WARM_UP) for name, k in sizes.items() if isinstance(k, Integral)}
    points = np.random.default_rng(0).uniform(size=(n_points, 3)) * [1, 1, 0.01]
    points[: n_points // 2, 2] *= 100
    with warnings.catch_warnings(), progress_part(0.0, 0.0):
        warnings.simplefilter("ignore")
        return clone(estimator).set_params(**fewer).fit(points)


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
    if np.ndim(getattr(estimator, "sensor_origin", None)) == 2:
        raise ValueError(
            "sensor_origin of an estimator is one position by tiles. For outliers and normals "
            "process_files takes positions of all points."
        )
    if not isinstance(estimator.random_state, Integral):
        raise ValueError(
            f"random_state={estimator.random_state!r} must be an int, so that all tiles make the "
            "same trials."
        )


def _put_in_cells(verb, catalog, folder, plan, restart):
    """Read all points once, unless an earlier run has, if that was the same."""
    used = verb.choice, verb.needs_ground, verb.sensor and verb.sensor.key, verb.asked
    paths = [str(path.resolve()) for path in catalog.paths]
    inodes = [path.stat().st_ino for path in catalog.paths]  # of replaced files of equal stamps
    known = paths, catalog.stamps, inodes, plan.tile_size, used
    folder.begin(key_of(verb.estimator, *known), restart)
    if folder.constants is not None:
        return
    free = shutil.disk_usage(folder.path).free
    if free < plan.disk:
        raise PointFileError(
            f"{folder.path.parent}: temporary files need about {plan.disk / 1e9:.3g} GB, and "
            f"{free / 1e9:.3g} GB are free"
        )
    with progress_part(0.0, SCATTERED, "reading"):
        _scatter(verb, catalog, folder, plan.tile_size)


def _scatter(verb, catalog, folder, capacity):
    """Put all points in cells, and find the constants of the whole cloud."""
    dtype = np.min_scalar_type(catalog.n_points)
    writer, whole, row = CellWriter(folder.cells, capacity, dtype=dtype), WholeCloud(), 0
    beside = []  # what else is kept of the points
    if verb.needs_ground:
        beside.append(GroundWriter(folder.cells / GROUND, capacity))
    if verb.sensor is not None:
        verb.sensor.folder = folder.cells
        beside.append(verb.sensor)
    if verb.needs_light:
        beside.append(LightWriter(folder.cells, catalog.n_points))
    for path, cloud, chosen in ahead(parts_of(catalog.paths, verb.choice)):
        xyz = cloud.xyz if chosen is None else cloud.xyz[chosen]
        rows = np.arange(row, row + len(cloud))
        if len(xyz):
            writer.add(xyz, rows if chosen is None else rows[chosen])
            whole.add(xyz)
        for other in beside:
            other.take(cloud, chosen, path)
        row += len(cloud)
        report_share(row / catalog.n_points)
    for path in catalog.paths:
        if warning := no_returns_of(path).warning(path):
            warn_caller(warning)
    if not writer.n_points:
        raise PointFileError(
            f"{catalog.paths[0]}: no points are judged: all are withheld or of other classes"
        )
    check_sizes(writer.n_points, 3, None)
    writer.close()
    for other in beside:
        other.close(catalog.paths[0])
    folder.finish_cells(whole.constants())
