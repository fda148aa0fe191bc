"""One run of any verb by tiles: points into cells, a task for each cell, outputs in order."""

import shutil
import time
import warnings
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from contextlib import contextmanager
from functools import cached_property
from numbers import Integral
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree
from sklearn.base import clone

from sklearn_mcmd._errors import warn_caller
from sklearn_mcmd._validation import check_sizes, check_work
from sklearn_mcmd.io import PointFileError
from sklearn_mcmd.io._las_parts import no_returns_of
from sklearn_mcmd.planes._base import warn_if_few
from sklearn_mcmd.planes._neighborhoods import NeighborIndex
from sklearn_mcmd.planes._resolution import coarse_warning
from sklearn_mcmd.planes._whole import Whole
from sklearn_mcmd.runtime._chunks import ahead
from sklearn_mcmd.runtime._interrupts import ignoring_interrupts
from sklearn_mcmd.runtime._progress import progress_part, report_share
from sklearn_mcmd.tiling._catalog import Catalog, parts_of
from sklearn_mcmd.tiling._cells import Cells, CellWriter, Rounding, places_of
from sklearn_mcmd.tiling._files import CellResults
from sklearn_mcmd.tiling._folder import WorkFolder, key_of
from sklearn_mcmd.tiling._memory import (
    MEASURED,
    WARM_UP,
    Plan,
    bytes_of_point,
    check_memory,
    check_tile_size,
    least_bytes_of_point,
    parse_memory,
    plan_run,
    usual_memory,
)
from sklearn_mcmd.tiling._outputs import (
    Results,
    move_outputs,
    resume_moves,
    targets_of,
    write_outputs,
)
from sklearn_mcmd.tiling._sensor_origins import SensorPath
from sklearn_mcmd.tiling._tasks import Job, TilingError, fails_for_good, fit_cell, run_tasks

SCATTERED = 0.07  # the share of the time after which all points are in cells, for the progress
FOUND = 0.93  # the same of the results of all tiles
DISK_POINT = 80  # bytes of temporary files for each point, about
SAMPLE = 1_000  # points that tell how far neighbors are


