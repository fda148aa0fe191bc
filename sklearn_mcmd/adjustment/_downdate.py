"""Data snooping one point at a time, without a pass over the cloud for each (1.1 of the paper)."""

import numpy as np

from sklearn_mcmd.adjustment._least_squares import adjust_plane, weights_of
from sklearn_mcmd.adjustment._tests import UNCONTROLLED, first_of_largest, standardized_residuals

__all__ = ["DowndatedPlane"]

# Down-dated sums lose digits. Below this share of their first value, where twelve digits are left,
# the plane is adjusted anew.
CANCELLATION = 1e-4

# Candidates for the next removals: this number, whose arithmetic takes no longer than the function
# calls, and a share of the cloud, so that a new adjustment is rarely needed.
MIN_CANDIDATES = 512


class DowndatedPlane:
    """The plane of the retained points, and the largest of their standardized residuals.

    When a point leaves, only the few sums of the normal equations change (down-dating), and the
    residuals and redundancy numbers of all points change a little. Only the *candidates*, the
    points with the largest statistics at the last full adjustment, are computed again each time. A
    bound limits the statistics of all other points. If the largest candidate does not exceed the
    bound, the whole cloud is adjusted anew. So the point found is always the one that a full
    computation finds. `support`, the mask of the retained points, is changed in place.
    `sum_of_squares` is v'Pv of these, `direction` that of residuals at the last full adjustment.

    With whitened regressors g (``|g|^2`` is a cofactor) and the residual e at the last adjustment,
    the present residual is ``shrink e + g'shift`` and the present whitened regressors are
    ``L g + turn e``. Cauchy's inequality and the triangle inequality then give::

        sqrt(p) |v| <= shrink sqrt(p) |e| + sqrt(h) |shift|
        sqrt(h_now) <= |L| sqrt(h)        + |turn| sqrt(p) |e|
    """

    def __init__(self, X, weights, support, surface):
        self.X, self.surface, self.support = X, surface, support
        self.weights = weights
        self._adjust()

    @property
    def dof(self):
        return max(self.n_retained - self.rank, 0)

    @property
    def variance_factor(self):
        return self.sum_of_squares / self.dof if self.dof else 0.0

    def largest(self):
        """Index and value of the largest standardized residual; of equal ones the lowest index."""
        if self._removed and self._standardized.max() <= self._bound_elsewhere():
            self._adjust()
        at = first_of_largest(self._standardized)
        self._at = at
        return int(self._candidates[at]), float(self._standardized[at])

    def remove_largest(self):
        """Take the point that `largest` found out of the plane."""
        at, g = self._at, self._design[self._at]
        p, e = self._candidate_weights[at], self._residuals[at]
        self.support[self._candidates[at]] = False
        self._alive[at] = False
        self.n_retained -= 1
        self._removed += 1
        # Parts of the sums that removed points took away since the last adjustment.
        self._lost_normal += p * np.outer(g, g)
        self._lost_cross += p * e * g
        self._lost_squares += p * e * e
        if self._alive.any():
            self._update()
        else:
            self._adjust()

    def _adjust(self):
        """Adjust all retained points and choose new candidates."""
        retained = weights_of(self.support, self.weights)
        plane = adjust_plane(self.X, retained, surface=self.surface)
        residuals, cofactors, _ = plane.evaluate(self.X)
        leverage = cofactors if self.weights is None else cofactors * self.weights
        standardized = standardized_residuals(residuals, self.weights, 1 - leverage)
        standardized[~self.support] = -1.0
        leverage[~self.support] = 0.0

        n = len(self.X)
        size = min(n, MIN_CANDIDATES + n // 256)
        chosen = np.zeros(n, dtype=bool)
        for values, share in ((standardized, size), (leverage, max(size // 8, 1))):
            chosen[np.argpartition(values, n - share)[n - share :]] = True
        # argpartition breaks ties arbitrarily, but the first of the largest must be chosen.
        chosen[first_of_largest(standardized)] = True
        chosen &= self.support
        others = self.support & ~chosen
        self._rest_standardized = standardized.max(where=others, initial=0.0)
        self._rest_leverage = leverage.max(where=others, initial=0.0)

        self._candidates = candidates = np.flatnonzero(chosen)
        U, self._residuals = plane.whiten(self.X[candidates])
        self._design = plane.design(U)
        self._candidate_weights = retained[candidates]
        self._standardized = standardized[candidates]
        self._alive = np.ones(len(candidates), dtype=bool)
        self._plane, self._removed = plane, 0
        self.rank, self.n_retained = plane.rank, plane.n_observations
        self.sum_of_squares, self.direction = plane.sum_of_squares, plane.direction
        self._lost_normal = np.zeros((plane.rank, plane.rank))
        self._lost_cross, self._lost_squares = np.zeros(plane.rank), 0.0

    def _update(self):
        """Present statistics of the candidates."""
        change = _turned if self.surface == "orthogonal" else _tilted
        try:
            self._shrink, self._shift, self._map, self._turn, squares = change(
                self._plane, self._lost_normal, self._lost_cross, self._lost_squares
            )
        except np.linalg.LinAlgError:  # the sums are no longer positive definite
            return self._adjust()
        self._stretch = np.linalg.norm(self._map, 2)
        lost_digits = squares <= CANCELLATION * self._plane.sum_of_squares
        if lost_digits or self._stretch**2 * CANCELLATION >= 1:
            return self._adjust()
        self.sum_of_squares = squares
        residuals = self._shrink * self._residuals + self._design @ self._shift
        design = self._design @ self._map.T
        if self._turn is not None:
            design += np.outer(self._residuals, self._turn)
        redundancy = 1 - self._candidate_weights * np.einsum("ij,ij->i", design, design)
        self._standardized = standardized_residuals(residuals, self._candidate_weights, redundancy)
        self._standardized[~self._alive] = -1.0
        return None

    def _bound_elsewhere(self):
        """Upper bound of the statistics of all points that are no candidates."""
        rest, leverage = self._rest_standardized, np.sqrt(self._rest_leverage)
        turn = 0.0 if self._turn is None else np.linalg.norm(self._turn)
        redundancy = 1 - (self._stretch * leverage + turn * rest) ** 2
        if redundancy <= UNCONTROLLED:
            return np.inf
        residual = abs(self._shrink) * rest + leverage * np.linalg.norm(self._shift)
        return residual / np.sqrt(redundancy) * (1 + 1e-9)  # equal values differ by less


def _tilted(plane, lost_normal, lost_cross, lost_squares):
    """Vertical surface: the changes by the removed points' sums."""
    root = np.linalg.cholesky(np.eye(plane.rank) - lost_normal)
    half = np.linalg.solve(root, lost_cross)
    shift = np.linalg.solve(root.T, half)
    squares = plane.sum_of_squares - lost_squares - half @ half
    return 1.0, shift, np.linalg.inv(root), None, squares


def _turned(plane, lost_normal, lost_cross, lost_squares):
    """Orthogonal surface: the same, with the plane's axes turned into the new principal ones."""
    # From whitened regressors back to lengths within the plane: y = (u, e).
    lengths = np.append(1 / np.linalg.norm(plane.axes, axis=0), 1.0)
    root_total = np.sqrt(plane.sum_weights)
    first = -root_total * np.append(lost_normal[0, 1:], lost_cross[0]) * lengths
    second = np.diag(np.append(np.ones(plane.rank - 1), plane.sum_of_squares))
    second[:-1, :-1] -= lost_normal[1:, 1:]
    second[:-1, -1] = second[-1, :-1] = -lost_cross[1:]
    second[-1, -1] -= lost_squares
    second *= np.outer(lengths, lengths)
    total = plane.sum_weights * (1 - lost_normal[0, 0])
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
    return normal[-1], shift, linear, turn, squares
