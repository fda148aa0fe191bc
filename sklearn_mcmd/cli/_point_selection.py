"""Which points of a cloud a verb judges: options, and the points."""

from typing import NamedTuple

import numpy as np
import typer

from sklearn_mcmd.cli._options import length, option
from sklearn_mcmd.io._classes import class_numbers
from sklearn_mcmd.io._files import one_clear_line
from sklearn_mcmd.io._point_cloud import PointFileError

__all__ = ["Judged", "classes_option", "height_option", "judged_points"]


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


def classes_option(help):
    return option(None, help, parser=_classes, metavar="CLASSES")


def height_option(help):
    return length(None, help, metavar="HEIGHT", hidden=True, signed=True)


class Judged(NamedTuple):
    """Points of a cloud (n,)."""

    used: np.ndarray  # bool: they are judged, or others are judged by them
    judged: np.ndarray  # bool: they may be outliers
    ground: np.ndarray | None  # bool, where heights are asked for


def judged_points(source, cloud, choice, above=None, below=None, low_groups=False):
    """The `Judged` points of a cloud; errors name its source."""
    from sklearn_mcmd.io._ground import NONE_JUDGED, HeightLimits, ground_of, heights_over_ground

    with one_clear_line(source, "read"):
        used, ground = choice.of(cloud), None
        if used is None:
            used = np.ones(len(cloud), bool)
        judged = used
        if low_groups or above is not None or below is not None:
            ground = ground_of(cloud)
        if above is not None or below is not None:
            heights = heights_over_ground(cloud.xyz, ground)
            judged = used & HeightLimits(above, below).judged(heights)
        if not judged.any():
            raise PointFileError(NONE_JUDGED)
    return Judged(used, judged, ground)
