"""Is a plane flat for its noise? For what is usual around it, and for its own extent."""

from typing import NamedTuple

import numpy as np

from sklearn_mcmd.planes._around import quantile_around

__all__ = ["are_flat", "most_noise_around"]


class NoiseLimits(NamedTuple):
    """When a plane is noisier than others."""

    n_errors: float = 3.0  # standard errors by which it may be noisier than is usual around


def most_noise_around(noise, around, sizes, quiet, bend=0.0):
    """The largest standard deviation of planes (m,) that are as flat as those around them.

    `noise` (n,) are standard deviations from planes, or from smooth surfaces, and `around` has rows
    of it. `sizes`, a number or (m,), are the members that tell a standard deviation. `bend`, a
    number or (m,), is what curvature adds to noise.

    `quiet` is the share of the neighbors whose noise is usual at most. Next to an edge less than
    half of them have planes of their own face; among many outliers fewer have planes without any.
    """
    usual = np.hypot(quantile_around(noise, around, quiet), bend)
    return (1 + NoiseLimits().n_errors / np.sqrt(2 * sizes)) * usual


def are_flat(planes, most):
    """Whether the noise of planes is at most this share of the radius of their neighborhoods.

    It tells planes of surfaces from those through foliage, which are as noisy as those around. A
    filled ball has 0.45.
    """
    return (planes.scale > 0) & (planes.scale <= most * planes.radius)
