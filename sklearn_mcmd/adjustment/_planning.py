"""What a measurement will find, before it is made: Monte Carlo of data snooping."""

from functools import partial
from numbers import Integral, Real
from typing import NamedTuple

import numpy as np
from sklearn.utils import check_random_state

from sklearn_mcmd._errors import ParameterError
from sklearn_mcmd._sklearn import Interval, check_parameters, checked
from sklearn_mcmd.adjustment._baarda import BaardaPlaneDetector
from sklearn_mcmd.adjustment._power import POWER, SHARE, noncentrality
from sklearn_mcmd.adjustment._start import MAX_ROUNDS, StartLimits, half_of, n_trials_of_start
from sklearn_mcmd.adjustment._tests import UNCONTROLLED, critical_value, local_level
from sklearn_mcmd.runtime._chunks import slices

BATCH = 20_000  # points of the planes that are simulated together, in the processor's cache
MOST_AT_ONCE = 50  # share of the points that go in one round, inverted
COARSE = 10  # share of the repetitions that bracket the smallest bias, inverted
STEP = 0.1  # standard deviations, half width of the bracket in which it is interpolated
LARGEST = 1000.0  # standard deviations, the largest bias that is tried


class PlanePlan(NamedTuple):
    """What data snooping will find on a plane, as of `plan_plane`.

    Rates and `bias` are pairs of a value and its standard error. The rates of repetitions that are
    `correct`, `missed`, `wrongly_excluded` and `over_excluded` sum to 1.

    Parameters
    ----------
    n_outliers : int
    minimal_bias : float
        Minimal detectable bias of one outlier, by formula, at the mean redundancy.
    bias : tuple of float
        That outliers need to be found with the power, ``inf`` if none up to 1000 sigma0 is found so
        often; or the given one.
    found : tuple of float
        Rate of outliers that are found.
    correct, missed : tuple of float
        All outliers and no other point are excluded; no good point, and not all outliers.
    wrongly_excluded, over_excluded : tuple of float
        Good points, and not all outliers (type III); all outliers, and good points.
    false_alarm : tuple of float
        Points are excluded though there is no outlier.
    """

    n_outliers: int
    minimal_bias: float
    bias: tuple[float, float]
    found: tuple[float, float]
    correct: tuple[float, float]
    missed: tuple[float, float]
    wrongly_excluded: tuple[float, float]
    over_excluded: tuple[float, float]
    false_alarm: tuple[float, float]