class RunReport(NamedTuple):
    """What a run came to.

    Attributes
    ----------
    n_points, n_tiles, n_workers : int
    n_resumed : int
        Tiles that an earlier run had finished.
    removed_fraction : float
        Mean share of a neighborhood that was removed; of outliers, their share.
    seconds : float
    n_proven : int
        Points of which a tile and its halo hold all neighbors, theirs, and so on, hop by hop.
        Their normals are those of memory to the last bit; their scores, edges and regions nearly
        always, which also ask how large things are.
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
    n_proven: int = 0
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
    def results(self):
        return CellResults(self.folder.results)

    def job(self, estimator, keep, hops, width=0.0, given=None, **told):
        """The `Job` of an estimator; `told` are fields of its `Whole`."""
        constants = self.folder.constants
        whole = Whole(self.cells.n_points, constants["dtype"], constants["step"], **told)
        return Job(
            points=self.folder.cells,
            found=self.folder.results,
            estimator=estimator,
            whole=whole,
            n_neighbors=constants["n_neighbors"],
            hops=hops,
            width=width,
            usual=constants["usual"],
            keep=keep,
            given=given or nothing_more,
            n_threads=self.plan.n_threads,
        )

    def fit(self, name, job):
        """Fit the estimator of a job to all cells."""
        run_tasks(name, fit_cell, job, self.plan.n_workers)


def nothing_more(job, cell, part):
    """What `fit` takes beside the points of a part: the default of `Job.given`."""
    return part, {}


class TiledVerb(ABC):
    """What one verb knows of its estimator, which has one job a tile; `run_by_tiles` does all else.

    `content` distinguishes outputs of one estimator. With a choice, some points are used.
    """

    options: tuple[str, ...] = ()  # those of `process_files` that mean something to it
    task = "fit"  # which has done a tile that an earlier run had finished
    sensor: SensorPath | None = None  # where it was for each point, if at more than one place
    center: Sequence[float] | None = None  # the one position, if all were measured from there

    def __init__(self, estimator, content="", choice=None):
        self.estimator, self.content, self.choice = estimator, content, choice

    @property
    @abstractmethod
    def n_neighbors(self):
        """The neighbors of which rings of a halo are."""

    @abstractmethod
    def prepare(self, catalog):
        """Put compiled code on disk for all processes, warn of what is known of the inputs, and
        raise for parameters that are wrong."""

    def beside(self, folder, catalog):
        """What else is kept of the points while they are read: objects with ``take(cloud, chosen,
        path)`` and ``close(path)``."""
        return []

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

    def results(self, run):
        """The `Results` of all tiles."""
        return Results(run.results, run.cells)

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
            verb.prepare(catalog)
            key = _key(verb, catalog, tile_size)
            plan = _put_in_cells(verb, catalog, folder, key, restart, memory, n_jobs, tile_size)
            run = TiledRun(catalog, targets, folder, Cells(folder.cells), plan, memory)
            done = [run.results.is_done(cell, verb.task) for cell in range(len(run.cells))]
            with progress_part(SCATTERED, FOUND, "tiles"):
                verb.find(run)
            with progress_part(FOUND, 1.0, "writing"):
                found = verb.report(run, write_outputs(run, verb))
            reports = [run.results.report(cell, verb.task) for cell in range(len(run.cells))]
            report = RunReport(
                n_points=catalog.n_points,
                n_tiles=len(run.cells),
                n_workers=plan.n_workers,
                n_resumed=sum(done),
                seconds=time.perf_counter() - begin,
                n_proven=sum(report["n_proven"] for report in reports),
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


def most_neighbors(n_points, *estimators):
    """The largest number of neighbors of some estimators of so many points."""
    estimators = [estimator for estimator in estimators if estimator is not None]
    for estimator in estimators:
        check_work(estimator, n_points)
    sizes = (estimator.n_neighbors for estimator in estimators)
    return max((k for k in sizes if isinstance(k, Integral)), default=0)


def _key(verb, catalog, tile_size):
    """A hash of all that cells and their results depend on."""
    paths = [str(path.resolve()) for path in catalog.paths]
    inodes = [path.stat().st_ino for path in catalog.paths]  # of replaced files of equal stamps
    used = verb.choice, verb.content, verb.sensor and verb.sensor.key
    return key_of(verb.estimator, paths, catalog.stamps, inodes, tile_size, used)


def _put_in_cells(verb, catalog, folder, key, restart, memory, n_jobs, tile_size):
    """Read all points once, unless an earlier run has, if that was the same; returns the `Plan`."""
    folder.begin(key, restart)
    known = folder.constants
    whole = (0.0, "") if verb.sensor is None else verb.sensor.costs
    asked = catalog.n_points, memory
    if known is None:
        k = verb.n_neighbors
        check_memory(*asked, least_bytes_of_point(k), *whole, n_neighbors=k)  # before it takes long
        sample = Sample(verb, catalog)
        point, usual = sample.bytes_of_point(), sample.usual
    else:
        point, tile_size = known["point"], known["tile_size"]
    plan = plan_run(*asked, n_jobs, tile_size, point, *whole, n_neighbors=verb.n_neighbors)
    if known is None:
        free, needed = shutil.disk_usage(folder.path).free, DISK_POINT * catalog.n_points
        if free < needed:
            raise PointFileError(
                f"{folder.path.parent}: temporary files need about {needed / 1e9:.3g} GB, and "
                f"{free / 1e9:.3g} GB are free"
            )
        told = {"point": point, "usual": usual, "n_neighbors": verb.n_neighbors}
        with progress_part(0.0, SCATTERED, "reading"):
            _scatter(verb, catalog, folder, plan.tile_size, told)
        sample.warn(folder.constants["dtype"], catalog.n_points)
    return plan


class Sample:
    """Some points of the inputs of a verb, which tell how far neighbors are, and what a fit
    takes."""

    def __init__(self, verb, catalog):
        self._verb, parts = verb, []
        for _, cloud, chosen in parts_of(catalog.paths, verb.choice):
            parts.append(cloud.xyz if chosen is None else cloud.xyz[chosen])
            if sum(map(len, parts)) > max(MEASURED):
                break
        self.xyz = np.concatenate(parts)
        if not len(self.xyz):
            raise PointFileError(
                f"{catalog.paths[0]}: no points are judged: all are withheld or of other classes"
            )

    @cached_property
    def usual(self):
        """How far the last of the neighbors of a point is; of 95 % of points it is nearer."""
        xyz = np.unique(self.xyz, axis=0)
        if len(xyz) < 2:
            return 0.0
        some, k = xyz[:: -(-len(xyz) // SAMPLE)], min(self._verb.n_neighbors, len(xyz))
        near = cKDTree(xyz, balanced_tree=False).query(some, [k])[1][:, 0]
        places, ends = (places_of(points, self._verb.center) for points in (some, xyz[near]))
        return float(np.quantile(np.linalg.norm(ends - places, axis=1), 0.95))

    def bytes_of_point(self):
        """As of `plan_run`."""
        with warnings.catch_warnings(), progress_part(0.0, 0.0):
            warnings.simplefilter("ignore")
            return bytes_of_point(self._verb.measure_fit, self.xyz, self._verb.n_neighbors)

    def warn(self, dtype, n_points):
        """Warn as a fit to the whole cloud does, whose coordinates are of this dtype."""
        index = NeighborIndex(self.xyz, self._verb.n_neighbors)
        is_all = len(self.xyz) == n_points
        if is_all and isinstance(self._verb.estimator.n_neighbors, Integral):
            warn_if_few(self._verb.estimator, index, n_points)
        if dtype == "float32" and (coarse := coarse_warning(index)):
            warn_caller(coarse)


def _scatter(verb, catalog, folder, capacity, told):
    """Put all points in cells, and find what is told of the whole cloud."""
    dtype = np.min_scalar_type(catalog.n_points)
    writer, rounding, row = CellWriter(folder.cells, capacity, dtype, verb.center), Rounding(), 0
    beside = verb.beside(folder, catalog)
    for path, cloud, chosen in ahead(parts_of(catalog.paths, verb.choice)):
        xyz = cloud.xyz if chosen is None else cloud.xyz[chosen]
        rows = np.arange(row, row + len(cloud))
        if len(xyz):
            writer.add(xyz, rows if chosen is None else rows[chosen])
            rounding.add(xyz)
        for other in beside:
            other.take(cloud, chosen, path)
        row += len(cloud)
        report_share(row / catalog.n_points)
    for path in catalog.paths:
        if warning := no_returns_of(path).warning(path):
            warn_caller(warning)
    check_sizes(writer.n_points, 3, None)
    writer.close()
    for other in beside:
        other.close(catalog.paths[0])
    folder.finish_cells({**told, "tile_size": capacity, **rounding.found()})
