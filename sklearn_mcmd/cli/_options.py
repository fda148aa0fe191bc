"""Options: fields of records, and commands of them; what verbs share."""

from dataclasses import MISSING, field, fields
from inspect import Parameter, Signature, getdoc, signature
from math import isfinite
from pathlib import Path
from string import ascii_letters
from typing import Annotated, Any, get_args

import typer
from typer.core import TyperOption

from sklearn_mcmd.cli._messages import clear_exits
from sklearn_mcmd.io._formats import INDEX, TILED_NAMES

FILES = "source", "other", "target"  # fields of files, which come first
# What options take, in a word, so that their help is not narrow; flags take nothing.
METAVARS = {bool: "", int: "NUMBER", float: "NUMBER", str: "WORD", Path: "FILE"}
# Units of lengths, in meters.
METERS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "ft": 0.3048, "in": 0.0254}


def option(default, help, *names, **settings) -> Any:
    """A field of a verb, with what Typer makes of it; `command_of` reads both."""
    return field(default=default, metadata={"option": typer.Option(*names, help=help, **settings)})


def parsed(function, form):
    """What reads the text of an option by a function; what this refuses has not the form."""

    def parse(text):
        try:
            return function(text)
        except ValueError as err:
            raise typer.BadParameter(f"{text} is not {form}") from err

    return parse


def length(default, help, *words, metavar="LENGTH", **settings) -> Any:
    """The field of a length in units of the file, or with a unit of its own, or of some words."""

    def number(text):
        try:
            value = float(text)
        except ValueError:
            value = float("nan")
        if not isfinite(value) or value <= 0:
            choices = ", ".join(words) + " or " if words else ""
            raise typer.BadParameter(f"{text} is not {choices}a number above 0")
        return value

    def parse(context: typer.Context, text):
        if text is None or text in words:
            return text
        digits = text.rstrip(f"{ascii_letters} ")
        if not digits or digits == text:
            return number(text)
        value, typed, unit = number(digits), text[len(digits) :].strip(), context.params["unit"]
        if not METERS.keys() >= {typed, unit}:
            raise typer.BadParameter(
                f"{text} is no number. With a unit, it needs --unit, the unit of the file; both "
                f"are one of {', '.join(METERS)}"
            )
        return METERS[typed] / METERS[unit] * value

    return option(default, help, parser=str, callback=parse, metavar=metavar, **settings)


def made(verb, kind, **others):
    """An estimator; its parameters are options of the same names that have a value, and others."""
    names = signature(kind).parameters.keys() & {one.name for one in fields(verb)}
    parameters = {name: getattr(verb, name) for name in names if getattr(verb, name) is not None}
    return kind(**parameters | others)


def _not_zero(value):
    if value == 0:
        raise typer.BadParameter("0 threads cannot work; -1 is one a processor")
    return value


def _columns(text):
    """The columns of axes, as in x=easting,y=northing,z=3."""
    pairs = [part.split("=", 1) for part in text.split(",")]
    columns = dict(pairs)
    if len(columns) < len(pairs) or not columns.keys() <= set("xyz"):
        raise ValueError
    return columns


SOURCES = f"Point file to read, or a folder or {INDEX} index of {TILED_NAMES}."
InFiles = Annotated[Path, typer.Argument(metavar="IN", help=SOURCES)]
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
        parser=parsed(_columns, "of the form x=easting,y=northing,z=elevation"),
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
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Show warnings only.")]


def _show_all(context: typer.Context, asked: bool):
    if asked:
        for option in context.command.params:
            if isinstance(option, TyperOption):
                option.hidden = False
        typer.echo(context.get_help())
        raise typer.Exit


HelpAll = Annotated[
    bool,
    typer.Option(
        "--help-all", callback=_show_all, is_eager=True, help="Show all options, and exit."
    ),
]


def command_of(kind, *, without=(), more=""):
    """The function that Typer takes: its options are the fields of a record, some left out.

    Files come first, and what the record inherits comes last. Its docstring and `more` are the
    help, and its `run` does the work. Of each tuple in its `one_of`, one option may have a value.
    """
    shared = {one.name for base in kind.__mro__[1:-1] for one in fields(base)}
    taken = [one for one in fields(kind) if one.name not in without]
    order = {name: number for number, name in enumerate(FILES)}
    taken.sort(key=lambda one: (order.get(one.name, len(FILES)), one.name in shared))
    parameters = []
    for one in taken:
        hint: Any = one.type
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
        values = call.bind(*args, **kwargs).arguments
        for names in getattr(kind, "one_of", ()):
            asked = [
                f"--{one.replace('_', '-')} {values[one]}"
                for one in names
                if values.get(one) not in (None, "none")  # as --sensor none, which tells none
            ]
            if len(asked) > 1:
                raise typer.BadParameter(
                    f"{' and '.join(asked)} exclude each other: leave all but one out."
                )
        with clear_exits(allow_coarse=values.get("allow_coarse", False)):
            kind(**values).run()

    command.__name__ = kind.__name__.lower()
    command.__doc__ = f"{getdoc(kind)}\n{more}"
    vars(command)["__signature__"] = call
    command.__annotations__ = {one.name: one.annotation for one in parameters}
    return command
