"""Power of tests: noncentralities."""

from numbers import Real

import numpy as np
from scipy.optimize import brentq
from scipy.special import chdtri, chndtrinc, fdtri, ncfdtr, stdtrit

from sklearn_mcmd._sklearn import Interval, checked

AS_KNOWN = 1e9  # degrees of freedom of a scale from which on F is chi-squared, to nine digits
POWER = 0.8  # Baarda's; the usual one of reliability
SHARE, COUNT = [Interval(Real, 0, 1, closed="neither")], [Interval(Real, 1, None, closed="left")]


@checked(level=SHARE, power=SHARE, dof=COUNT, dof_scale=[Interval(Real, 1, None, closed="both")])
def noncentrality(
    level: float, power: float = POWER, dof: float = 1, dof_scale: float = np.inf
) -> float:
    """Noncentrality that a test detects with a given power (lambda_0, Baarda 1968).

    Parameters
    ----------
    level : float in (0, 1)
        Level of the test.
    power : float in (0, 1), default=0.8
        Probability of detection. A ValueError is raised if it is no larger than the level.
    dof : float >= 1, default=1
        Dimension of the test: 1 for one point, f for the global test.
    dof_scale : float >= 1, default=inf
        Degrees of freedom of the scale: infinite for a known one, f - 1 for tau and t.

    Returns
    -------
    float
        Of chi-squared, or of F where the scale is estimated.

    Examples
    --------
    >>> from sklearn_mcmd.adjustment import noncentrality
    >>> print(f"{noncentrality(0.001, 0.8):.2f} {noncentrality(0.001, 0.8, dof_scale=10):.2f}")
    17.07 32.10
    """
    if power <= level:
        raise ValueError(
            f"power={power!r} is not above the level {level:.3g} of the test, which it has "
            "without any bias: ask for more power, such as 0.8."
        )
    if dof_scale > AS_KNOWN:
        return float(chndtrinc(chdtri(dof, level), dof, 1 - power))
    # Two-sided t keeps levels that are too small for 1 - level.
    limit = stdtrit(dof_scale, level / 2) ** 2 if dof == 1 else fdtri(dof, dof_scale, 1 - level)
    most = 1.0
    while ncfdtr(dof, dof_scale, most, limit) > 1 - power:
        most *= 2
    return float(brentq(lambda nc: ncfdtr(dof, dof_scale, nc, limit) - 1 + power, 0, most))
