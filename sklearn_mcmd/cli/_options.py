"""Arguments and options that several verbs share, and parsers of options."""

from math import inf, nan
from pathlib import Path
from string import ascii_letters
from typing import Annotated

import typer

from sklearn_mcmd.io._formats import INDEX, TILED_NAMES, WITH_COLUMNS

__all__ = [
    "AllowCoarse",
    "Columns",
    "HiddenUnit",
    "InFiles",
    "MaxOutlierRate",
    "NJobs",
    "NNeighbors",
    "NNeighborsOrAuto",
    "NoClobber",
    "OutFiles",
    "Quiet",
    "RandomState",
    "Unit",
    "colors_option",
    "length_option",
    "number_or",
]

METERS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "ft": 0.3048, "in": 0.0254}


def _is_positive(number):
    return 0 < number < inf


def number_or(*words, expected="a number above 0", fits=_is_positive):
    """Parser of an option that is one of some words, or a number that `fits`.

    `expected` describes such a number in the error. NaN must not fit.
    """

    def parse(value):
        if value in words:
            return value
        try:
            number = float(value)
        except ValueError:
            number = nan
        if not fits(number):
            choices = ", ".join(words) + " or " if words else ""
            raise typer.BadParameter(f"{value} is not {choices}{expected}")
        return number

    return parse


def number_option(help, default=True, *words, metavar="NUMBER", hidden=False, **limits):
    """The option of one of some words, or a number, as of `number_or`; `default` is in words."""
    parser = number_or(*words, **limits)
    return typer.Option(
        parser=parser, metavar=metavar, help=help, show_default=default, hidden=hidden
    )


def length_option(help, default=True, *words, metavar="LENGTH", hidden=False, **limits):
    """The option of a length, as of `number_option`: in units of the file, or with its own."""
    number = number_or(*words, **limits)

    def parse(context: typer.Context, text):
        digits = (text or "").rstrip(f"{ascii_letters} ")
        if not digits or digits == text:
            return text if text is None else number(text)
        length, own, unit = number(digits), text[len(digits) :].strip(), context.params["unit"]
        if own in METERS and not unit:
            raise typer.BadParameter(f"{text}: say the unit of the file as well, such as --unit m")
        if not METERS.keys() >= {own, unit}:
            raise typer.BadParameter(
                f"{text} is no number. With a unit, it needs --unit, the unit of the file; both "
                f"are one of {', '.join(METERS)}"
            )
        return METERS[own] / METERS[unit] * length

    return typer.Option(
        parser=str, callback=parse, metavar=metavar, help=help, show_default=default, hidden=hidden
    )


def _count_or_auto(text):
    """A whole number from 4 on, or auto."""
    whole = number_or(
        "auto", expected="a whole number from 4 on", fits=lambda n: n >= 4 and n == int(n)
    )(text)
    return whole if whole == "auto" else int(whole)


def colors_option(help):
    """The option of verbs that color their results."""
    return typer.Option("--colors/--no-colors", help=help, show_default="unless IN has colors")


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
        metavar="IN",
        help=f"Point file to read, or a folder or {INDEX} index of {TILED_NAMES} files.",
    ),
]
OutFiles = Annotated[
    Path,
    typer.Argument(
        metavar="OUT",
        help="Point file to write, of any format, or a folder for several files; may be IN.",
    ),
]
NNeighbors = Annotated[
    int,
    typer.Option(
        min=4, help="Points in a neighborhood, the point itself included. More is smoother."
    ),
]
NNeighborsOrAuto = Annotated[
    int,
    typer.Option(
        parser=_count_or_auto,
        metavar="NUMBER|auto",
        help="Points in a neighborhood, the point itself included. More is smoother. auto: as many "
        "for each point as its noise asks for; then an attribute n_neighbors tells how many.",
    ),
]
MaxOutlierRate = Annotated[
    float,
    number_option(
        "Largest share of outliers that a neighborhood must survive, up to 0.99. It sets the "
        "number of trials, not the share that is removed.",
        expected="a number from 0 to 0.99",
        fits=lambda rate: 0 <= rate <= 0.99,
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
        metavar="x=NAME,y=NAME,z=NAME",
        help=f"Columns of {WITH_COLUMNS} that are the coordinates: their names, or numbers "
        "from 1 on.",
        show_default="x, y, z, easting and the like, as the header says",
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
UNIT = {"is_eager": True, "help": "Unit of the file, such as m. Lengths may then have another."}
Unit = Annotated[str, typer.Option(**UNIT)]
HiddenUnit = Annotated[str, typer.Option(hidden=True, **UNIT)]
NoClobber = Annotated[
    bool, typer.Option("--no-clobber", help="Replace no file: if an output is there, fail.")
]
Quiet = Annotated[
    bool, typer.Option("--quiet", "-q", help="Show no progress bar and no summary, only warnings.")
]
