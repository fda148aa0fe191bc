"""Arguments and options that several verbs share."""

from pathlib import Path
from typing import Annotated

import typer

__all__ = [
    "Cutoff",
    "InFile",
    "NJobs",
    "NNeighbors",
    "NoiseScale",
    "OutFile",
    "OutlierRate",
    "Quiet",
    "RandomState",
    "positive",
]


def positive(value):
    """Callback of options that must be numbers above zero."""
    if value is not None and not 0 < value < float("inf"):
        raise typer.BadParameter(f"{value:g} is not a number above 0")
    return value


def _word_or_number(value):
    """Parser of --noise-scale."""
    if value in NOISE_SCALES:
        return value
    try:
        return positive(float(value))
    except ValueError:
        raise typer.BadParameter(
            f"{value!r} is none of {', '.join(NOISE_SCALES)} and no number"
        ) from None


def _not_zero(value):
    if value == 0:
        raise typer.BadParameter("0 threads cannot work; -1 is one a processor")
    return value


NOISE_SCALES = ("local", "own", "pooled")

InFile = Annotated[Path, typer.Argument(metavar="IN", help="Point file to read.")]
OutFile = Annotated[
    Path, typer.Argument(metavar="OUT", help="Point file to write, of any format; may be IN.")
]
NNeighbors = Annotated[
    int,
    typer.Option(
        min=4, help="Points in a neighborhood, the point itself included. More is smoother."
    ),
]
Cutoff = Annotated[
    float | None,
    typer.Option(
        callback=positive,
        help="Distance beyond which a point is an outlier, in robust standard deviations.",
        show_default="2.5, for mcmd_md 3.06",
    ),
]
OutlierRate = Annotated[
    float,
    typer.Option(
        min=0.0,
        max=0.99,
        help="Largest share of outliers in a neighborhood to be prepared for; sets the number of "
        "trials, not the share that is removed.",
    ),
]
NoiseScale = Annotated[
    str,
    typer.Option(
        parser=_word_or_number,
        metavar="local|own|pooled|NUMBER",
        help="What distances to planes are measured by. local: the noise around, for any cloud. "
        "own: that of the point's own neighborhood, as in the paper. pooled: one noise for all, "
        "found from the cloud; NUMBER: given, in units of the file. These two find most, but take "
        "curvature, foliage and what is rougher than the noise for outliers.",
    ),
]
RandomState = Annotated[
    int, typer.Option(min=0, max=2**32 - 1, help="Seed; the same seed gives the same file.")
]
NJobs = Annotated[
    int, typer.Option(callback=_not_zero, help="Threads; -1 is one a processor, 0 means nothing.")
]
Quiet = Annotated[
    bool, typer.Option("--quiet", "-q", help="No progress bar and no summary; warnings stay.")
]
