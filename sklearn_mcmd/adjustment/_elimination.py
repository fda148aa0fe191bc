"""Rounds of testing and removing: one at a time, by down-dating, or all at once (1.1)."""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sklearn_mcmd.adjustment._least_squares import PlaneAdjustment, adjust_plane, weighed
from sklearn_mcmd.adjustment._tests import UNCONTROLLED, first_of_largest, standardized_residuals

# Share of its first value below which a sum is formed anew; twelve digits are left there.
CANCELLATION = 1e-4
# Least number of candidates for the next removals; their arithmetic takes no longer than the calls.
MIN_CANDIDATES = 512
# Further candidates, a share of the cloud, so that a new adjustment is rarely needed; inverted.
CANDIDATE_SHARE = 256


class Elimination(NamedTuple):
    """How far data snooping is.

    It ran out of points if removing the rejected ones would have left too few for a plane with
    redundancy, or points on a line. They are marked in `step`; the plane before is kept.
    """

    step: NDArray[np.intp]  # round in which a point was removed, 0 for those never removed
    support: NDArray[np.bool_]  # points the last plane was adjusted to
    n_rounds: int  # that removed points
    plane: PlaneAdjustment | None = None  # of the support
    ran_out_of_points: bool = False


class Candidates(NamedTuple):
    """Points that may be the next to go, at the last full adjustment."""

    rows: NDArray[np.intp]
    design: NDArray[np.float64]
    residuals: NDArray[np.float64]
    weights: NDArray[np.float64]
    largest_standardized: float  # of all points that are no candidates, as the next
    largest_leverage: float


class LostSums(NamedTuple):
    """What removed points had in the normal equations; g are whitened regressors, e residuals."""

    normal: NDArray[np.float64] | float = 0.0  # sum of p g g'
    cross: NDArray[np.float64] | float = 0.0  # of p e g
    squares: float = 0.0  # of p e^2


class Change(NamedTuple):
    """What these sums do: the present residual is ``shrink e + g'shift`` and the present whitened
    regressors are ``linear g + turn e``."""

    shrink: float
    shift: NDArray[np.float64]
    linear: NDArray[np.float64]
    turn: NDArray[np.float64]
    squares: float


@dataclass(frozen=True, eq=False)
class DowndatedPlane:
    """The plane of the retained points, and the largest of their standardized residuals.

    When a point leaves, only the few sums of the normal equations change (down-dating). Only the
    *candidates*, the points with the largest statistics at the last full adjustment, are computed
    again each time. A bound limits the statistics of all others: if the largest candidate does not
    exceed it, the whole cloud is adjusted anew. So the point found is that of a full computation.

    With whitened regressors g (``|g|^2`` is a cofactor) and the residual e at the last adjustment,
    Cauchy's inequality and the triangle inequality give, with the names of `Change`::

        sqrt(p) |v| <= shrink sqrt(p) |e| + sqrt(h) |shift|
        sqrt(h_now) <= |linear| sqrt(h)   + |turn| sqrt(p) |e|
    """

    last: PlaneAdjustment  # the last full adjustment
    candidates: Candidates
    standardized: NDArray[np.float64]  # of the candidates; -1 for those that are gone
    sum_of_squares: float
    lost: LostSums  # by removed points since then
    change: Change | None = None  # since the last full adjustment

    @property
    def n_retained(self):
        return self.last.n_observations - int(np.count_nonzero(self.standardized < 0))

    @property
    def dof(self):
        return max(self.n_retained - self.last.rank, 0)

    @property
    def variance_factor(self):
        return self.sum_of_squares / self.dof if self.dof else 0.0

    def largest(self):
        """Which candidate has the largest standardized residual; of equal ones the first.

        None if a point that is no candidate may have a larger one.
        """
        change = self.change
        if change is not None and self.standardized.max() <= self._bound_elsewhere(change):
            return None
        return first_of_largest(self.standardized)

    def without(self, at):
        """The plane without this candidate; None if that takes a full adjustment."""
        g, p = self.candidates.design[at], self.candidates.weights[at]
        e, before = self.candidates.residuals[at], self.lost
        lost = LostSums(
            normal=before.normal + p * np.outer(g, g),
            cross=before.cross + p * e * g,
            squares=before.squares + p * e * e,
        )
        gone = self.standardized < 0
        gone[at] = True
        if gone.all():
            return None
        find_change = _turned if self.last.surface == "orthogonal" else _tilted
        try:
            change = find_change(self.last, lost)
        except np.linalg.LinAlgError:  # the sums are no longer positive definite
            return None
        lost_digits = change.squares <= CANCELLATION * self.last.sum_of_squares
        if lost_digits or np.linalg.norm(change.linear, 2) ** 2 * CANCELLATION >= 1:
            return None
        weights = self.candidates.weights
        first_design, first_residuals = self.candidates.design, self.candidates.residuals
        residuals = change.shrink * first_residuals + first_design @ change.shift
        design = first_design @ change.linear.T
        design += np.outer(first_residuals, change.turn)
        redundancy = 1 - weights * np.einsum("ij,ij->i", design, design)
        standardized = standardized_residuals(residuals, weights, redundancy)
        standardized[gone] = -1.0
        return replace(
            self, standardized=standardized, sum_of_squares=change.squares, lost=lost, change=change
        )

    def _bound_elsewhere(self, change):
        """Upper bound of the statistics of all points that are no candidates."""
        standardized = self.candidates.largest_standardized
        leverage = np.sqrt(self.candidates.largest_leverage)
        stretch, turn = np.linalg.norm(change.linear, 2), np.linalg.norm(change.turn)
        redundancy = 1 - (stretch * leverage + turn * standardized) ** 2
        if redundancy <= UNCONTROLLED:
            return np.inf
        residual = abs(change.shrink) * standardized + leverage * np.linalg.norm(change.shift)
        return residual / np.sqrt(redundancy) * (1 + 1e-9)  # equal values differ by less


