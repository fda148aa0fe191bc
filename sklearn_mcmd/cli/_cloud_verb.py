"""What ``denoise``, ``normals``, ``segment`` and ``edges`` share: options, help, and the run."""

import time
import warnings
from collections.abc import Callable
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from datetime import timedelta
from errno import ENOENT
from types import SimpleNamespace
from typing import ClassVar

from sklearn_mcmd._extras import import_extra
from sklearn_mcmd.cli import _files, _messages, _options
from sklearn_mcmd.cli._options import option, parsed
from sklearn_mcmd.io import PointFileError
from sklearn_mcmd.io._formats import TILED, TILED_NAMES
from sklearn_mcmd.io._las_parts import read_parts
from sklearn_mcmd.io._rehearsal import rehearse

SAMPLE = 50_000  # points whose time is measured
MORE = 1.5  # time of tiles over that in memory, about; see docs/tiling.rst
SECONDS = 5.0  # that a scheduler has for its answer
BY_TILES = """
LAS and LAZ that need more than --memory, and folders, get tiles; --dry-run plans. A run that
ended early goes on, or with --restart begins anew. Of several files a folder OUT gets one each.
"""


def _memory(text):
    from sklearn_mcmd.tiling._memory import parse_memory

    return parse_memory(text)


@dataclass
class CloudVerb:
    """A verb that reads a cloud, finds something by an estimator, and writes the cloud with it.

    The fields here are what all of them take. A verb adds its own, with the help of each, and its
    docstring is its help. It has methods of these names, too.
    """

    estimator: ClassVar[Callable]  # (): the estimator, with its parameters as options tell them
    # (cloud, estimator): the outcome in memory, by names; numbers have those of `RunReport`
    find: ClassVar[Callable]
    written: ClassVar[Callable]  # (cloud, outcome=None): the `Output`; blank without an outcome
    rows: ClassVar[Callable]  # (outcome): rows of the summary, of memory or of a `RunReport`
    contents: ClassVar[Callable]  # (cloud, outcome): `Contents` of a report,
    tile_contents: ClassVar[Callable]  # (catalog, run): and of one by tiles

    source: _options.InFiles
    target: _options.OutFiles
    memory: float | None = option(
        None,
        "Memory to take, such as 2GB; 430MB or more.",
        parser=parsed(_memory, "a size, such as 2GB"),
        metavar="SIZE",
        show_default="half of it",
    )
    scheduler: str | None = option(
        None,
        "Divide the work among the workers of this dask scheduler, such as tcp://node1:8786. "
        "They must see the folder of OUT.",
        metavar="ADDRESS",
        show_default="processes of this machine",
        hidden=True,
    )
    dry_run: bool = option(
        False,
        f"Show tiles, memory and time of {TILED_NAMES}, as estimated, and stop.",
        "--dry-run",
        hidden=True,
    )
    restart: bool = option(
        False, "Begin anew, whatever an earlier run has left.", "--restart", hidden=True
    )
    random_state: _options.RandomState = 0
    n_jobs: _options.NJobs = -1
    report: _files.ReportFolder = None
    columns: _options.Columns = None
    unit: _options.HiddenUnit = ""  # which options that are lengths look up
    allow_coarse: _options.AllowCoarse = False
    help_all: _options.HelpAll = False
    quiet: _options.Quiet = False

    @property
    def inputs(self):
        """The files that are divided into tiles together."""
        return [self.source]

    results = ""  # what formats may have no place for
    writes_all = True  # whether no point is left out

    def check_options(self, catalog):
        """Raise before the work if options cannot be had, by tiles if there is a catalog."""

    def dry_parameters(self, catalog):
        """Other parameters of an estimator whose time a dry run measures."""
        return {}

    def tile_options(self):
        """What `process_files` takes beside the estimator."""
        return {"colors": getattr(self, "colors", None)}

    def write(self, cloud, outcome):
        _files.write(self.target, self.written(cloud, outcome))

    def in_memory(self, estimator):
        """The outcome, and what makes the `Contents` of a report of it."""
        cloud = _files.read(self.source, self.target, self.results, columns=self.columns)
        blank = self.written(cloud)
        rehearse(self.target, blank.cloud, blank.noise, whole=self.writes_all)
        with _files.working(self.source):
            results = self.find(cloud, estimator)
            outcome = SimpleNamespace(n_points=len(cloud), n_tiles=0, **results)
        self.write(cloud, outcome)
        return outcome, lambda: self.contents(cloud, outcome)

    def by_tiles(self, catalog, estimator):
        """Likewise, with the `RunReport` as outcome."""
        from sklearn_mcmd.tiling import process_files

        asked = {"memory": self.memory, "n_jobs": estimator.n_jobs, "restart": self.restart}
        run = process_files(catalog, self.target, estimator, **asked, **self.tile_options())
        return run, lambda: self.tile_contents(catalog, run)

    def shown(self, catalog, run, names):
        """What a report shows of these attributes of a run by tiles."""
        from sklearn_mcmd.report._shown import Shown
        from sklearn_mcmd.tiling._outputs import targets_of

        return Shown.of_tiles(catalog, targets_of(catalog, self.target), run, names)

    def run(self):
        from sklearn_mcmd._sklearn import check_parameters

        begin, estimator = time.perf_counter(), self.estimator()
        check_parameters(estimator)
        with nullcontext() if self.scheduler is None else joblib_by(self.scheduler):
            catalog = self._large_catalog()
            self.check_options(catalog)
            if self.dry_run:
                self._print_plan(catalog, estimator)
                return
            with _messages.progress(type(self).__name__.lower(), self.quiet):
                if catalog is None:
                    outcome, contents = self.in_memory(estimator)
                else:
                    outcome, contents = self.by_tiles(catalog, estimator)
                _files.write_report_of(self, begin, contents)
            if not self.quiet:
                rows = {"points": f"{outcome.n_points:,}"} | self.rows(outcome)
                title = f"{', '.join(map(str, self.inputs))} -> {self.target}"
                _messages.print_table(title, begin, **rows)

    def _large_catalog(self):
        """The catalog of the source, if what the verb reads is to be divided into tiles, else None.

        Faults of a single file are left to the reading of it, unless a scheduler divides it.
        """
        for source in self.inputs:
            if not source.exists():
                raise FileNotFoundError(ENOENT, "no such file or folder", str(source))
        if self.scheduler is not None or any(map(_files.is_several, self.inputs)):
            return _files.catalog_of(self.source, self.columns)
        for source in self.inputs:
            if source.suffix.lower() not in TILED:
                if self.memory is not None:
                    warnings.warn(
                        f"{source}: is read as a whole, whatever --memory is; only {TILED_NAMES} "
                        "are divided into tiles",
                        stacklevel=2,
                    )
                return None
        from sklearn_mcmd.tiling._memory import bytes_in_memory, usual_memory

        try:
            catalogs = [_files.catalog_of(source, self.columns) for source in self.inputs]
        except PointFileError:
            return None
        needed = sum(map(bytes_in_memory, catalogs))
        return catalogs[0] if needed > (self.memory or usual_memory()) else None

    def _print_plan(self, catalog, estimator):
        """Print tiles, memory and time; the time is measured with the first points."""
        from sklearn_mcmd.tiling._base import warm_up
        from sklearn_mcmd.tiling._beside import SensorPath
        from sklearn_mcmd.tiling._memory import (
            bytes_in_memory,
            bytes_of_point,
            plan_run,
            usual_memory,
        )
        from sklearn_mcmd.tiling._run import DISK_POINT

        if catalog is None and self.source.suffix.lower() not in TILED:
            raise PointFileError(f"{self.source}: --dry-run is for {TILED_NAMES}")
        tiles, catalog = catalog is not None, catalog or _files.catalog_of(self.source)
        rows = {"points": f"{catalog.n_points:,}", "files": f"{len(catalog):,}"}
        others = map(_files.catalog_of, self.inputs[1:])
        n_points = catalog.n_points + sum(one.n_points for one in others)
        n_jobs = estimator.n_jobs
        xyz = next(iter(read_parts(catalog.paths[0], SAMPLE))).xyz[:SAMPLE]
        alone = {name: 1 for name in estimator.get_params() if name.endswith("n_jobs")}
        warm_up(estimator.set_params(**alone, **self.dry_parameters(catalog)))
        if tiles:
            limit, point = self.memory or usual_memory(), bytes_of_point(estimator.fit, xyz)
            path = SensorPath(self.tile_options().get("sensor_origin"))
            plan = plan_run(n_points, limit, n_jobs, None, point, *path.costs)
            threads = f" with {plan.n_threads} threads" if plan.n_threads > 1 else ""
            rows |= {
                "tiles": f"about {plan.n_tiles:,} of at most {plan.tile_size:,} points",
                "processes": f"{plan.n_workers}{threads}",
                "memory": f"about {plan.memory / 1e9:.2g} GB",
                "disk": f"about {DISK_POINT * n_points / 1e9:.2g} GB for temporary files beside "
                f"{self.target}",
            }
        else:
            needed = bytes_in_memory(catalog)
            rows["memory"] = f"at most {needed / 1e9:.2g} GB, without tiles"
        begin = time.perf_counter()
        estimator.fit(xyz)
        seconds = (time.perf_counter() - begin) / len(xyz) * n_points
        if tiles:
            seconds *= MORE / (plan.n_workers * plan.n_threads)
        title = f"{self.source} -> {self.target}"
        _messages.print_table(
            title, **rows, time=f"about {timedelta(seconds=round(seconds))} (hours:minutes:seconds)"
        )


