"""Rounds of testing and removing: data snooping one at a time, or all at once."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sklearn_mcmd.adjustment._downdate import downdated_plane
from sklearn_mcmd.adjustment._least_squares import PlaneAdjustment, adjust_plane, weighed
from sklearn_mcmd.adjustment._tests import standardized_residuals


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