@checked(
    n_points=[Interval(Integral, 5, None, closed="left")],
    detector=[BaardaPlaneDetector, None],
    outlier_rate=[Interval(Real, 0, 0.5, closed="left")],
    bias=[Interval(Real, 0, None, closed="neither"), None],
    power=SHARE,
    n_repetitions=[Interval(Integral, 100, None, closed="left")],
)
def plan_plane(
    n_points: int = 100,
    detector: BaardaPlaneDetector | None = None,
    *,
    outlier_rate: float = 0.0,
    bias: float | None = None,
    power: float = POWER,
    n_repetitions: int = 10_000,
    random_state: int | np.random.RandomState | None = None,
) -> PlanePlan:
    """Which errors will data snooping find on a plane in space, and what will it confuse?

    It simulates points that are uniform over a rectangle of any sides, gives some of them a bias to
    one side, and snoops as the detector does with known sigma0. A formula for one test cannot say
    how often a wrong point goes. The outcomes are those of Rofatto et al. (Survey Review, 2020).

    Parameters
    ----------
    n_points : int >= 5, default=100
    detector : BaardaPlaneDetector, default=None
        Not fitted; its `sigma0`, `alpha`, `correction` and `robust_start` are planned with. None
        means ``BaardaPlaneDetector()``, whose `sigma0` is 1. If its `sigma0` is estimated or its
        test is not by w, a ValueError is raised.
    outlier_rate : float in [0, 0.5), default=0.0
        Share of outliers; there is at least one.
    bias : float > 0, default=None
        Size of the outliers, in the unit of `sigma0`. None looks for the smallest that is found
        with the power.
    power : float in (0, 1), default=0.8
        Wanted share of found outliers, above the level of one point.
    n_repetitions : int >= 100, default=10_000
        Simulated planes of each size of bias. Time grows with ``n_points * n_repetitions``: 10^6
        points take 0.1 s, with `robust_start` 1 s. Larger planes need fewer repetitions.
    random_state : int, RandomState instance or None, default=None
        Seed. All sizes of bias get the same points.

    Examples
    --------
    >>> from sklearn_mcmd.adjustment import BaardaPlaneDetector, plan_plane
    >>> detector = BaardaPlaneDetector(sigma0=0.004)
    >>> plan = plan_plane(50, detector, n_repetitions=1000, random_state=0)
    >>> print(f"{plan.bias[0]:.3f} m; {plan.missed[0]:.2f} missed")
    0.017 m; 0.20 missed
    """
    detector = BaardaPlaneDetector() if detector is None else detector
    check_parameters(detector)
    if detector.sigma0 == "auto" or detector.test != "w":
        raise ParameterError("A plan is of tests with a known scale: give $sigma0, and $test='w'.")
    alpha, correction, sigma0 = detector.alpha, detector.correction, float(detector.sigma0)
    root = np.sqrt(noncentrality(local_level(alpha, n_points, correction), power))
    levels = [local_level(alpha, n, correction) for n in range(n_points + 2)]
    limits = np.array([critical_value("w", level, 1) for level in levels])
    seed = check_random_state(random_state).randint(2**31)

    def simulate(bias, k, repeat):
        return _outcomes(n_points, k, bias, limits, detector.robust_start, seed, repeat)

    k = max(1, round(outlier_rate * n_points))
    if bias is None:
        size, error = _smallest_bias(simulate, k, power, root, n_repetitions)
    else:
        size, error = bias / sigma0, 0.0
    found, correct, missed, wrong, over = simulate(min(size, LARGEST), k, n_repetitions)
    return PlanePlan(
        n_outliers=k,
        # Redundancy numbers of n points sum to n - 3: their mean is 1 - 3 / n.
        minimal_bias=float(sigma0 * root / np.sqrt(1 - 3 / n_points)),
        bias=(float(sigma0 * size), float(sigma0 * error)),
        found=found,
        correct=correct,
        missed=missed,
        wrongly_excluded=wrong,
        over_excluded=over,
        false_alarm=simulate(0.0, 0, n_repetitions)[-1],
    )


