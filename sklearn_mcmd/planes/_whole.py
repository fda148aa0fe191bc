"""What a fit to a part of a cloud is told of the whole, where parts must not differ in it."""

from contextlib import contextmanager
from contextvars import ContextVar
from typing import NamedTuple

import numpy as np


class Whole(NamedTuple):
    """What is found once of a whole cloud, and holds for each part of it."""

    n_points: int
    dtype: str = "float64"  # of the coordinates: float32 if it rounded them
    step: float = 0.0  # to which they were rounded, 0 where there is none
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
