"""A robust first plane for data snooping. It combines the methods of both papers."""

from typing import NamedTuple

import numpy as np
from sklearn.utils import check_random_state

from sklearn_mcmd.adjustment._least_squares import adjust_plane, weighed
from sklearn_mcmd.adjustment._robust import robust_scale
from sklearn_mcmd.adjustment._tests import UNCONTROLLED, chance_outside
from sklearn_mcmd.planes._consistent_set import (
    draw_trials,
    maximum_consistent_sets,
    n_trials_needed,
)
from sklearn_mcmd.planes._principal_planes import fit_planes


class StartLimits(NamedTuple):
    """How the plane of the most coplanar half is found, and which points belong to it."""

    cut: float = 2.5  # standard deviations within which points do, as in least trimmed squares
    cut_deviation: float = 0.9546  # of normal residuals cut there, in standard deviations
    support_fraction: float = 0.5  # of the points that the best plane fits
    success_probability: float = 0.9999  # of one trial without outliers
    max_points: int = 20_000  # that suffice to choose the best of the trial planes
    max_trials: int = 2_000  # in spaces where more would be needed


class JoiningLimits(NamedTuple):
    """Which points that a robust start left out come back."""

    near: float = 3.0  # deviations within which all do; the deviation without others is 1.3 % small
    portion: int = 16  # they come in portions of at most this share of those inside, inverted


MAX_ROUNDS = 20  # both iterations converge within a few, or alternate between nearly equal sets


def robust_start(training, rank, surface, sigma0, random_state):
    """The plane of the most coplanar half of the points, and its scale.

    `rank` is that of the plane of all points. The plane is that of all points within 2.5 deviations
    of it. It is None if these points, or all but one of them, are on one line: then many planes fit
    half of the points or more. The scale is sigma0, or the standard deviation of these points,
    which separate outliers do not enlarge as they would a median.

    Two well-known iterations start from the consistent set: concentration on the half of the points
    with the least residuals (least trimmed squares), then reweighting.
    """
    # Step 1: the maximum consistent set (Algorithm 1).
    X, weights, used, _ = training
    limits, members = StartLimits(), np.zeros(len(X), dtype=bool)
    points = X[used] if surface == "orthogonal" else _stretched(X[used])
    members[used] = _robust_start_plane(points, random_state)
    size = np.count_nonzero(members)
    # Step 2: concentration.
    root = np.sqrt(weighed(used, weights))
    for _ in range(MAX_ROUNDS):
        plane = adjust_plane(X, weighed(members, weights), surface=surface)
        residuals = plane.evaluate(X)[0]
        distances = np.where(used, np.abs(residuals) * root, np.inf)
        nearest = np.zeros(len(X), dtype=bool)
        nearest[np.argpartition(distances, size - 1)[:size]] = True
        if np.array_equal(nearest, members):
            break
        members = nearest

    # Step 3: reweighting.
    made_of = members
    least = training.rounding.least_robust_deviation(plane.direction)
    sigma = sigma0 or max(robust_scale(residuals, weights, plane.rank), least)
    members = np.empty(0, dtype=bool)  # of none of these rounds
    for _ in range(MAX_ROUNDS):
        near = used & (joining(X, weights, plane, sigma) <= limits.cut)
        if np.count_nonzero(near) <= plane.rank or np.array_equal(near, members):
            break
        made_of = members = near
        plane = adjust_plane(X, weighed(members, weights), surface=surface)
        if sigma0 is None:
            least = training.rounding.least_robust_deviation(plane.direction)
            sigma = max(np.sqrt(plane.variance_factor) / limits.cut_deviation, least)
    # Step 4: is the plane determined by more than one point beside a line?
    leverage = weighed(plane.evaluate(X)[1], weights)[made_of]
    # If there are only as many points as parameters, all have leverage 1, wherever they are.
    one_apart = len(leverage) > rank and leverage.max() > 1 - UNCONTROLLED
    if plane.rank < rank or one_apart:
        plane = None
    return plane, float(sigma)


