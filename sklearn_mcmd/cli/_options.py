"""Options: fields of records, and commands of them; settings in files; what verbs share."""

import json
import re
from contextlib import contextmanager
from dataclasses import MISSING, field, fields
from inspect import Parameter, Signature, getdoc, signature
from math import isfinite
from pathlib import Path
from string import ascii_letters
from textwrap import indent, wrap
from typing import Annotated, Any, get_args

import typer
from typer.core import TyperCommand

from sklearn_mcmd.cli._messages import clear_exits
from sklearn_mcmd.io._formats import INDEX, TILED_NAMES

TYPED = f"{__name__}.typed"
WIDTH = 96  # of comments between settings
# They are of one run, or of no verb.
NO_SETTINGS = {"config", "help", "dry_run", "restart", "report", "output"}
# What options take, in a word; flags take nothing.
METAVARS = {bool: "", int: "NUMBER", float: "NUMBER", str: "WORD", Path: "FILE"}
# Units of lengths, in meters.
METERS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "ft": 0.3048, "in": 0.0254}


def option(default, help, *names, **settings) -> Any:
    """A field of a verb, with what Typer makes of it; `command_of` reads both."""
    return field(default=default, metadata={"option": typer.Option(*names, help=help, **settings)})


def length(default, help, *words, metavar="LENGTH", signed=False, **settings) -> Any:
    """The field of a length in units of the file, or with a unit of its own, or of some words."""
    about = "a number" if signed else "a number above 0"

    def number(text):
        try:
            value = float(text)
        except ValueError:
            value = float("nan")
        if not isfinite(value) or (value <= 0 and not signed):
            choices = ", ".join(words) + " or " if words else ""
            raise typer.BadParameter(f"{text} is not {choices}{about}")
        return value

    def parse(context: typer.Context, text):
        if text is None or text in words:
            return text
        digits = text.rstrip(f"{ascii_letters} ")
        if not digits or digits == text:
            return number(text)
        value, own, unit = number(digits), text[len(digits) :].strip(), context.params["unit"]
        if own in METERS and not unit:
            raise typer.BadParameter(f"{text}: say the unit of the file as well, such as --unit m")
        if not METERS.keys() >= {own, unit}:
            raise typer.BadParameter(
                f"{text} is no number. With a unit, it needs --unit, the unit of the file; both "
                f"are one of {', '.join(METERS)}"
            )
        return METERS[own] / METERS[unit] * value

    return option(default, help, parser=str, callback=parse, metavar=metavar, **settings)


def made(verb, kind, **others):
    """An estimator; its parameters are options of the same names that have a value, and others."""
    names = signature(kind).parameters.keys() & {one.name for one in fields(verb)}
    given = {name: getattr(verb, name) for name in names if getattr(verb, name) is not None}
    return kind(**given | others)


def _not_zero(value):
    if value == 0:
        raise typer.BadParameter("0 threads cannot work; -1 is one a processor")
    return value


def _columns(text):
    """The columns of axes, as in x=easting,y=northing,z=3."""
    columns = dict(part.split("=", 1) for part in text.split(",") if "=" in part)
    if len(columns) != text.count(",") + 1 or not columns.keys() <= set("xyz"):
        raise typer.BadParameter(f"{text} is not of the form x=easting,y=northing,z=elevation")
    return columns


InFiles = Annotated[
    Path,
    typer.Argument(
        metavar="IN", help=f"Point file to read, or a folder or {INDEX} index of {TILED_NAMES}."
    ),
]
OutFiles = Annotated[
    Path, typer.Argument(metavar="OUT", help="Point file to write, or a folder; may be IN.")
]
NNeighbors = Annotated[int, typer.Option(min=4, help="Points in a neighborhood, itself included.")]
MaxOutlierRate = Annotated[
    float,
    typer.Option(
        help="Largest share of outliers that a neighborhood must survive. It sets the number of "
        "trials, not the share that is removed.",
        hidden=True,
    ),
]
RandomState = Annotated[
    int,
    typer.Option(
        min=0, max=2**32 - 1, help="Seed. The same seed gives the same file.", hidden=True
    ),
]
NJobs = Annotated[
    int,
    typer.Option(
        callback=_not_zero, help="Number of threads. -1: one for each processor.", hidden=True
    ),
]
Columns = Annotated[
    dict | None,
    typer.Option(
        parser=_columns,
        metavar="x=A,y=B,...",
        help="Columns, by name or number.",
        show_default="by header",
    ),
]
AllowCoarse = Annotated[
    bool,
    typer.Option(
        "--allow-coarse",
        help="Accept coordinates that single precision rounds too coarsely for the spacing of the "
        "points, such as large coordinates in PLY or PCD. Without this they are an error.",
        hidden=True,
    ),
]
UNIT = {
    "is_eager": True,
    "metavar": "UNIT",
    "help": "Unit of the file, such as m. Lengths may then have another.",
}
Unit = Annotated[str, typer.Option(**UNIT)]
HiddenUnit = Annotated[str, typer.Option(hidden=True, **UNIT)]
NoClobber = Annotated[bool, typer.Option("--no-clobber", help="Replace no file: fail instead.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Show warnings only.")]


