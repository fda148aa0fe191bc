"""What a plane leaves of its points: is their noise alike nearby, how do they bow?

Independent noise shows neither in means of cells nor in bows. What is alike nearby, such as an
uneven surface or what a scanner does over some of its range, shows in both, and moves and tilts the
plane as much as it bows it.
"""

from typing import NamedTuple

import numpy as np
from numpy.linalg import eigh
from scipy.special import fdtrc

from sklearn_mcmd.runtime._chunks import slices

CHUNK = 1 << 15  # rows whose terms are formed at once
N_BOWS = 3  # at least, of as many degrees as that takes
RANK_TOLERANCE = 1e-12  # of squares of a bow over the largest, below which it is a tilt or none
WIDEST_NOISE = 3  # deviations: across less a cell, such as a row, has no tilt


class FormLimits(NamedTuple):
    """When the errors of a plane are those of its bows."""

    halvings: int = 4  # of a plane into cells, 16 that are compact and hold as many points each
    chance: float = 0.25  # of their means, from which on the noise counts as independent


class PlaneForm(NamedTuple):
    """What the points of a plane have in common beside it, as of ``detector.form_``.

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
    bow_deviation, n_bows : float, int
        Standard deviation of unit weight that bows show, and number of these: three in space.
    """

    n_cells: int
    statistic: float
    pvalue: float
    dof: int
    noise_dof: int
    noise: float
    bow: float
    bow_deviation: float
    n_bows: int

    def is_alike(self, scale: float) -> bool:
        """Whether bows show noise that is alike nearby, more than this standard deviation."""
        return self.pvalue < FormLimits().chance and self.bow_deviation > scale


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


def planes_of(cells, places, residuals, weights, noise):
    """Heights at each point of the plane that fits its cell best, and their cofactors."""
    of_point, k = cells.of_point, places.shape[1]
    local = places - cells.places[of_point]
    moments = np.empty((len(cells.weights), k, k + 1))
    columns = np.column_stack([local, residuals])
    for i, j in np.ndindex(k, k + 1):
        moments[:, i, j] = np.bincount(of_point, weights * local[:, i] * columns[:, j])
    # A cell has a tilt only across what is wider than noise.
    values, vectors = eigh(moments[..., :-1])
    is_wide = values > (WIDEST_NOISE * noise) ** 2 * np.bincount(of_point)[:, None]
    is_wide &= values > RANK_TOLERANCE * values[:, -1:]
    inverse = (vectors * (is_wide / np.where(is_wide, values, 1.0))[:, None]) @ vectors.swapaxes(
        1, 2
    )
    slopes = np.einsum("cij,cj->ci", inverse, moments[..., -1])
    heights = cells.residuals[of_point] + np.einsum("ni,ni->n", local, slopes[of_point])
    cofactors = np.einsum("ni,nij,nj->n", local, inverse[of_point], local)
    return heights, cofactors + 1 / cells.weights[of_point]


def form_of(places, residuals, weights=None):
    """The `PlaneForm` of residuals from a least-squares plane, at places (n, k) in it, as lengths
    along its axes, with positive weights."""
    # Step 1: cells, and the plane that fits their means best, by their weights.
    unit = np.sqrt(np.mean(places**2, axis=0))
    unit[unit == 0] = 1.0
    cells = cells_of(places, residuals, weights)
    root = np.sqrt(cells.weights)
    means, design = root * cells.residuals, root[:, None] * _with_one(cells.places / unit)
    tilts, _, rank, _ = np.linalg.lstsq(design, means)
    dof, noise_dof = len(root) - int(rank), len(places) - len(root)
    # Cells that cannot test many regressors need none of their many bows.
    bow, explained, n_bows, squares = _bows(places / unit, residuals, weights, dof > 0)
    # Step 2: what the means are off that plane against the noise inside of cells (lack of fit).
    between, within = np.sum((means - design @ tilts) ** 2), squares - means @ means
    statistic = pvalue = np.nan
    if dof and noise_dof and within > RANK_TOLERANCE * squares:
        statistic = between / dof / (within / noise_dof)
        pvalue = fdtrc(dof, noise_dof, statistic)
    return PlaneForm(
        n_cells=len(root),
        statistic=float(statistic),
        pvalue=float(pvalue),
        dof=dof,
        noise_dof=noise_dof,
        noise=float(np.sqrt(max(within, 0.0) / max(noise_dof, 1))),
        bow=bow,
        bow_deviation=float(np.sqrt(explained / max(n_bows, 1))),
        n_bows=n_bows,
    )


def _bows(places, residuals, weights, tested):
    """Height of the bow that fits best, squares that bows explain, how many these are, and v'Pv;
    nan, 0 and 0 of bows that are not `tested`."""
    n, k = places.shape
    if not tested:
        squares = residuals**2 @ (np.ones(n) if weights is None else weights)
        return np.nan, 0.0, 0, float(squares)
    rows_of, total = slices(n, CHUNK), np.zeros(())
    for rows in rows_of:
        terms = np.column_stack([_terms(places[rows]), residuals[rows]])
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
    bows = vectors @ shares
    surface = np.append(-planes[:, :-1] @ bows, bows)
    heights = [_terms(places[rows]) @ surface for rows in rows_of]
    bow = max(part.max() for part in heights) - min(part.min() for part in heights)
    return float(bow), float(shares @ shares), len(shares), float(left[-1, -1])


def _terms(places):
    """Columns of a plane, then of bows: squares and products, of lines up to fourth powers."""
    k = places.shape[1]
    if k == 1:
        return places ** np.arange(N_BOWS + 2)
    first, second = np.triu_indices(k)
    return np.column_stack([_with_one(places), places[:, first] * places[:, second]])


def _with_one(places):
    return np.column_stack([np.ones(len(places)), places])
