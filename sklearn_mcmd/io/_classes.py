"""Classes of LAS: which points of a cloud are used, and which noise is low."""

from operator import index
from typing import NamedTuple

import numpy as np

from sklearn_mcmd.io._point_cloud import PointFileError

# ASPRS LAS 1.4. Point formats 0 to 5 define no high noise: they have 18 reserved.
GROUND, LOW_NOISE, HIGH_NOISE = 2, 7, 18
LARGEST = 255  # class of LAS 1.4


class Choice(NamedTuple):
    """Which points of a file are used, by what the file says of each.

    Points that are marked withheld are never used, nor those of `ignored` classes. If there are any
    `only`, all other classes are left out.
    """

    ignored: tuple[int, ...] = ()
    only: tuple[int, ...] = ()

    def of(self, cloud):
        """A mask of the points that are used; None if all are."""
        used = np.ones(len(cloud), bool)
        if "withheld" in cloud.attributes:
            used &= np.asarray(cloud.attributes["withheld"]) == 0
        if self.ignored or self.only:
            if "classification" not in cloud.attributes:
                raise PointFileError("has no classes: points need an attribute 'classification'")
            classes = np.asarray(cloud.attributes["classification"])
            used &= ~np.isin(classes, self.ignored)
            if self.only:
                used &= np.isin(classes, self.only)
        return None if used.all() else used


def class_numbers(classes):
    """Classes in order, each once; raise a ValueError if they are no list of classes."""
    try:
        numbers = {-1 if isinstance(number, bool) else index(number) for number in classes}
    except TypeError:
        numbers = {-1}
    if not all(0 <= number <= LARGEST for number in numbers):
        raise ValueError(f"is no list of classes, whole numbers from 0 to {LARGEST}")
    return tuple(sorted(numbers))


def noise_classes(cloud, flagged, used, lowest):
    """The class of each outlier, a mask `flagged`: low or high noise; 0 for all other points.

    Low is what lies lower than all ground around it, if there is ground, else than all that was
    `used`: the points that are added to `lowest`, `LowestPoints`.
    """
    compared = ground_in(cloud)
    if compared is None or np.count_nonzero(compared & ~flagged) < lowest.n_usual:
        compared = used
    lowest.add(cloud.xyz[compared & ~flagged])
    classes = np.zeros(len(cloud), np.uint8)
    classes[flagged] = classes_of_noise(lowest, cloud.xyz[flagged])
    return classes


def ground_in(cloud):
    """A mask of the points of the ground, without those that are withheld; None without classes."""
    if "classification" not in cloud.attributes:
        return None
    ground = np.asarray(cloud.attributes["classification"]) == GROUND
    if "withheld" in cloud.attributes:
        ground &= np.asarray(cloud.attributes["withheld"]) == 0
    return ground


def classes_of_noise(lowest, xyz):
    """Low or high noise, for outliers (n, 3)."""
    return np.where(lowest.are_above(xyz), LOW_NOISE, HIGH_NOISE).astype(np.uint8)