def _settings(context):
    """The options that a file may hold, by verb and name."""
    return {
        verb: {
            option.name: option
            for option in command.loaded.params
            if option.param_type_name == "option" and option.name not in NO_SETTINGS
        }
        for verb, command in context.find_root().command.commands.items()
        if any(option.name == "config" for option in command.loaded.params)
    }


def _read(context: typer.Context, path: Path | None):
    """Take the settings of the verb as its defaults; refuse what no verb knows."""
    if path is None:
        return None
    import tomllib

    try:
        tables = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as err:
        words = getattr(err, "strerror", None) or str(err)
        raise typer.BadParameter(f"{path} cannot be read: {words}") from err
    known = _settings(context)
    for verb, table in tables.items():
        if not isinstance(table, dict):
            raise typer.BadParameter(f"{path}: {verb} must stand below a verb, such as [denoise]")
        if verb not in known:
            raise typer.BadParameter(
                f"{path}: no settings are of [{verb}], but of {', '.join(known)}"
            )
        for name in table.keys() - known[verb].keys():
            raise typer.BadParameter(
                f"{path}: {verb} has no setting {name}; mcmd config {verb} lists all"
            )
    context.default_map = {
        name: ",".join(map(str, value)) if isinstance(value, list) else str(value)
        for name, value in tables.get(context.info_name or "", {}).items()
    }
    return path


Config = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE", callback=_read, is_eager=True, help="Settings (TOML); options count more."
    ),
]


def config(
    context: typer.Context,
    verb: Annotated[
        str | None, typer.Argument(metavar="VERB", help="The verb whose settings to print.")
    ] = None,
):
    known = _settings(context)
    if verb not in (None, *known):
        raise typer.BadParameter(f"{verb} is no verb with settings: {', '.join(known)}")
    for name in [verb] if verb else known:
        typer.echo(f"[{name}]")
        for option in known[name].values():
            typer.echo(indent("\n".join(wrap(option.help or "", WIDTH)), "# "))
            if option.default is None:
                words = option.show_default
                by_default = f"  # by default: {words}" if isinstance(words, str) else ""
                typer.echo(f"# {option.name} = {by_default}".rstrip())
            else:
                typer.echo(f"{option.name} = {json.dumps(option.default)}")


class TypedCommand(TyperCommand):
    """A command that remembers what was typed after its name, and says where a wrong value is."""

    def parse_args(self, ctx, args):
        ctx.meta[TYPED] = list(args)
        with self._clear_usage(ctx):
            return super().parse_args(ctx, args)

    def invoke(self, ctx):
        with self._clear_usage(ctx):
            return super().invoke(ctx)

    @contextmanager
    def _clear_usage(self, ctx):
        """Plain words for pydantic's; and the file and the setting, if the value is of one."""
        try:
            yield
        except typer.BadParameter as err:
            words = err.message.removeprefix("Value error, ")
            words = re.sub(r"Input should be a valid (\w+).*", r"not a valid \1", words)
            err.message = words.replace("Input should be", "must be")
            for option in self.params:
                source = ctx.get_parameter_source(option.name)
                is_wrong = err.param is option or err.param_hint in option.opts
                if is_wrong and source.name == "DEFAULT_MAP":
                    place = f"{ctx.params['config']}: {ctx.info_name}.{option.name}"
                    err.message = f"{place}: {err.message}"
            err.param_hint = err.param_hint and f"'{err.param_hint}'"  # as where Typer finds it
            raise


def command_of(kind, *, without=(), more=""):
    """The function that Typer takes: its options are the fields of a record, some left out.

    Files come first, and what the record inherits comes last. Its docstring and `more` are the
    help, and its `run` does the work. Of each tuple in its `one_of`, one option may have a value.
    """
    shared = {one.name for base in kind.__mro__[1:-1] for one in fields(base)}
    taken = [one for one in fields(kind) if one.name not in without]
    taken.sort(key=lambda one: (one.name not in ("source", "target"), one.name in shared))
    parameters = []
    for one in taken:
        hint = one.type
        if one.metadata:
            hint = Annotated[hint, one.metadata["option"]]
        option = hint.__metadata__[0]
        if option.metavar is None:
            kinds = METAVARS.keys() & {hint.__origin__, *get_args(hint.__origin__)}
            option.metavar = METAVARS[kinds.pop()] if kinds else "WORD"
        default = Parameter.empty if one.default is MISSING else one.default
        parameters.append(
            Parameter(one.name, Parameter.POSITIONAL_OR_KEYWORD, default=default, annotation=hint)
        )
    call = Signature(parameters)

    def command(*args, **kwargs):
        given = call.bind(*args, **kwargs).arguments
        for names in getattr(kind, "one_of", ()):
            values = {one: given.get(one) for one in names}
            asked = [
                f"--{one.replace('_', '-')} {value}"
                for one, value in values.items()
                if value not in (None, "none")  # as --sensor none, which gives none
            ]
            if len(asked) > 1:
                raise typer.BadParameter(
                    f"{' and '.join(asked)} exclude each other: leave all but one out."
                )
        with clear_exits(allow_coarse=given.get("allow_coarse", False)):
            kind(**given).run()

    command.__name__ = kind.__name__.lower()
    command.__doc__ = f"{getdoc(kind)}\n{more}"
    command.__signature__ = call
    command.__annotations__ = {one.name: one.annotation for one in parameters}
    return command
