"""The step to which a file's coordinates were rounded, found from the coordinates."""

import numpy as np

__all__ = ["coordinate_step"]

# A gap counts as so many steps if it is within this much of a whole number of them.
TOLERANCE = 0.02
# Longer gaps say nothing: the error of the step, times so many, is no longer small.
LONGEST = 100
FEWEST_GAPS = 3


def coordinate_step(X):
    """Step of the lattice that all coordinates lie on, 0 where there is none.

    Files hold coordinates rounded to, say, a centimeter. Where that is coarser than the
    noise, most of a flat neighborhood lies on exactly one level, and a robust scale is zero:
    every other level would be an outlier.

    Parameters
    ----------
    X : ndarray of shape (n, d)

    Returns
    -------
    float
        The smallest step among the axes. Zero unless each axis has at least four values on
        a lattice: a raster of heights is no rounded cloud.
    """
    steps = []
    for axis in X.T:
        values = np.sort(axis)
        gaps = np.diff(values)
        rounding = 8 * np.finfo(X.dtype).eps * max(abs(values[0]), abs(values[-1]))
        gaps = gaps[gaps > rounding]
        if gaps.size < FEWEST_GAPS:
            return 0.0
        step = gaps.min()
        multiples = gaps[gaps <= LONGEST * step] / step
        off = np.abs(multiples - np.rint(multiples)) > TOLERANCE + rounding / step
        # Of continuous coordinates next to no gap is as short as a hundred times the least.
        if multiples.size < FEWEST_GAPS or multiples.size < 0.5 * gaps.size or off.any():
            return 0.0
        steps.append(float(np.median(multiples[np.rint(multiples) == 1])) * step)
    return min(steps)
