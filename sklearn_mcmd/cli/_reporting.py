"""``--report``: the option, and the pages when the work is done."""

import shlex
from pathlib import Path
from typing import Annotated, NamedTuple

import typer

from sklearn_mcmd.cli._command import TYPED
from sklearn_mcmd.cli._messages import clear_exits, warned
from sklearn_mcmd.runtime._interrupts import ignore_interrupts
from sklearn_mcmd.runtime._progress import current_span, progress_part

DRAWN = 0.8  # share of a report's time until its maps are drawn


class Report(NamedTuple):
    """The folder of a report, and the context of the command that it tells of."""

    folder: Path
    context: typer.Context


def _check(context: typer.Context, folder: Path | None):
    """Refuse a folder that cannot be written, before the work."""
    if folder is None:
        return None
    with clear_exits():
        from sklearn_mcmd.report._report_folder import check_folder

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


def write_report_of(verb, seconds, contents):
    """Write a verb's report, if one is asked for. Then all outputs are there: Ctrl-C is too late.

    ``seconds()`` is the time of the work so far. ``contents()`` makes the `Contents`, and takes
    time.
    """
    if verb.report is not None:
        from sklearn_mcmd.report._contents import Run
        from sklearn_mcmd.report._notes import with_warnings
        from sklearn_mcmd.report._report_folder import write_report

        folder, context = verb.report
        name = context.command.name
        run = Run(
            verb=name,
            command=shlex.join(["mcmd", name, *context.meta[TYPED]]),
            parameters=tuple(_parameters(context)),
            source=verb.source,
            target=verb.target,
            seconds=seconds(),
        )
        with progress_part(1.0, 1.0, "report"):
            span, made = current_span(), contents()
            if span is not None:
                span.report(DRAWN)
            write_report(folder, run, with_warnings(made, warned()))
    ignore_interrupts()


def _parameters(context):
    from sklearn_mcmd.report._contents import Parameter

    for parameter in context.command.params:
        if parameter.param_type_name != "option" or parameter.name == "help":
            continue
        value = context.params.get(parameter.name)
        is_default = context.get_parameter_source(parameter.name).name == "DEFAULT"
        shown = getattr(parameter, "show_default", None)
        words = shown if is_default and value is None and isinstance(shown, str) else _words(value)
        yield Parameter(max(parameter.opts, key=len), words, is_default)


def _words(value):
    if value is None:
        return "none"
    if isinstance(value, Report):
        return str(value.folder)
    if isinstance(value, dict):
        return ",".join(f"{axis}={name}" for axis, name in value.items())
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, tuple):
        return ",".join(map(_words, value))
    return str(value).removesuffix(".0")
