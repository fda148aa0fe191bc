"""Which points of a cloud a verb judges: options, and the points."""

from typing import Annotated, NamedTuple

import numpy as np
import typer

from sklearn_mcmd.cli._options import length_option
from sklearn_mcmd.io._classes import class_numbers
from sklearn_mcmd.io._files import one_clear_line
from sklearn_mcmd.io._point_cloud import PointFileError

__all__ = ["Above", "Below", "IgnoreClass", "Judged", "LowGroups", "OnlyClass", "judged_points"]


def _classes(text):
    """Classes, separated by commas."""
    try:
        numbers = [int(part) for part in text.split(",")]
    except ValueError:
        numbers = [None]
    try:
        return class_numbers(numbers)
    except ValueError as err:
        raise typer.BadParameter(f"{text} {err}, such as 6,9") from err


def _height_option(help):
    return length_option(
        help, metavar="HEIGHT", hidden=True, expected="a height, such as 2.0", fits=np.isfinite
    )


IgnoreClass = Annotated[
    tuple | None,
    typer.Option(
        parser=_classes,
        metavar="CLASSES",
        help="Points of these classes, such as 6,9, are neither judged nor used to judge others. "
        "They are kept as they are. So are points that are marked withheld, always.",
        show_default="none",
    ),
]
OnlyClass = Annotated[
    tuple | None,
    typer.Option(
        parser=_classes,
        metavar="CLASSES",
        help="Only points of these classes are judged and used. All others are kept as they are.",
        show_default="all",
    ),
]
Above = Annotated[
    float | None,
    _height_option(
        "Judge only points that are higher than this over the ground (class 2): over the mean "
        "of the three ground points that are nearest in plan. All are used."
    ),
]
Below = Annotated[
    float | None,
    _height_option(
        "Judge only points that are lower than this over the ground; -0.5 is half a unit under it."
    ),
]
LowGroups = Annotated[
    bool,
    typer.Option(
        "--low-groups",
        help="A group of any number of points is an outlier if it lies below the ground (class 2) "
        "by more sizes of its own than the cutoff. Otherwise large groups are kept.",
        hidden=True,
    ),
]


class Judged(NamedTuple):
    """Points of a cloud (n,).

    used : ndarray of bool
        They are judged, or others are judged by them.
    judged : ndarray of bool
        They may be outliers.
    ground : ndarray of bool or None
        Where heights are asked for.
    """

    used: np.ndarray
    judged: np.ndarray
    ground: np.ndarray | None


def judged_points(source, cloud, choice, above=None, below=None, low_groups=False):
    """The `Judged` points of a cloud; errors name its source."""
    from sklearn_mcmd.io._ground import NONE_JUDGED, HeightRange, ground_of, heights_over_ground

    with one_clear_line(source, "read"):
        used, ground = choice.of(cloud), None
        if used is None:
            used = np.ones(len(cloud), bool)
        judged = used
        if low_groups or above is not None or below is not None:
            ground = ground_of(cloud)
        if above is not None or below is not None:
            heights = heights_over_ground(cloud.xyz, ground)
            judged = used & HeightRange(above, below).judged(heights)
        if not judged.any():
            raise PointFileError(NONE_JUDGED)
    return Judged(used, judged, ground)
