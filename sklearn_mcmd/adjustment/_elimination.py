"""Rounds of testing and removing: data snooping one at a time, or all at once."""

from dataclasses import dataclass

import numpy as np

from sklearn_mcmd.adjustment._downdate import DowndatedPlane
from sklearn_mcmd.adjustment._least_squares import PlaneAdjustment, adjust_plane, weights_of
from sklearn_mcmd.adjustment._tests import first_of_largest, standardized_residuals

__all__ = ["Elimination", "eliminate", "eliminate_one_by_one", "own_redundancy"]


@dataclass
class Elimination:
    """State of data snooping.

    It ran out of points if removing the rejected ones would have left too few for a plane with
    redundancy, or points on a line. They are marked in `step`; the plane before is kept.
    """

    step: np.ndarray  # round in which a point was removed, 0 for those never removed
    support: np.ndarray  # points the last plane was adjusted to
    n_rounds: int  # that removed points
    plane: PlaneAdjustment | None = None  # of the support
    robust_weights: np.ndarray | None = None  # W of the last M-estimate
    ran_out_of_rounds: bool = False  # with rejected points left
    ran_out_of_points: bool = False


def eliminate(X, weights, adjust, limit, state, single, max_rounds=None):
    """Remove every rejected point, or the worst one, and adjust again (section 1.1).

    ``adjust(retained)`` gives a plane and robust weights, None for least squares;
    ``limit(n_retained, dof, variance_factor, direction)`` the largest standardized residual that
    passes. With `single` a round removes only the worst of the rejected points. The state is
    changed.
    """
    before = state.support
    while True:
        plane, robust_weights = adjust(weights_of(state.support, weights))
        if state.plane is not None and plane.rank < state.plane.rank:
            state.support, state.ran_out_of_points = before, True
            return state
        state.plane, state.robust_weights = plane, robust_weights
        residuals, cofactors, spread = state.plane.evaluate(X)
        redundancy = own_redundancy(cofactors, spread, weights, state.robust_weights)
        standardized = standardized_residuals(residuals, weights, redundancy)
        standardized[~state.support] = 0.0
        n_retained = np.count_nonzero(state.support)
        most = limit(n_retained, plane.dof, plane.variance_factor, plane.direction)
        rejected = standardized > most
        n_rejected = np.count_nonzero(rejected)
        if n_rejected and single:
            rejected[:], n_rejected = False, 1
            rejected[first_of_largest(standardized)] = True
        if not n_rejected or state.n_rounds == max_rounds:
            state.ran_out_of_rounds = n_rejected > 0
            return state
        state.n_rounds += 1
        state.step[rejected] = state.n_rounds
        if n_retained - n_rejected <= plane.rank:
            state.ran_out_of_points = True
            return state
        before, state.support = state.support, state.support & ~rejected


def eliminate_one_by_one(X, weights, surface, limit, state, max_rounds=None):
    """Same as `eliminate` with ``single=True`` for least squares, by down-dating."""
    plane = DowndatedPlane(X, weights, state.support, surface)
    while True:
        worst, value = plane.largest()
        if value <= limit(plane.n_retained, plane.dof, plane.variance_factor, plane.direction):
            break
        if state.n_rounds == max_rounds:
            state.ran_out_of_rounds = True
            break
        state.n_rounds += 1
        state.step[worst] = state.n_rounds
        if plane.n_retained - 1 <= plane.rank:
            state.ran_out_of_points = True
            break
        plane.remove_largest()
    state.plane = adjust_plane(X, weights_of(state.support, weights), surface=surface)
    return state


def own_redundancy(cofactors, spread, weights, robust_weights=None):
    """Redundancy numbers ``r_i = p_i q_i`` of the observations behind the plane.

    With weights W of an M-estimate the cofactor is that of ``v = (I - A N^-1 A'PW) l`` with W
    taken as fixed: ``r = 1 - 2 w h + p g'Cg``, which is 1 - h for W = 1.
    """
    if robust_weights is None:
        return 1 - (cofactors if weights is None else cofactors * weights)
    loss = 2 * robust_weights * cofactors - spread
    return 1 - (loss if weights is None else loss * weights)
