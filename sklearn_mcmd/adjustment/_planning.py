"""What a measurement will find, before it is made: Monte Carlo of data snooping."""

from numbers import Integral, Real
from typing import NamedTuple

import numpy as np
from sklearn.utils import check_random_state

from sklearn_mcmd._choices import Correction, choices_of
from sklearn_mcmd._sklearn import Interval, StrOptions, validate_params
from sklearn_mcmd.adjustment._power import POWER, SHARE, noncentrality
from sklearn_mcmd.adjustment._start import MAX_ROUNDS, StartLimits, half_of, n_trials_of_start
from sklearn_mcmd.adjustment._tests import UNCONTROLLED, critical_value, local_level
from sklearn_mcmd.runtime._compiling import compiled_function

BATCH = 1_000_000  # points of the planes that are simulated together
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
    offset_error, normal_errors : float and tuple of float
        Expected standard errors a priori: of the plane at its center, and of the normal in degrees,
        by tilts along both sides.
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
    offset_error: float
    normal_errors: tuple[float, float]


@validate_params(
    {
        "n_points": [Interval(Integral, 5, None, closed="left")],
        "n_repetitions": [Interval(Integral, 100, None, closed="left")],
        "sigma0": [Interval(Real, 0, None, closed="neither")],
        "bias": [Interval(Real, 0, None, closed="neither"), None],
        "outlier_rate": [Interval(Real, 0, 0.5, closed="left")],
        "correction": [StrOptions(choices_of(Correction))],
        "alpha": SHARE,
        "power": SHARE,
        "robust_start": ["boolean"],
        "random_state": ["random_state"],
    },
    prefer_skip_nested_validation=True,
)
def plan_plane(
    n_points: int = 100,
    *,
    sigma0: float = 1.0,
    extent: tuple[float, float] = (1.0, 1.0),
    alpha: float = 0.05,
    correction: Correction = "sidak",
    outlier_rate: float = 0.0,
    bias: float | None = None,
    power: float = POWER,
    robust_start: bool = False,
    n_repetitions: int = 10_000,
    random_state: int | np.random.RandomState | None = None,
) -> PlanePlan:
    """Which errors will data snooping find on a plane in space, and what will it confuse?

    It simulates points that are uniform over a rectangle, gives some of them a bias to one side,
    and snoops as `BaardaPlaneDetector` does with known sigma0. A formula for one test cannot say
    how often a wrong point goes. The outcomes are those of Rofatto et al. (Survey Review, 2020).

    Parameters
    ----------
    n_points : int >= 5, default=100
    sigma0 : float > 0, default=1.0
        Standard deviation of a point across the plane.
    extent : tuple of two floats > 0, default=(1.0, 1.0)
        Sides of the rectangle, in the unit of `sigma0`. They matter for the normal only.
    alpha, correction, robust_start
        As of `BaardaPlaneDetector`.
    outlier_rate : float in [0, 0.5), default=0.0
        Share of outliers; there is at least one.
    bias : float > 0, default=None
        Size of the outliers. None looks for the smallest that is found with the power.
    power : float in (0, 1), default=0.8
        Wanted share of found outliers, above the level of one point.
    n_repetitions : int >= 100, default=10_000
        Simulated planes of each size of bias. Time grows with ``n_points * n_repetitions``: 10^7
        points take 2 s, with `robust_start` 20 s. Larger planes need fewer repetitions.
    random_state : int, RandomState instance or None, default=None
        Seed. All sizes of bias get the same points.

    Examples
    --------
    >>> from sklearn_mcmd.adjustment import plan_plane
    >>> plan = plan_plane(50, sigma0=0.004, n_repetitions=1000, random_state=0)
    >>> print(f"{plan.bias[0]:.3f} m; {plan.missed[0]:.2f} missed")
    0.017 m; 0.19 missed
    """
    sides = np.asarray(extent, dtype=float)
    if sides.shape != (2,) or not np.all((sides > 0) & (sides < np.inf)):
        raise ValueError(f"extent={extent!r} is no rectangle: give two sides above 0.")
    root = np.sqrt(noncentrality(local_level(alpha, n_points, correction), power))
    levels = [local_level(alpha, n, correction) for n in range(n_points + 2)]
    limits = np.array([critical_value("w", level, 1) for level in levels])
    seed = check_random_state(random_state).randint(2**31)

    def simulate(bias, k, repeat):
        return _outcomes(n_points, k, bias, limits, robust_start, seed, repeat)

    k = max(1, round(outlier_rate * n_points))
    if bias is None:
        size, error = _smallest_bias(simulate, k, power, root, n_repetitions)
    else:
        size, error = bias / sigma0, 0.0
    found, correct, missed, wrong, over = simulate(min(size, LARGEST), k, n_repetitions)
    normal_errors = np.degrees(sigma0 / (sides * np.sqrt(n_points / 12)))
    return PlanePlan(
        n_outliers=k,
        minimal_bias=float(sigma0 * root / np.sqrt(1 - 3 / n_points)),
        bias=(float(sigma0 * size), float(sigma0 * error)),
        found=found,
        correct=correct,
        missed=missed,
        wrongly_excluded=wrong,
        over_excluded=over,
        false_alarm=simulate(0.0, 0, n_repetitions)[-1],
        offset_error=float(sigma0 / np.sqrt(n_points)),
        normal_errors=tuple(normal_errors.tolist()),
    )


def _outcomes(n, k, bias, limits, robust_start, seed, n_repetitions):
    """Rates of found outliers, and of the four outcomes, of planes with noise 1."""
    rng = np.random.RandomState(seed)
    needed = n_trials_of_start(3)
    counts = []
    while n_repetitions > 0:
        m = min(n_repetitions, max(BATCH // n, 1))
        n_repetitions -= m
        points = np.empty((m, n, 3))
        points[..., :2], points[..., 2] = rng.uniform(-1, 1, (m, n, 2)), rng.normal(size=(m, n))
        points[:, :k, 2] += bias
        corners = rng.randint(n, size=(m, needed if robust_start else 0, 3), dtype=np.int64)
        found = np.empty((m, n), dtype=np.bool_)
        snoop_planes = compiled_function("adjustment._planning_numba", "snoop_planes")
        start = half_of(n, 3), StartLimits().cut, MAX_ROUNDS
        snoop_planes(points, corners, start, limits, UNCONTROLLED, found)
        counts.append([found[:, :k].sum(axis=1), found[:, k:].sum(axis=1)])
    n_found, n_false = np.concatenate(counts, axis=1)
    full, clean = n_found == k, n_false == 0
    rates = n_found / max(k, 1), full & clean, ~full & clean, ~full & ~clean, full & ~clean
    return [(float(np.mean(x)), float(np.std(x) / np.sqrt(len(x)))) for x in rates]


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