def tiles_row(outcome):
    """The row of the summary on tiles, where there are any."""
    if outcome.n_tiles == 0:
        return {}
    share = 100 * outcome.n_proven / max(1, outcome.n_points)
    return {
        "tiles": f"{outcome.n_tiles:,}, of which {outcome.n_resumed:,} were done before",
        "halos": f"complete for {share:.2f} % of the points",
    }


@contextmanager
def joblib_by(scheduler):
    """Make joblib send its work to the scheduler of dask.distributed at this address."""
    distributed = import_extra("distributed", "dask", "--scheduler")
    import asyncio

    import joblib

    try:
        # A client that fails to connect leaves threads and messages, so one asks before.
        asyncio.run(_connect(distributed, scheduler))
    except (OSError, ValueError, TypeError, RuntimeError) as err:  # the last two: of TLS
        raise ValueError(f"--scheduler {scheduler}: no scheduler of dask answers: {err}") from err
    with distributed.Client(scheduler, timeout=SECONDS, set_as_default=False) as client:
        try:
            client.wait_for_workers(1, timeout=SECONDS)
        except TimeoutError as err:
            raise ValueError(
                f"--scheduler {scheduler}: has no workers; start some with: dask worker {scheduler}"
            ) from err
        with joblib.parallel_config(backend="dask", client=client):
            yield


async def _connect(distributed, scheduler):
    arguments = distributed.Security().get_connection_args("client")
    connection = await distributed.core.connect(scheduler, timeout=SECONDS, **arguments)
    await connection.close()
