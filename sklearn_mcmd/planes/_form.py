"""What a plane leaves of its points: is their noise alike nearby, how do they bow?

Independent noise shows neither in means of cells or strips nor in bows. What is alike nearby, such
as an uneven surface or what a scanner does over some of its range, shows in cells and bows, and
moves and tilts the plane as much as it bows it. What is alike along a row or a column of a scan
averages out in cells and in most bows, but not in strips.
"""

from typing import NamedTuple

import numpy as np
from numpy.linalg import eigh
from scipy.special import fdtrc, stdtrit

from sklearn_mcmd.runtime._chunks import slices

CHUNK = 1 << 15  # rows whose terms are formed at once
N_BOWS = 3  # at least, of as many degrees as that takes
RANK_TOLERANCE = 1e-12  # of squares of a bow over the largest, below which it is a tilt or none


class FormLimits(NamedTuple):
    """When the errors of a plane are those of its bows."""

    halvings: int = 4  # of a plane into cells, 16 that are compact and hold as many points each
    strips: int = 8  # across a plane, which hold as many points each
    # Of means of cells, and of all strips together, from which on the noise counts as independent.
    chance: float = 0.25


class PlaneForm(NamedTuple):
    """What the points of a plane have in common beside it, as of ``detector.form_``.

    The test of the means is that of lack of fit (N. R. Draper, H. Smith, "Applied regression
    analysis", 1998, 2.1); errors by bows and strips are ours.

    Parameters
    ----------
    n_cells : int
        Compact parts of the plane of about as many points each.
    statistic, pvalue : float
        F, which compares the means of the cells with the noise inside of them, and its probability
        if the noise is independent and the surface a plane (lack of fit); nan for too few points.
    dof, noise_dof : int
        Degrees of freedom of the means, and of the noise.
    noise : float
        Standard deviation of unit weight inside of the cells.
    bow : float
        Of the surface of second degree that fits the points best, from its lowest to its highest
        place beside the plane; nan where there is no F.
    alike_deviation, alike_dof : float
        Standard deviation of unit weight that noise alike nearby shows, of the bows or of the means
        of strips, whichever make errors largest, and its degrees of freedom: three of the bows in
        space, 6 of the strips, inf of the rounding of a file; 0 where there is none.
    """

    n_cells: int
    statistic: float
    pvalue: float
    dof: int
    noise_dof: int
    noise: float
    bow: float
    alike_deviation: float
    alike_dof: float

    def is_alike(self, scale: float) -> bool:
        """Whether there is noise that is alike nearby, more than this standard deviation."""
        return self.alike_deviation > scale

    def at_least(self, deviation: float) -> "PlaneForm":
        """The form where all points may be off together by noise of this known deviation."""
        alike = max((self.alike_deviation, self.alike_dof), (deviation, np.inf), key=_half_width)
        return self._replace(alike_deviation=alike[0], alike_dof=alike[1])


class Cells(NamedTuple):
    """Weights, mean places and mean residuals of cells, and the cell of each point."""

    weights: np.ndarray
    places: np.ndarray
    residuals: np.ndarray
    of_point: np.ndarray


def cells_of(places, residuals, weights=None, halvings=None, larger=None):
    """Halve a plane, or `larger` cells, and again each half across its longer side: the `Cells`."""
    if halvings is None:
        halvings = min(FormLimits().halvings, int(np.log2(max(len(places) / 2, 1))))
    # Each axis points to its longer tail, whichever way the wall stands.
    pointed = np.where(np.sum(places**3, axis=0) < 0, -places, places)
    groups = [np.arange(len(places))]
    if larger is not None:
        order = np.argsort(larger.of_point, kind="stable")
        groups = np.split(order, np.cumsum(np.bincount(larger.of_point))[:-1])
    for _ in range(halvings):
        groups = [part for rows in groups for part in _halves(pointed, rows)]
    of_point = np.empty(len(places), np.intp)
    for number, rows in enumerate(groups):
        of_point[rows] = number
    weighted = np.ones(len(places)) if weights is None else weights
    total = np.bincount(of_point, weighted)
    columns = [*places.T, residuals]
    means = [np.bincount(of_point, weighted * column) / total for column in columns]
    return Cells(total, np.column_stack(means[:-1]), means[-1], of_point)


