"""``--report``: the option, and the pages when the work is done."""

import shlex
from pathlib import Path
from typing import Annotated, NamedTuple

import typer
from typer.core import TyperCommand

from sklearn_mcmd.cli._messages import clear_exits, warned
from sklearn_mcmd.report._contents import Parameter, Run
from sklearn_mcmd.runtime._interrupts import ignore_interrupts
from sklearn_mcmd.runtime._progress import current_span, progress_part

__all__ = ["ReportFolder", "Verb", "write_report_of"]

TYPED = f"{__name__}.typed"
DRAWN = 0.8  # share of a report's time until its maps are drawn


class Verb(TyperCommand):
    """A command that remembers what was typed after its name."""

    def parse_args(self, ctx, args):
        ctx.meta[TYPED] = list(args)
        return super().parse_args(ctx, args)


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
        help="Folder for a report: index.html with counts, maps and warnings in plain words, and "
        "view.html to look around in. It is made if missing.",
    ),
]


def write_report_of(report, source, target, seconds, contents):
    """Write a report, if one is asked for. Then all outputs are there: Ctrl-C comes too late.

    ``seconds()`` is the time of the work so far. ``contents()`` makes the `Contents`, and takes
    time.
    """
    if report is not None:
        from sklearn_mcmd.report._notes import with_warnings
        from sklearn_mcmd.report._report_folder import write_report

        name, typed = report.context.command.name, report.context.meta[TYPED]
        command, parameters = shlex.join(["mcmd", name, *typed]), _parameters(report.context)
        run = Run(name, command, tuple(parameters), source, target, seconds())
        with progress_part(1.0, 1.0, "report"):
            span, made = current_span(), contents()
            if span is not None:
                span.tell(DRAWN)
            write_report(report.folder, run, with_warnings(made, warned()))
    ignore_interrupts()


def _parameters(context):
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
