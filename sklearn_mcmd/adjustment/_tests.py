"""Test statistics of residuals, critical values, local levels (Table 1) and powers of tests."""

from numbers import Integral, Real

import numpy as np
from scipy.optimize import brentq
from scipy.special import (
    betaln,
    chdtrc,
    chdtri,
    chndtrinc,
    fdtri,
    log_ndtr,
    logsumexp,
    ncfdtr,
    ndtr,
    ndtri,
    stdtr,
    stdtrit,
)

from sklearn_mcmd._choices import Correction, Test
from sklearn_mcmd._sklearn import Interval, checked

# An observation with a smaller redundancy number is uncontrolled: its residual is only rounding.
UNCONTROLLED = 1e-10
AS_KNOWN = 1e9  # degrees of freedom of a scale from which on F is chi-squared, to nine digits
POWER = 0.8  # Baarda's; the usual one of reliability
SHARE, COUNT = [Interval(Real, 0, 1, closed="neither")], [Interval(Real, 1, None, closed="left")]


@checked(alpha=SHARE, n=[Interval(Integral, 0, None, closed="left")])
def local_level(alpha: float, n: int, correction: Correction = "sidak") -> float:
    """Level of one of n tests that gives all together the level alpha (Eq. 1).

    Parameters
    ----------
    alpha : float in (0, 1)
        Probability of rejecting any observation in clean data.
    n : int
        Number of tests.
    correction : {"sidak", "bonferroni", "none"}, default="sidak"
        ``1 - (1 - alpha)^(1/n)`` (Eq. 1), its bound ``alpha / n``, or alpha for each test.

    Examples
    --------
    >>> from sklearn_mcmd.adjustment import local_level
    >>> print(f"{local_level(0.05, 200):.7f} {local_level(0.05, 200, 'bonferroni'):.7f}")
    0.0002564 0.0002500
    """
    n = max(n, 1)
    if correction == "none":
        return alpha
    if correction == "bonferroni":
        return alpha / n
    return float(-np.expm1(np.log1p(-alpha) / n))


@checked(level=SHARE, dof=[Interval(Integral, 0, None, closed="left")])
def critical_value(test: Test, level: float, dof: int) -> float:
    """Two-sided critical value of one test (Table 1).

    Parameters
    ----------
    test : {"w", "tau", "t"}
        Baarda's normal test with known sigma0, Pope's tau, or the t of a residual against
        the scale estimated without it.
    level : float in (0, 1)
        Level of this one test.
    dof : int
        Degrees of freedom f of the adjustment.

    Returns
    -------
    float
        ``inf`` where no residual can be rejected: tau and t with f < 1, t with f = 1.

    Notes
    -----
    tau is at most ``sqrt(f)``. With f = 1 tau and its critical value are 1 for any data.

    Examples
    --------
    >>> from sklearn_mcmd.adjustment import critical_value
    >>> print(f"{critical_value('w', 0.05, 10):.4f} {critical_value('tau', 0.05, 10):.4f}")
    1.9600 1.9039
    """
    if test == "w":
        return float(-ndtri(level / 2))
    if dof < 1 or (dof == 1 and test == "t"):
        return np.inf
    if dof == 1:
        return 1.0
    t = float(-stdtrit(dof - 1, level / 2))
    return t if test == "t" else t_to_tau(t, dof)


def residual_limit(test, level, dof, sigma0, scale):
    """Largest standardized residual that passes the test.

    tau and t rank residuals alike and decide alike, so both compare with ``scale * tau``.
    """
    if test == "w":
        return sigma0 * critical_value("w", level, dof)
    # With f = 1 tau and its limit are both 1, and rounding would decide.
    return scale * critical_value("tau", level, dof) if dof > 1 else np.inf


def first_of_largest(values):
    """Position of the largest value; of equal values the first.

    Values are equal if they agree to ten digits. With one degree of freedom, or on a regular
    grid, exactly equal statistics differ by rounding, which must not decide the order of removal.
    """
    return int(np.argmax(values >= values.max() * (1 - 1e-10)))


