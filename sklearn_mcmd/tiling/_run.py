"""One run of any verb by tiles: points into cells, a task for each cell, outputs in order."""

import shutil
import time
import warnings
from collections.abc import Mapping, Sequence
from contextlib import contextmanager
from numbers import Integral
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from sklearn_mcmd._errors import warn_caller
from sklearn_mcmd._validation import check_sizes, check_work
from sklearn_mcmd.io import PointFileError
from sklearn_mcmd.io._las_parts import no_returns_of
from sklearn_mcmd.planes._base import warn_if_few
from sklearn_mcmd.planes._indexed_cloud import distinct_rows
from sklearn_mcmd.planes._neighborhoods import NeighborIndex
from sklearn_mcmd.planes._resolution import coarse_warning
from sklearn_mcmd.runtime._interrupts import ignoring_interrupts
from sklearn_mcmd.runtime._progress import progress_part, report_share
from sklearn_mcmd.tiling._base import TiledRun
from sklearn_mcmd.tiling._catalog import Catalog, check_unchanged, parts_of
from sklearn_mcmd.tiling._cells import Cells, CellWriter, Rounding
from sklearn_mcmd.tiling._folder import CellResults, TilingError, WorkFolder, key_of
from sklearn_mcmd.tiling._memory import (
    MEASURED,
    bytes_of_point,
    check_memory,
    check_tile_size,
    least_bytes_of_point,
    parse_memory,
    plan_run,
    usual_memory,
)
from sklearn_mcmd.tiling._outputs import move_outputs, resume_moves, targets_of, write_outputs
from sklearn_mcmd.tiling._tasks import fails_for_good

SCATTERED = 0.07  # the share of the time after which all points are in cells, for the progress
FOUND = 0.93  # the same of the results of all tiles
DISK_POINT = 80  # bytes of temporary files for each point, about


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
    n_used : int
        Points that were judged for outliers: not withheld, and of the classes asked for.
    together : str
        Where hundreds of outliers lie together, in words; "" if nowhere.
    n_upright : int
        Normals of upright faces.
    sensor : dict of str to str
        Of outliers: "sensor", where it was; "by rays", points that are outliers by rays alone; and
        "doubt", what speaks against the position. Empty if none was known.
    change : dict
        Of a second cloud: how many points are compared, or not for which reason, how many moved
        significantly, medians, by how much noise that is alike nearby multiplies variances, and
        `bodies`, as of :class:`~sklearn_mcmd.change.Changes`.
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
    n_used: int = 0
    together: str = ""
    n_upright: int = 0
    sensor: Mapping[str, str] = {}
    change: Mapping[str, Any] = {}


def run_by_tiles(verb, source, target, memory, n_jobs, tile_size, restart):
    """Run a verb, or go on where an earlier run has ended; returns its `RunReport`."""
    begin = time.perf_counter()
    check_tile_size(tile_size)
    memory = usual_memory() if memory is None else parse_memory(memory)
    catalog = source if isinstance(source, Catalog) else Catalog(source)
    targets = targets_of(catalog, Path(target), verb.others, verb.also)
    catalogs = [catalog, *verb.also]
    folder = WorkFolder(target, [path for one in catalogs for path in one.paths])
    try:
        with _kept(folder):
            if not restart and (report := resume_moves(verb, catalog, targets, folder)):
                return RunReport(**report)._replace(n_resumed=report["n_tiles"])
            for one in catalogs:
                for path, stamp in zip(one.paths, one.stamps, strict=True):
                    check_unchanged(path, stamp)
            verb.sensor.check(catalog.n_points)
            for step in verb.steps:
                check_work(step, catalog.n_points)
            verb.prepare(catalog)
            plan = _put_in_cells(verb, catalogs, folder, restart, memory, n_jobs, tile_size)
            cells, results = Cells(folder.cells), CellResults(folder.results)
            places = (folder.outputs / f"{i}{one.suffix.lower()}" for i, one in enumerate(targets))
            outputs = list(zip(places, targets, strict=True))
            run = TiledRun(catalog, outputs, [], cells, results, folder.constants, plan, memory)
            n_resumed = sum(results.is_done(cell, verb.task) for cell in range(len(cells)))
            with progress_part(SCATTERED, FOUND, "tiles"):
                verb.find(run)
            with progress_part(FOUND, 1.0, "writing"):
                found = verb.report(run, write_outputs(run, verb))
            report = RunReport(
                n_points=catalog.n_points,
                n_tiles=len(cells),
                n_workers=plan.n_workers,
                n_resumed=n_resumed,
                seconds=time.perf_counter() - begin,
                n_proven=sum(report["n_proven"] for report in run.reports(verb.task)),
                **found,
            )
            move_outputs(verb, run, folder, report._asdict())
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


