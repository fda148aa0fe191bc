"""What ``denoise``, ``normals``, ``segment`` and ``edges`` share: options, help, and the run."""

from contextlib import ExitStack
from dataclasses import dataclass, fields
from inspect import signature
from types import SimpleNamespace

import typer

from sklearn_mcmd.cli import _files, _messages, _options
from sklearn_mcmd.cli._config import Config
from sklearn_mcmd.cli._options import option
from sklearn_mcmd.cli._progress_bar import progress
from sklearn_mcmd.cli._reporting import ReportFolder, write_report_of
from sklearn_mcmd.io._formats import TILED_NAMES
from sklearn_mcmd.io._point_cloud import has_colors
from sklearn_mcmd.io._rehearsal import rehearse

BY_TILES = """
LAS and LAZ that need more than --memory, and folders, get tiles, with the same results; --dry-run
plans. A run that ended early goes on, or with --restart begins anew. Of several files a folder
OUT gets one each; an OUT that ends in .las or .laz gets all.
"""


def _memory(text):
    from sklearn_mcmd.tiling._memory import parse_memory

    try:
        return parse_memory(text)
    except ValueError as err:
        raise typer.BadParameter(str(err).removeprefix("memory=")) from err


@dataclass
class CloudVerb:
    """A verb that reads a cloud, finds something by an estimator, and writes the cloud with it.

    The fields here are what all of them take. A verb adds its own, with the help of each, and its
    docstring is its help.
    """

    source: _options.InFiles
    target: _options.OutFiles
    memory: float | None = option(
        None,
        "Memory to take, such as 2GB; 430MB or more.",
        parser=_memory,
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
    report: ReportFolder = None
    columns: _options.Columns = None
    unit: _options.HiddenUnit = ""  # which options that are lengths look up
    no_clobber: _options.NoClobber = False
    allow_coarse: _options.AllowCoarse = False
    config: Config = None
    quiet: _options.Quiet = False

    # What it finds, and how many features: as of `plan_run`. And what formats may have no place
    # for.
    work, n_features, results = "", 0, ""
    writes_all = True  # whether no point is left out

    def check(self, catalog):
        """Raise if options do not go with a cloud in tiles, or in memory if there is no catalog."""

    def outputs(self):
        """The files to write, the cloud first."""
        return [self.target]

    def estimator(self):
        """The estimator, with its parameters as options tell them."""

    def dry_estimator(self):
        """The estimator whose time a dry run measures, which reads no positions of the sensor."""
        return self.estimator()

    def tile_options(self):
        """What `process_files` takes beside the estimator."""
        return {}

    def find(self, cloud):
        """What is found in a cloud in memory."""

    def written(self, cloud, found=None):
        """The cloud to write, and the points to mark in it; a blank one if nothing is found yet."""

    def write(self, cloud, found):
        _files.write(self.target, *self.written(cloud, found))

    def counts(self, cloud, found):
        """Numbers of what was found in memory, by the names of `RunReport`."""

    def contents(self, cloud, found, told):
        """The `Contents` of a report."""

    def tile_contents(self, catalog, told):
        """The `Contents` of a report on a run by tiles."""

    def rows(self, told):
        """Rows of the summary; `told` are `counts` of a cloud in memory, or what tiles came to."""

    def made(self, kind, **others):
        """An estimator: its parameters are the options of the same names, and others."""
        names = signature(kind).parameters.keys() & {field.name for field in fields(self)}
        return kind(**{name: getattr(self, name) for name in names} | others)

    def colored(self, cloud):
        """Whether to write colors, for verbs with an option for that."""
        return not has_colors(cloud) if self.colors is None else self.colors

    def in_memory(self):
        cloud = _files.read(self.source, self.target, self.results, columns=self.columns)
        rehearse(self.target, *self.written(cloud), whole=self.writes_all)
        with _files.working(self.source):
            found = self.find(cloud)
            told = SimpleNamespace(n_points=len(cloud), n_tiles=0, **self.counts(cloud, found))
        self.write(cloud, found)
        return told, lambda: self.contents(cloud, found, told)

    def by_tiles(self, catalog):
        from sklearn_mcmd.tiling import process_files

        estimator = self.estimator()
        asked = {"memory": self.memory, "n_jobs": estimator.n_jobs, "restart": self.restart}
        told = process_files(catalog, self.target, estimator, **asked, **self.tile_options())
        return told, lambda: self.tile_contents(catalog, told)

    def shown(self, catalog, told, *names):
        """What a report shows of these attributes of a run by tiles."""
        from sklearn_mcmd.report._shown import Shown
        from sklearn_mcmd.tiling._outputs import targets_of

        return Shown.of_tiles(catalog, targets_of(catalog, self.target), told, names)

    def run(self):
        from sklearn_mcmd._sklearn import check_parameters
        from sklearn_mcmd.cli._large import large_catalog, print_plan

        check_parameters(self.estimator())
        seconds = _messages.stopwatch()
        with ExitStack() as stack:
            if self.scheduler is not None:
                from sklearn_mcmd.cli._scheduler import joblib_by

                stack.enter_context(joblib_by(self.scheduler))
            catalog = large_catalog(self)
            self.check(catalog)
            if self.dry_run:
                print_plan(self, catalog)
                return
            there = {"report": self.report, "catalog": catalog}
            _files.refuse_existing(self.no_clobber, *self.outputs(), **there)
            with progress(type(self).__name__.lower(), self.quiet):
                told, contents = self.in_memory() if catalog is None else self.by_tiles(catalog)
                write_report_of(self, seconds, contents)
            if not self.quiet:
                files = self.source, self.target
                _messages.print_summary(*files, told.n_points, seconds(), **self.rows(told))


def tiles_row(told):
    """The row of the summary on tiles, where there are any."""
    if told.n_tiles == 0:
        return {}
    return {"tiles": f"{told.n_tiles:,}, of which {told.n_resumed:,} were done before"}
