"""What a fit to a part of a cloud is told of the whole, where parts must not differ in it."""

from contextlib import contextmanager
from contextvars import ContextVar
from typing import NamedTuple

import numpy as np


class Steps(NamedTuple):
    """To what coordinates were rounded before they had their dtype."""

    lattice: float = 0.0  # the step of all axes, 0 where there is none
    # Depths of a camera that measures disparity lie on levels, whose steps grow with the square of
    # the distance from where it sees: the step at a distance of 1, 0 where there are none,
    growth: float = 0.0
    origin: float = 0.0  # that place on the axis of the depth,
    axis: int = 0  # and this axis

    def at(self, points):
        """Steps of the depth (n,) at points (n, d)."""
        return self.growth * np.square(points[:, self.axis] - self.origin)


class Whole(NamedTuple):
    """What is found once of a whole cloud, and holds for each part of it."""

    n_points: int
    dtype: str = "float64"  # of the coordinates: float32 if it rounded them
    steps: Steps = Steps()  # to which they were rounded before
    seen: bool = False  # whether the sensor is known to have been at the origin
    telling: float = 0.0  # how far intensity tells, as of `Darkness`
    # int (n,), how many hops of neighbors each point of the part is from those whose results are
    # asked; None if all are.
    away: np.ndarray | None = None


_whole: ContextVar[Whole | None] = ContextVar("whole", default=None)


def whole_cloud():
    """The `Whole` of whose points those of this fit are a part; None if they are all."""
    return _whole.get()


@contextmanager
def part_of(whole):
    """Fit in this block to parts of a cloud, of which this is known."""
    token = _whole.set(whole)
    try:
        yield
    finally:
        _whole.reset(token)