def _put_in_cells(verb, catalogs, folder, restart, memory, n_jobs, tile_size):
    """Read all points once, unless an earlier run has, if that was the same; returns the `Plan`."""
    paths = [path for one in catalogs for path in one.paths]
    stamps = [stamp for one in catalogs for stamp in one.stamps]
    inodes = [path.stat().st_ino for path in paths]  # of replaced files of equal stamps
    folder.begin(key_of(verb, catalogs[0].paths, stamps, inodes, tile_size), restart)
    n_points = sum(one.n_points for one in catalogs)
    whole, does = verb.sensor.costs
    demand = {"n_points": n_points, "memory": memory, "whole": whole, "does": does}
    demand["n_neighbors"] = k = verb.n_neighbors
    if (kept := folder.constants) is not None:
        divided = {name: kept[name] for name in ("tile_size", "point")}
        return plan_run(**demand, n_jobs=n_jobs, **divided)
    check_memory(**demand, point=least_bytes_of_point(k))  # before it takes long
    sample = Sample(verb, catalogs[0])
    point = sample.bytes_of_point()
    plan = plan_run(**demand, n_jobs=n_jobs, tile_size=tile_size, point=point)
    free, needed = shutil.disk_usage(folder.path).free, DISK_POINT * n_points
    if free < needed:
        raise PointFileError(
            f"{folder.path.parent}: temporary files need about {needed / 1e9:.3g} GB, and "
            f"{free / 1e9:.3g} GB are free"
        )
    told = {"point": point, "tile_size": plan.tile_size, "n_neighbors": k}
    with progress_part(0.0, SCATTERED, "reading"):
        found = _scatter(verb, catalogs, paths, folder.cells, plan.tile_size)
        folder.finish_cells({**told, **found})
    sample.warn(found["dtype"], n_points)
    return plan


class Sample:
    """Some points of the inputs of a verb, which tell how far neighbors are, and what a fit
    takes."""

    def __init__(self, verb, catalog):
        self._verb, parts = verb, []
        for _, cloud, chosen in parts_of(catalog.paths, verb.choice):
            parts.append(cloud.xyz[chosen])
            if sum(map(len, parts)) > max(MEASURED):
                break
        self.xyz = np.concatenate(parts)
        if not len(self.xyz):
            raise PointFileError(
                f"{catalog.paths[0]}: no points are judged: all are withheld or of other classes"
            )
        self._distinct = self.xyz[distinct_rows(self.xyz)[0]]

    def bytes_of_point(self):
        """As of `plan_run`."""
        k, xyz = self._verb.n_neighbors, self._distinct
        with warnings.catch_warnings(), progress_part(0.0, 0.0):
            warnings.simplefilter("ignore")
            # As many points as neighbors are too few where some are copies.
            return bytes_of_point(self._verb.measure_fit, xyz if len(xyz) > k else self.xyz, k)

    def warn(self, dtype, n_points):
        """Warn as a fit to the whole cloud does, whose coordinates are of this dtype."""
        index = NeighborIndex(self.xyz, self._verb.n_neighbors)
        is_all = len(self.xyz) == n_points
        if is_all and isinstance(self._verb.estimator.n_neighbors, Integral):
            warn_if_few(self._verb.estimator, index, n_points)
        if dtype == "float32" and (coarse := coarse_warning(index)):
            warn_caller(coarse)
        for warn in self._verb.warnings:
            warn(index)


def _scatter(verb, catalogs, paths, folder, capacity):
    """Put all points in cells; returns what is told of the first cloud, and `also` of others."""
    ends, roundings = np.cumsum([one.n_points for one in catalogs]), [Rounding() for _ in catalogs]
    n_points, row = int(ends[-1]), 0
    writer = CellWriter(folder, capacity, np.min_scalar_type(n_points), verb.center)
    beside = verb.beside(folder)
    for path, cloud, chosen in parts_of(paths, verb.choice):
        xyz, rows = cloud.xyz[chosen], np.arange(row, row + len(cloud))[chosen]
        if len(xyz):
            writer.add(xyz, rows)
            roundings[np.searchsorted(ends, row, "right")].add(xyz)
        for other in beside:
            other.take(cloud, chosen, path)
        row += len(cloud)
        report_share(row / n_points)
    for path in paths:
        if warning := no_returns_of(path).warning(path):
            warn_caller(warning)
    check_sizes(writer.n_points, 3, None)
    writer.close()
    for other in beside:
        other.close(folder, paths[0])
    found, *others = (rounding.found() for rounding in roundings)
    return {**found, "also": others}
