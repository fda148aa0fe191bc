"""What ``denoise``, ``normals``, ``segment`` and ``edges`` share: options, help, and the run."""

from dataclasses import dataclass, fields
from inspect import Signature, getdoc, signature
from types import SimpleNamespace

from sklearn_mcmd.cli import _files, _messages, _options
from sklearn_mcmd.cli._config import Config
from sklearn_mcmd.cli._large import DryRun, Memory, Restart, large_catalog, outputs_of, print_plan
from sklearn_mcmd.cli._progress_bar import progress
from sklearn_mcmd.cli._reporting import ReportFolder, write_report_of
from sklearn_mcmd.cli._scheduler import Scheduler, engine

__all__ = ["CloudVerb", "command_of", "counts", "tiles_row"]

BY_TILES = """
LAS and LAZ that need more than --memory, and folders of them, are divided into tiles, and with
--scheduler all are. The results are the same. Temporary files lie beside OUT, in OUT.tiles. If
a run ends early, they are kept, and the same command goes on from there, or begins anew with
--restart. --dry-run tells tiles, memory and time. If IN is a folder or an index .vpc, a folder
OUT gets one file for each; an OUT that ends in .las or .laz gets all.
"""


@dataclass
class CloudVerb:
    """A verb that reads a cloud, finds something by an estimator, and writes the cloud with it.

    The fields here are what all of them take. A verb adds its own, with the help of each, and its
    docstring is its help.
    """

    source: _options.InFiles
    target: _options.OutFiles
    memory: Memory = None
    scheduler: Scheduler = None
    dry_run: DryRun = False
    restart: Restart = False
    report: ReportFolder = None
    columns: _options.Columns = None
    unit: _options.HiddenUnit = ""  # which options that are lengths look up
    no_clobber: _options.NoClobber = False
    allow_coarse: _options.AllowCoarse = False
    config: Config = None
    quiet: _options.Quiet = False

    # What it finds, and how many features: as of `plan_run`.
    work, n_features = "", 0

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

    def in_memory(self):
        """Read, find and write; return `counts`, and what makes the `Contents` of a report."""

    def tile_contents(self, catalog, told):
        """The `Contents` of a report on a run by tiles."""

    def rows(self, told):
        """Rows of the summary; `told` are `counts` of a cloud in memory, or what tiles came to."""

    def made(self, kind, **others):
        """An estimator: its parameters are the options of the same names, and others."""
        names = signature(kind).parameters.keys() & {field.name for field in fields(self)}
        return kind(**{name: getattr(self, name) for name in names} | others)

    def read(self, results):
        """The cloud, if OUT can be written and has a place for these results."""
        return _files.read(self.source, self.target, results, columns=self.columns)

    def by_tiles(self, catalog):
        from sklearn_mcmd.tiling import process_files

        estimator = self.estimator()
        told = process_files(
            catalog, self.target, estimator, memory=self.memory, n_jobs=estimator.n_jobs,
            restart=self.restart, **self.tile_options(),
        )  # fmt: skip
        return told, lambda: self.tile_contents(catalog, told)

    def shown(self, catalog, told, *names):
        """What a report shows of these attributes of a run by tiles."""
        from sklearn_mcmd.report._shown import Shown

        return Shown.of_tiles(catalog, outputs_of(catalog, self.target), told, names)

    def run(self):
        seconds, size, work = _messages.stopwatch(), self.n_features, self.work
        source, target, always = self.source, self.target, self.scheduler is not None
        catalog = large_catalog(source, self.memory, size, always, self.columns, work=work)
        self.check(catalog)
        if self.dry_run:
            estimator = self.dry_estimator()
            print_plan(source, target, catalog, estimator, self.memory, n_features=size, work=work)
            return
        _files.refuse_existing(
            self.no_clobber, *self.outputs(), report=self.report, catalog=catalog
        )
        with progress(type(self).__name__.lower(), self.quiet):
            told, contents = self.in_memory() if catalog is None else self.by_tiles(catalog)
            write_report_of(self.report, source, target, seconds, contents)
        if not self.quiet:
            _messages.print_summary(source, target, told.n_points, seconds(), **self.rows(told))


def counts(n_points, **others):
    """What was found in memory, by the names of `RunReport`; there are no tiles."""
    return SimpleNamespace(n_points=n_points, n_tiles=0, **others)


def tiles_row(told):
    """The row of the summary on tiles, where there are any."""
    if told.n_tiles == 0:
        return {}
    return {"tiles": f"{told.n_tiles:,}, of which {told.n_resumed:,} were done before"}


def command_of(kind, *, without=()):
    """The function that Typer takes: its options are the fields of a verb, some left out."""
    own = {name: p for name, p in signature(kind).parameters.items() if name not in without}
    source, target, *shared = (own.pop(f.name) for f in fields(CloudVerb) if f.name in own)
    taken = Signature([source, target, *own.values(), *shared])

    def command(*args, **kwargs):
        given = taken.bind(*args, **kwargs).arguments
        with _messages.clear_exits(allow_coarse=given.get("allow_coarse", False)):
            verb = kind(**given)
            with engine(verb.scheduler):
                verb.run()

    command.__name__ = kind.__name__.lower()
    command.__doc__ = f"{getdoc(kind)}\n{BY_TILES}"
    command.__signature__ = taken
    command.__annotations__ = {name: option.annotation for name, option in taken.parameters.items()}
    return command
