"""Reading and writing by the verbs, reports too. Errors of writing appear before the long work."""

import shlex
import time
import warnings
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np
import typer

from sklearn_mcmd._errors import agreed, counted
from sklearn_mcmd.cli import TYPED
from sklearn_mcmd.cli._messages import clear_exits, warned
from sklearn_mcmd.io import PointCloud, read_points, write_points
from sklearn_mcmd.io._formats import ALL, INDEX, TILED, format_of, no_columns, supported_extensions
from sklearn_mcmd.io._no_returns import LEFT_OUT
from sklearn_mcmd.io._point_cloud import joined
from sklearn_mcmd.io._rehearsal import rehearse
from sklearn_mcmd.planes._resolution import coarse_warning, in_own_precision
from sklearn_mcmd.runtime._interrupts import ignore_interrupts
from sklearn_mcmd.runtime._progress import current_span, progress_part

USUAL_NEIGHBORS = 50  # of estimators by default, where none have been given
# Begin and end of the work between reading and writing, as shares of a verb's progress.
WORK_BEGINS, WORK_ENDS = 0.04, 0.97
DRAWN = 0.8  # share of a report's time until its maps are drawn


def warn_if_coarse(cloud):
    """Warn as estimators with neighborhoods do, for a verb whose estimator has none."""
    if in_own_precision(cloud.xyz).dtype == np.float32:
        from sklearn_mcmd.planes._neighborhoods import NeighborIndex

        if coarse := coarse_warning(NeighborIndex(cloud.xyz, USUAL_NEIGHBORS)):
            warnings.warn(coarse, stacklevel=2)


def is_several(source):
    """Whether a source stands for several files."""
    return source.is_dir() or source.suffix.lower() == INDEX


def files_of(source):
    """The point files of a folder or an index, or the file itself."""
    if not is_several(source):
        return [source]
    from sklearn_mcmd.tiling._catalog import paths_of

    return paths_of(source, supported_extensions())


def catalog_of(source, columns=None):
    """The catalog of LAS and LAZ files, which know their columns."""
    from sklearn_mcmd.tiling import Catalog

    if columns is not None:
        told = no_columns(columns)
        raise ValueError(f"{source}: {told}") from told
    return Catalog(source)


def read_all(source, columns=None):
    """One cloud of a file, or of all files of a folder or an index."""
    paths, clouds = files_of(source), []
    if len(paths) > 1 and all(path.suffix.lower() in TILED for path in paths):
        from sklearn_mcmd.tiling import Catalog

        Catalog(paths)  # refuses several coordinate systems
    for number, path in enumerate(paths):
        with progress_part(number / len(paths), (number + 1) / len(paths)):
            clouds.append(read(path, columns=columns))
    return joined(clouds) if len(clouds) > 1 else clouds[0]


def read(source, target=None, results=None, *, columns=None):
    """Read a cloud; first refuse a `target` that cannot be written or cannot hold `results`.

    `columns` is as of `read_points`.
    """
    if target is not None:
        check_output(target, results)
    with progress_part(0.0, WORK_BEGINS, "reading"):
        cloud = read_points(source, columns=columns)
    if n_left := cloud.n_dropped - cloud.metadata.get(LEFT_OUT, 0):
        words = f"{counted(n_left, 'point')} without coordinates {agreed(n_left, 'are')} left out"
        warnings.warn(f"{source}: {words}", stacklevel=2)
    return cloud


def check_output(target, results):
    """Raise if a file cannot be written, or cannot hold results."""
    rehearse(target, PointCloud(np.zeros((1, 3))))
    if results and (one := format_of(target)).results not in (ALL, results):
        raise ValueError(f"{target}: {one.name} has no place for {results}; use another format")


@contextmanager
def working(source, stage=None):
    """The work between reading and writing. Its errors name the file, if they do not yet."""
    with progress_part(WORK_BEGINS, WORK_ENDS, stage):
        try:
            yield
        except Exception as err:
            if not hasattr(err, "__notes__") and not str(err).startswith(str(source)):
                err.add_note(f"{source}: ")
            raise


class Output(NamedTuple):
    """What is written: a cloud, and its points that are marked as noise, bool or class (n,)."""

    cloud: PointCloud
    noise: np.ndarray | None = None


def write(target, output):
    with progress_part(WORK_ENDS, 1.0, "writing"):
        write_points(target, output.cloud, noise=output.noise)


class Report(NamedTuple):
    """The folder of a report, and the context of the command that it tells of."""

    folder: Path
    context: typer.Context


def _check(context: typer.Context, folder: Path | None):
    """Refuse a folder that cannot be written, before the work."""
    if folder is None:
        return None
    with clear_exits():
        from sklearn_mcmd.report._rendering import check_folder

        check_folder(folder)
    return Report(folder, context)


ReportFolder = Annotated[
    Report | None,
    typer.Option(
        "--report",
        metavar="DIR",
        parser=Path,  # also keeps the value that the callback returns
        callback=_check,
        help="Folder for a report: counts, maps, warnings, the cloud.",
    ),
]


def write_report_of(verb, begin, contents):
    """Write a verb's report, if one is asked for. Then all outputs are there: Ctrl-C is too late.

    The work began at `begin`. ``contents()`` makes the `Contents`, and takes time.
    """
    if verb.report is not None:
        from sklearn_mcmd.report._contents import Note, Run
        from sklearn_mcmd.report._rendering import write_report

        folder, context = verb.report
        name = context.command.name
        run = Run(
            verb=name,
            command=shlex.join(["mcmd", name, *context.meta[TYPED]]),
            parameters=list(_parameters(context)),
            source=verb.source,
            target=verb.target,
            seconds=time.perf_counter() - begin,
        )
        with progress_part(1.0, 1.0, "report"):
            span, made = current_span(), contents()
            if span is not None:
                span.report(DRAWN)
            notes = [Note("Warned on the terminal.", words) for words in warned()]
            write_report(folder, run, made._replace(notes=notes + made.notes))
    ignore_interrupts()


def _parameters(context):
    for parameter in context.command.params:
        if parameter.param_type_name != "option" or parameter.name in ("help", "help_all"):
            continue
        value = context.params.get(parameter.name)
        is_default = context.get_parameter_source(parameter.name).name == "DEFAULT"
        shown = getattr(parameter, "show_default", None)
        words = shown if is_default and value is None and isinstance(shown, str) else _words(value)
        yield max(parameter.opts, key=len), words + " (default)" * is_default


def _words(value):
    if isinstance(value, Report):
        return str(value.folder)
    if isinstance(value, dict):
        value = tuple(f"{axis}={name}" for axis, name in value.items())
    if isinstance(value, tuple):
        return ",".join(map(_words, value))
    if value is None or isinstance(value, bool):
        return {None: "none", True: "yes", False: "no"}[value]
    return str(value).removesuffix(".0")