def _outcomes(n, k, bias, limits, robust_start, seed, n_repetitions):
    """Rates of found outliers, and of the four outcomes, of planes with noise 1."""
    rng, counts = np.random.RandomState(seed), []
    for rows in slices(n_repetitions, max(BATCH // n, 1)):
        design = np.ones((rows.stop - rows.start, n, 3))
        design[..., :2] = rng.uniform(-1, 1, (*design.shape[:2], 2))
        heights = rng.normal(size=design.shape[:2])
        heights[:, :k] += bias
        member = np.ones(heights.shape, dtype=bool)
        if robust_start:
            corners = rng.randint(n, size=(len(heights), n_trials_of_start(3), 3))
            member = _started(design, heights, corners, limits[n])
        rejected = _snooped(design, heights, member, limits)
        counts.append([rejected[:, :k].sum(axis=1), rejected[:, k:].sum(axis=1)])
    n_found, n_false = np.concatenate(counts, axis=1)
    full, clean = n_found == k, n_false == 0
    rates = n_found / max(k, 1), full & clean, ~full & clean, ~full & ~clean, full & ~clean
    return [(float(np.mean(x)), float(np.std(x) / np.sqrt(len(x)))) for x in rates]


def _evaluate(design, heights, member):
    """Sizes (m, n) of the residuals of m planes of their members, and cofactors of all points."""
    weighted = design * member[..., None]
    inverse = np.linalg.inv(np.swapaxes(design, 1, 2) @ weighted)
    slopes = inverse @ (np.swapaxes(weighted, 1, 2) @ heights[..., None])
    residuals = heights - (design @ slopes)[..., 0]
    return np.abs(residuals), ((design @ inverse) * design).sum(axis=-1)


def _snooped(design, heights, member, limits):
    """Verdicts of `BaardaPlaneDetector` with known sigma0 on m planes (m, n).

    `limits` has the critical value of w by the number of retained points. In a round at most a
    50th of the points go, the worst; of fewer than 100 it is one.
    """
    n, left = heights.shape[1], np.arange(len(heights))
    last = n - max(n // MOST_AT_ONCE, 1)
    while len(left):
        sizes, cofactors = _evaluate(design[left], heights[left], member[left])
        redundancy = np.where(member[left], 1 - cofactors, 0.0)
        controlled = redundancy > UNCONTROLLED
        w = np.where(controlled, sizes / np.sqrt(np.where(controlled, redundancy, 1.0)), 0.0)
        size = member[left].sum(axis=1)
        worst = (w > limits[size, None]) & (w >= np.partition(w, last)[:, last, None])
        worst[size <= 3 + n - last] = False  # a plane and one that tests it stay
        member[left] &= ~worst
        left = left[worst.any(axis=1)]
    sizes, cofactors = _evaluate(design, heights, member)
    return sizes > limits[member.sum(axis=1) + 1, None] * np.sqrt(1 + cofactors)


def _started(design, heights, corners, limit):
    """What `robust_start` leaves of m planes to begin the snooping with: members (m, n).

    Its minimal subsets are `corners` (m, n_trials, 3).
    """
    (m, n), most = heights.shape, half_of(heights.shape[1], 3) - 1
    best, member = np.full(m, np.inf), np.ones((m, n), dtype=bool)
    for rows in np.swapaxes(corners, 0, 1):
        at = np.arange(m)[:, None], rows
        solved = design[at]
        solved[np.linalg.det(solved) == 0] = np.eye(3)  # a plane through three heights is worse
        slopes = np.linalg.solve(solved, heights[at][..., None])
        sizes = np.abs(heights - (design @ slopes)[..., 0])
        nearest = np.partition(sizes, most)[:, : most + 1]
        total = np.einsum("ij,ij->i", nearest, nearest)
        better = total < best
        best[better] = total[better]
        member[better] = sizes[better] <= nearest[better, most, None]

    def nearest_half(member):
        sizes, _ = _evaluate(design, heights, member)
        return sizes <= np.partition(sizes, most)[:, most, None]

    def within(near, member):
        sizes, cofactors = _evaluate(design, heights, member)
        inside = sizes <= near * np.sqrt(1 + cofactors)
        return np.where(inside.sum(axis=1, keepdims=True) > 3, inside, member)

    member = _settled(nearest_half, member)  # concentration, then reweighting
    return within(limit, _settled(partial(within, StartLimits().cut), member))


def _settled(change, member):
    """Members after rounds of changes, until none is left."""
    for _ in range(MAX_ROUNDS):
        before, member = member, change(member)
        if np.array_equal(before, member):
            break
    return member


def _smallest_bias(simulate, k, power, start, n_repetitions):
    """Bias in standard deviations that is found with the power, and its standard error.

    Few repetitions bracket it by bisection. All give two rates, between which it is interpolated.
    """
    few, low, high = max(n_repetitions // COARSE, 100), 0.0, start
    while simulate(high, k, few)[0][0] < power:
        low, high = high, 2 * high
        if high > LARGEST:
            return np.inf, np.inf
    while high - low > STEP:
        middle = (low + high) / 2
        low, high = (middle, high) if simulate(middle, k, few)[0][0] < power else (low, middle)
    first, (second, error) = (simulate(low + x, k, n_repetitions)[0] for x in (-STEP, STEP))
    slope = (second - first[0]) / (2 * STEP)
    if slope <= 0:
        return np.inf, np.inf
    return low - STEP + (power - first[0]) / slope, error / slope