def standardized_residuals(residuals, weights, redundancy):
    """Residual over the root of its cofactor, ``|v_i| / sqrt(q_i)`` with ``q_i = r_i / p_i``.

    It is zero where the point is uncontrolled (r_i about 0) or has no weight.
    """
    size = np.abs(residuals)
    if weights is not None:
        size *= np.sqrt(weights)
    controlled = redundancy > UNCONTROLLED
    root = np.sqrt(redundancy, out=np.ones_like(size), where=controlled)
    size /= root
    if not controlled.all():
        size[~controlled] = 0.0
    return size


def statistic(standardized, test, sigma0, scale, dof):
    """Baarda's w, Pope's tau or t from `standardized_residuals` (Table 1).

    w divides by sigma0, the known standard deviation of unit weight; tau and t by the estimated
    one, the root of the variance factor, whose degrees of freedom include the tested points.
    """
    if test == "w":
        return standardized / sigma0
    tau = standardized / scale
    if test == "tau":
        return tau
    # The scale of t leaves the tested point out, and has no degree of freedom if f < 2.
    return np.zeros_like(tau) if dof < 2 else tau_to_t(tau, dof)


def tau_to_t(tau, dof):
    """t of a residual whose tau is known, ``tau sqrt((f - 1) / (f - tau^2))`` (Table 1)."""
    # tau reaches sqrt(f) where all other residuals are 0.
    left = np.maximum(dof - tau**2, dof * np.finfo(float).eps)
    return tau * np.sqrt((dof - 1) / left)


def pvalue(statistic, test, dof):
    """Two-sided probability of a larger statistic of one good point, the inverse of
    `critical_value`; nan where nothing can be rejected."""
    if test == "w":
        return 2 * ndtr(-statistic)
    t = statistic if test == "t" else tau_to_t(statistic, dof)
    return np.where(dof > 1, 2 * stdtr(np.maximum(dof - 1, 1), -t), np.nan)


def t_to_tau(t, dof):
    """tau of a residual whose t is known, ``sqrt(f t^2 / (f - 1 + t^2))`` (Table 1)."""
    with np.errstate(over="ignore", divide="ignore"):
        return np.sqrt(dof / ((dof - 1) / np.square(t) + 1)) if dof > 1 else 1.0


def normal_equivalent(t, dof):
    """The w that is as rare as a t (D. L. Wallace, "Bounds on normal approximations to Student's
    and the chi-square distributions", 1959); within 0.03 from 5 degrees of freedom
    and up to t = 8."""
    return (8 * dof + 1) / (8 * dof + 3) * np.sqrt(dof * np.log1p(np.square(t) / dof))


def chance_outside(t, n_outside, n, dof):
    """Bound of the chance that any `n_outside` of n good points all lie beyond t.

    Where few points are inside, their plane and deviation fit them too well, because they were
    chosen for it. There are ``C(n, i)`` ways to choose i points outside, and all i are measured by
    one deviation s: given points lie outside with probability ``E[(2 Phi(-t s))^i]``, with
    ``f s^2`` of chi-squared with f degrees of freedom (in units of the true variance).
    """
    log_s = np.linspace(-25, 4, 1000) / np.sqrt(max(dof, 1))
    log_density = dof * (log_s - np.exp(2 * log_s) / 2)
    beyond = n_outside * (np.log(2) + log_ndtr(-t * np.exp(log_s)))
    ways = -betaln(n - n_outside + 1, n_outside + 1) - np.log1p(n)
    # A chance, and of many points its bound is far above 1.
    return np.exp(min(ways + logsumexp(log_density + beyond) - logsumexp(log_density), 0.0))


def global_test_pvalue(sum_of_squares, sigma0, dof):
    """Probability of a larger v'Pv / sigma0^2 in clean data; nan without redundancy.

    If it is near 0, sigma0 is too small or outliers are left. If it is near 1, sigma0 is too
    large.
    """
    if dof < 1:
        return np.nan
    with np.errstate(over="ignore"):
        ratio = np.square(np.sqrt(sum_of_squares) / sigma0)  # the square of sigma0 may underflow
    return float(chdtrc(dof, ratio))


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