def _halves(places, rows):
    """Rows below and from the median of their longer side on; ties stay together."""
    of_cell = places[rows]
    along = of_cell[:, np.ptp(of_cell, axis=0).argmax()]
    below = along < np.partition(along, len(along) // 2)[len(along) // 2]
    return [rows[below], rows[~below]] if below.any() else [rows]


def form_of(places, residuals, weights=None, rises=None):
    """The `PlaneForm` of residuals from a least-squares plane, at places (n, k) in it, as lengths
    along its axes, with positive weights; `rises` (k,) tell how steeply the axes rise in space."""
    # Step 1: what means of cells leave of the plane that fits them best, by their weights.
    cells = cells_of(places, residuals, weights)
    between, dof = _unevenness(cells.weights, cells.places / _unit(places), cells.residuals)
    noise_dof = len(places) - len(cells.weights)
    squares = float(residuals**2 @ (np.ones(len(places)) if weights is None else weights))
    # Cells that cannot test many regressors need none of their many bows.
    bow = explained = np.nan
    n_bows = 0
    if dof:
        heights, _, explained, n_bows, _ = bow_of(places, residuals, weights)
        bow = float(np.ptp(heights))
    # Step 2: that against the noise inside of cells (lack of fit).
    within = squares - cells.weights @ cells.residuals**2
    noise = float(np.sqrt(max(within, 0.0) / max(noise_dof, 1)))
    statistic, pvalue = _ratio(between, dof, within, noise_dof, squares)
    # Step 3: what makes errors of the plane largest, if it is more than noise.
    alike: list[tuple[float, int]] = []
    if pvalue < FormLimits().chance:
        alike.append((float(np.sqrt(explained / max(n_bows, 1))), n_bows))
    if np.isfinite(pvalue):
        alike += _alike_in_strips(places, residuals, weights, squares, rises)
    alike = [one for one in alike if one[0] > noise]
    deviation, alike_dof = max(alike, key=_half_width, default=(0.0, 0))
    return PlaneForm(
        n_cells=len(cells.weights),
        statistic=float(statistic),
        pvalue=float(pvalue),
        dof=dof,
        noise_dof=noise_dof,
        noise=noise,
        bow=bow,
        alike_deviation=deviation,
        alike_dof=alike_dof,
    )


def _half_width(deviation_and_dof):
    """Of a 95 % band."""
    deviation, dof = deviation_and_dof
    return deviation * stdtrit(dof, 0.975) if dof else 0.0


def _unevenness(weights, places, residuals):
    """Squares that means of parts leave of their own plane, and their degrees of freedom."""
    root = np.sqrt(weights)
    means, design = root * residuals, root[:, None] * _with_one(places)
    tilts, _, rank, _ = np.linalg.lstsq(design, means)
    return np.sum((means - design @ tilts) ** 2), len(root) - int(rank)


def _ratio(between, dof, within, noise_dof, squares):
    """F of means of parts and of the noise inside of them, and its probability; nan for none."""
    if not dof or not noise_dof or within <= RANK_TOLERANCE * squares:
        return np.nan, np.nan
    statistic = between / dof / (within / noise_dof)
    return statistic, fdtrc(dof, noise_dof, statistic)


def _alike_in_strips(places, residuals, weights, squares, rises):
    """Standard deviations of unit weight and degrees of freedom of the means of strips that show
    noise alike along these.

    Strips lie across the axes, and across the level line and the line of fall: a scanner's rows and
    columns follow these, or the longer side of what it passes.
    """
    lines, limits = np.eye(places.shape[1]), FormLimits()
    alike: list[tuple[float, int]] = []
    if rises is not None and len(rises) == 2 and (length := np.linalg.norm(rises)) > 0:
        fall = rises / length
        lines = np.vstack([lines, fall, [-fall[1], fall[0]]])
    n, n_strips = len(places), limits.strips
    if n < 2 * n_strips:
        return alike
    weighted = np.ones(n) if weights is None else weights
    for line in lines:
        along = places @ line
        strip = np.empty(n, np.intp)
        strip[np.lexsort((residuals, along))] = np.arange(n) * n_strips // n
        total = np.bincount(strip, weighted)
        centers, means = (
            np.bincount(strip, weighted * values) / total for values in (along, residuals)
        )
        between, dof = _unevenness(total, centers[:, None] / (np.ptp(along) or 1.0), means)
        pvalue = _ratio(between, dof, squares - total @ means**2, n - n_strips, squares)[1]
        # All tests together find it in independent noise with this chance, at most (Bonferroni).
        if pvalue < limits.chance / len(lines):
            alike.append((float(np.sqrt(between / dof)), dof))
    return alike


def bow_of(places, residuals, weights=None, at=None):
    """Heights of the bow that fits best, over the places `at`, by default the same; the largest
    cofactor of one of them; squares that bows explain, how many these are, and the squares that
    neither plane nor bows explain."""
    n, k = places.shape
    unit, total = _unit(places), np.zeros(())
    for rows in slices(n, CHUNK):
        terms = np.column_stack([_terms(places[rows] / unit), residuals[rows]])
        total = total + (terms if weights is None else terms * weights[rows, None]).T @ terms
    # What of the bows, and of the residuals, no plane explains.
    planes = np.linalg.lstsq(total[: k + 1, : k + 1], total[: k + 1, k + 1 :])[0]
    left = total[k + 1 :, k + 1 :] - total[k + 1 :, : k + 1] @ planes
    values, vectors = eigh(left[:-1, :-1])
    # Bows that are independent of each other, each scaled to squares of one: the square of its
    # product with the residuals is what it explains.
    kept = values > RANK_TOLERANCE * max(values[-1], 1.0)
    vectors = vectors[:, kept] / np.sqrt(values[kept])
    shares = vectors.T @ left[:-1, -1]
    surfaces = np.vstack([-planes[:, :-1] @ vectors, vectors])  # of independent errors of 1
    at = places if at is None else at
    heights, largest = np.empty(len(at)), 0.0
    for rows in slices(len(at), CHUNK):
        each = _terms(at[rows] / unit) @ surfaces
        heights[rows] = each @ shares
        largest = max(largest, np.einsum("ij,ij->i", each, each).max())
    explained = float(shares @ shares)
    return heights, float(largest), explained, len(shares), left[-1, -1] - explained


def _unit(places):
    """Root mean square of each coordinate, 1 where it is 0."""
    unit = np.sqrt(np.mean(places**2, axis=0))
    return np.where(unit == 0, 1.0, unit)


def _terms(places):
    """Columns of a plane, then of bows: squares and products, of lines up to fourth powers."""
    k = places.shape[1]
    if k == 1:
        return places ** np.arange(N_BOWS + 2)
    first, second = np.triu_indices(k)
    return np.column_stack([_with_one(places), places[:, first] * places[:, second]])


def _with_one(places):
    return np.column_stack([np.ones(len(places)), places])