def downdated_plane(X, weights, support, surface):
    """Adjust all points of the support and choose candidates."""
    retained = weighed(support, weights)
    plane = adjust_plane(X, retained, surface=surface)
    residuals, cofactors = plane.evaluate(X)
    leverage = weighed(cofactors, weights)
    standardized = standardized_residuals(residuals, weights, 1 - leverage)
    standardized[~support] = -1.0
    leverage[~support] = 0.0

    n = len(X)
    size = min(n, MIN_CANDIDATES + n // CANDIDATE_SHARE)
    chosen = np.zeros(n, dtype=bool)
    for values, share in ((standardized, size), (leverage, max(size // 8, 1))):
        chosen[np.argpartition(values, n - share)[n - share :]] = True
    # argpartition breaks ties arbitrarily, but the first of the largest must be chosen.
    chosen[first_of_largest(standardized)] = True
    chosen &= support
    others = support & ~chosen
    rows = np.flatnonzero(chosen)
    U, residuals = plane.whiten(X[rows])
    candidates = Candidates(
        rows=rows,
        design=plane.design(U),
        residuals=residuals,
        weights=retained[rows],
        largest_standardized=standardized.max(where=others, initial=0.0),
        largest_leverage=leverage.max(where=others, initial=0.0),
    )
    return DowndatedPlane(
        last=plane,
        candidates=candidates,
        standardized=standardized[rows],
        sum_of_squares=plane.sum_of_squares,
        lost=LostSums(),
    )


def _tilted(plane, lost):
    """Vertical surface: the changes by the removed points' sums."""
    # The normal matrix of whitened regressors was the identity, and the cross sums were 0: those
    # that are left are I - N and -c, so that the slopes change by -(I - N)^-1 c.
    root = np.linalg.cholesky(np.eye(plane.rank) - lost.normal)
    half = np.linalg.solve(root, lost.cross)
    shift = np.linalg.solve(root.T, half)
    squares = plane.sum_of_squares - lost.squares - half @ half
    linear = np.linalg.inv(root)
    turn = np.zeros(plane.rank)
    return Change(shrink=1.0, shift=shift, linear=linear, turn=turn, squares=squares)


def _turned(plane, lost):
    """Orthogonal surface: the same, with the plane's axes turned into the new principal ones."""
    # From whitened regressors back to lengths within the plane: y = (u, e).
    lengths = np.append(1 / np.linalg.norm(plane.axes, axis=0), 1.0)
    root_total = np.sqrt(plane.sum_weights)
    first = -root_total * np.append(lost.normal[0, 1:], lost.cross[0]) * lengths
    second = np.diag(np.append(np.ones(plane.rank - 1), plane.sum_of_squares))
    second[:-1, :-1] -= lost.normal[1:, 1:]
    second[:-1, -1] = second[-1, :-1] = -lost.cross[1:]
    second[-1, -1] -= lost.squares
    second *= np.outer(lengths, lengths)
    total = plane.sum_weights * (1 - lost.normal[0, 0])
    mean = first / total
    scatter = second - np.outer(mean, first)

    values, vectors = np.linalg.eigh(scatter)
    normal, axes, spread = vectors[:, 0], vectors[:, 1:], values[1:]
    normal = normal * (np.sign(normal[-1]) or 1.0)
    if total <= 0 or np.any(spread <= 0):
        raise np.linalg.LinAlgError
    # eigh is accurate relative to the largest eigenvalue, this quotient relative to the least.
    squares = normal @ scatter @ normal
    shift = np.append(-root_total * (normal @ mean), normal[:-1] * lengths[:-1])
    white = axes / np.sqrt(spread)
    linear = np.zeros((plane.rank, plane.rank))
    linear[0, 0] = np.sqrt(plane.sum_weights / total)
    linear[1:, 0] = -root_total * (mean @ white)
    linear[1:, 1:] = white[:-1].T * lengths[:-1]
    turn = np.append(0.0, white[-1])
    return Change(shrink=normal[-1], shift=shift, linear=linear, turn=turn, squares=squares)


def eliminate(X, weights, surface, limit, start):
    """Remove every rejected point, and adjust again (section 1.1).

    ``limit(n_retained, dof, variance_factor, direction)`` is the largest standardized residual
    that passes.
    """
    now, before = start, start.support
    while True:
        plane = adjust_plane(X, weighed(now.support, weights), surface=surface)
        if now.plane is not None and plane.rank < now.plane.rank:
            return now._replace(support=before, ran_out_of_points=True)
        now = now._replace(plane=plane)
        residuals, cofactors = plane.evaluate(X)
        standardized = standardized_residuals(residuals, weights, 1 - weighed(cofactors, weights))
        standardized[~now.support] = 0.0
        n_retained = np.count_nonzero(now.support)
        most = limit(n_retained, plane.dof, plane.variance_factor, plane.direction)
        rejected = standardized > most
        n_rejected = np.count_nonzero(rejected)
        if not n_rejected:
            return now
        step = np.where(rejected, now.n_rounds + 1, now.step)
        now = now._replace(step=step, n_rounds=now.n_rounds + 1)
        if n_retained - n_rejected <= plane.rank:
            return now._replace(ran_out_of_points=True)
        before, now = now.support, now._replace(support=now.support & ~rejected)


def eliminate_one_by_one(X, weights, surface, limit, start):
    """Remove the worst point as long as it is rejected, by down-dating."""
    step, support, n_rounds = start.step.copy(), start.support.copy(), start.n_rounds
    plane, ran_out = downdated_plane(X, weights, support, surface), False
    while True:
        at = plane.largest()
        if at is None:
            plane = downdated_plane(X, weights, support, surface)
            at = plane.largest()
        most = limit(plane.n_retained, plane.dof, plane.variance_factor, plane.last.direction)
        if plane.standardized[at] <= most:
            break
        n_rounds += 1
        worst = plane.candidates.rows[at]
        step[worst] = n_rounds
        if plane.n_retained - 1 <= plane.last.rank:
            ran_out = True
            break
        support[worst] = False
        plane = plane.without(at) or downdated_plane(X, weights, support, surface)
    last = plane.last  # of the support, unless points went since
    if plane.change is not None:
        last = adjust_plane(X, weighed(support, weights), surface=surface)
    return start._replace(
        step=step, support=support, n_rounds=n_rounds, plane=last, ran_out_of_points=ran_out
    )