def joining(X, weights, plane, sigma):
    """Predicted residual of each point over its deviation, ``|v| / (s sqrt(1/p + a'N^-1 a))``."""
    residuals, cofactors = plane.evaluate(X)
    size = weighed(np.abs(residuals) / sigma, None if weights is None else np.sqrt(weights))
    return size / np.sqrt(1 + weighed(cofactors, weights))


def points_of_noise(training, start, sigma, level):
    """The points within 2.5 deviations of a plane, and others that are no farther than noise is.

    Others come back, the nearest first, until one is too far off. It is beyond the limit `near`,
    and i points as far off as it is, of n good points, have a chance below ``level / i^3``; these
    chances sum to 1.2 `level`, and for i = 1 the test is that of t.
    """
    X, weights, used, _ = training
    limits, n = JoiningLimits(), int(np.count_nonzero(used))
    support = used & (joining(X, weights, start, sigma) <= StartLimits().cut)
    size = np.count_nonzero(support)
    if size <= start.rank:
        return used
    while size < n:
        plane = adjust_plane(X, weighed(support, weights), surface=start.surface)
        values = joining(X, weights, plane, training.deviation_of(plane))
        outside = np.flatnonzero(used & ~support)
        nearest = outside[np.argsort(values[outside], kind="stable")]
        n_back, last = 0, 0
        # Portions of 1, 2, 4 ... points; where few are inside, each point counts.
        while last < len(nearest) and last <= size // limits.portion:
            i, value = len(nearest) - last, values[nearest[last]]
            is_far = value > limits.near
            if is_far and chance_outside(value, i, n, plane.dof) < level / i**3:
                break
            n_back, last = last + 1, 2 * last + 1
        if n_back == 0:
            break
        support[nearest[:n_back]] = True
        size += n_back
    return support


def half_of(n, d):
    """The points that the start's plane fits: half of those that do not determine it.

    So the most outliers can be left out (P. J. Rousseeuw, A. M. Leroy, "Robust regression and
    outlier detection", 1987). A half of all fits others too well if points are few: of ten points
    with two outliers it is wrong in 12 of 100 planes, and this in 3.
    """
    return (n + d + 1) // 2


def _stretched(X):
    """Points with regressors stretched until distances from planes are practically vertical.

    Otherwise the most coplanar half might lie on a steep plane. Regressors are whitened first,
    because with a constant or collinear column every half would be perfectly coplanar.
    """
    U, residuals = adjust_plane(X).whiten(X)
    typical = np.median(np.abs(residuals - np.median(residuals))) or np.ptp(residuals) or 1.0
    return np.column_stack([U * (1000 * typical * np.sqrt(len(X))), residuals])


def _robust_start_plane(X, random_state=None):
    """Mask of the most coplanar half of the points (Algorithm 1 of the MCMD paper)."""
    rng, limits = check_random_state(random_state), StartLimits()
    n, d = X.shape
    if n <= d + 1:
        return np.ones(n, dtype=bool)
    sample = X if n <= limits.max_points else X[rng.choice(n, limits.max_points, replace=False)]
    needed = n_trials_needed(1 - limits.support_fraction, limits.success_probability, d)
    n_trials = min(needed, limits.max_trials)
    # Nearest to the median first: this order does not depend on the order of the rows.
    distance = np.linalg.norm(sample - np.median(sample, axis=0), axis=1)
    sample = sample[np.argsort(distance, kind="stable")]
    trials = draw_trials(n_trials, len(sample), rng)
    support, _, _ = maximum_consistent_sets(sample[None], trials, half_of(len(sample), d))
    center, _, axes = fit_planes(sample, support[0])
    distances = np.abs((X - center) @ axes[:, 0])
    size, members = half_of(n, d), np.zeros(n, dtype=bool)
    members[np.argpartition(distances, size - 1)[:size]] = True
    return members
