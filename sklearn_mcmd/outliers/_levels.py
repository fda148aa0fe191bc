"""Levels of strictness: what is an outlier beside points that stand alone."""

from typing import NamedTuple


class Level(NamedTuple):
    """What counts beside isolation."""

    groups: bool  # whether a small group that stands off is an outlier
    off_surfaces: bool  # whether a point on no surface is, whatever company it has


# By the words of `Strictness`. Each level flags all that those before it flag.
LEVELS = {
    "isolated": Level(groups=False, off_surfaces=False),
    "groups": Level(groups=True, off_surfaces=False),
    "surfaces": Level(groups=True, off_surfaces=True),
}
