"""Two clouds at places: what is told once of both, what planes of both tell, and the verdicts."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import erfc, ndtri

from sklearn_mcmd._validation import SMALLEST
from sklearn_mcmd.change._bodies import Bodies, moves_of
from sklearn_mcmd.change._distances import sampled, tree_of
from sklearn_mcmd.outliers._surfaces import SurfaceLimits
from sklearn_mcmd.planes._explaining import ExplainLimits
from sklearn_mcmd.planes._indexed_cloud import distinct_rows

FEWEST = 15  # neighbors, of which a plane and its noise are told
WIDEST = 4  # times as many neighbors of a denser second cloud, at most
ALIKE = 0.1  # of the density, within which those of two clouds are equal
SAMPLE = 1_000  # points, about, that tell how wide neighborhoods are
REASONS = ("compared", "nothing within reach", "no surface", "another surface")
NOTHING, NO_SURFACE, OTHER = 1, 2, 3


class ChangeLimits(NamedTuple):
    """What can be compared."""

    reach: float = 10.0  # usual radii of a neighborhood, within which a surface is looked for
    turned: float = 45.0  # degrees between normals of one surface, at most


class Scale(NamedTuple):
    """What is told once of two clouds, and holds for all places."""

    usual: float  # radius of neighborhoods of the first cloud
    reach: float
    n_neighbors: int  # of the second cloud
    width: float  # of the first one's neighborhoods, over that of the second one's

    @classmethod
    def of(cls, radii, others, n_neighbors, reach=None):
        """By some of the `radii_in` both clouds.

        The second gets as many neighbors as make its usual neighborhood about as wide: where a
        surface bends, planes of wider ones lie deeper.
        """
        usual, other = (max(float(np.median(some)), SMALLEST) for some in (radii, others))
        ratio = (usual / other) ** 2
        n_second = n_neighbors
        if abs(ratio - 1) >= ALIKE:
            n_second = int(np.clip(np.rint(n_neighbors * ratio), FEWEST, WIDEST * n_neighbors))
        reach = ChangeLimits().reach * usual if reach is None else reach
        return cls(usual, reach, n_second, float(np.sqrt(ratio * n_neighbors / n_second)))


class Measured(NamedTuple):
    """What planes tell at places (m,)."""

    distance: np.ndarray  # not a number where nothing is compared
    variance: np.ndarray  # of the distance, by independent noise
    normals: np.ndarray  # (m, d), of the first cloud
    reason: np.ndarray  # uint8, as rows of `REASONS`
    others: np.ndarray  # the rows of the second cloud whose planes were asked

    def registered(self, covariance, places, center):
        """Variances of distances by the registration: a variance, or a covariance of a motion
        about a center."""
        if np.ndim(covariance) == 0:
            return np.full(len(places), float(covariance))
        moves = moves_of(places, self.normals, center)
        return np.einsum("ij,jk,ik->i", moves, covariance, moves)


def radii_in(xyz, tree, n_neighbors, share, n_jobs):
    """How wide neighborhoods are of a share of the points of a cloud; copies are one point."""
    if not len(xyz):
        return np.empty(0)
    some = xyz[sampled(xyz, share)]
    near = tree.query(some, [1, 2, min(n_neighbors, len(xyz))], workers=n_jobs)[0]
    if (near[:, 1] == 0).any():
        xyz = xyz[distinct_rows(xyz)[0]]
        near = tree_of(xyz).query(some, [min(n_neighbors, len(xyz))], workers=n_jobs)[0]
    return near[:, -1]


def measure(before, second, scale, n_jobs, places=None):
    """The `Measured` at places, by default the points of the first cloud, by the planes of both
    clouds alone."""
    if is_own := places is None:
        places, rows, is_near = before.xyz, slice(None), True
    else:
        rows, is_near = before.nearest(places, scale.reach, n_jobs)
    others, are_near = second.nearest(places, scale.reach, n_jobs)
    normals = before.normals[rows]
    reason = _reasons(before, rows, second, others, places, is_near & are_near)
    near, own = before.heights(rows, places, normals)
    far, theirs = second.heights(others, places, normals)
    if is_own:  # a point off its own surface is no place of it
        noise = before.planes.scale
        is_off = (np.abs(near) > ExplainLimits().explained * noise) & (noise > 0)
        reason[is_off & (reason == 0)] = NO_SURFACE
    distance = np.where(reason == 0, far - near, np.nan)
    return Measured(distance, own + theirs, normals, reason, others)


def _reasons(before, rows, second, others, places, is_near):
    """Why places cannot be compared, as rows of `REASONS`."""
    limits, reason = ChangeLimits(), np.zeros(len(places), np.uint8)
    normals, radius = before.normals[rows], before.planes.radius[rows]
    # The second cloud goes on beside a place, not above or below it: so beside what hid it.
    aside = second.xyz[others] - places
    aside -= np.einsum("ij,ij->i", aside, normals)[:, None] * normals
    cosine = np.abs(np.einsum("ij,ij->i", normals, second.normals[others]))
    reason[cosine < np.cos(np.radians(limits.turned))] = OTHER
    reason[_is_rough(before.planes, rows) | _is_rough(second.planes, others)] = NO_SURFACE
    reason[~is_near | (np.linalg.norm(aside, axis=1) > radius)] = NOTHING
    return reason


def _is_rough(planes, rows):
    """Whether neighborhoods are no surface, by the detector's limit."""
    scale = planes.scale[rows]
    return ~((scale >= 0) & (scale <= SurfaceLimits().flat * planes.radius[rows]))


class Changes(NamedTuple):
    """What has moved, a row for each core point, as of `CloudChange.compare`.

    Attributes
    ----------
    distance : ndarray of shape (n_core,)
        From the first surface to the second along the first one's normal, in units of X; not a
        number where nothing can be compared.
    distance_error : ndarray of shape (n_core,)
        Its standard error.
    level_of_detection : ndarray of shape (n_core,)
        Beyond which one distance alone is significant.
    pvalue : ndarray of shape (n_core,)
        After the `correction`.
    significant : ndarray of bool of shape (n_core,)
        Whether that is below `alpha`.
    reason : ndarray of uint8 of shape (n_core,)
        0 compared; 1 nothing within reach; 2 no surface, as in leaves; 3 another surface, whose
        normal is turned by more than 45 degrees.
    alike : float
        By how much noise that is alike nearby multiplies variances, 1 at least; not a number where
        the first cloud is too small to tell.
    bodies : Bodies or None
        With ``registration="auto"`` those of :func:`~sklearn_mcmd.change.moved_bodies`.
    """

    distance: NDArray[np.float64]
    distance_error: NDArray[np.float64]
    level_of_detection: NDArray[np.float64]
    pvalue: NDArray[np.float64]
    significant: NDArray[np.bool_]
    reason: NDArray[np.uint8]
    alike: float = np.nan
    bodies: Bodies | None = None


def judged(distance, variance, reason, alpha, adjust):
    """The `Changes` that distances and variances tell; ``adjust(pvalues)`` corrects those of the
    distances alone."""
    error = np.where(reason == 0, np.sqrt(variance), np.nan)
    pvalue = adjust(pvalues_of(distance, error))
    return Changes(distance, error, -ndtri(alpha / 2) * error, pvalue, pvalue < alpha, reason)


def columns_of(changes):
    """What is written of each point."""
    columns = {name: getattr(changes, name).astype(np.float32) for name in Changes._fields[:4]}
    others = ("significant", "reason")
    return columns | {name: getattr(changes, name).astype(np.uint8) for name in others}


def pvalues_of(distance, error):
    """Two-sided, of each distance alone; not a number where there is none."""
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.abs(distance) / error
    ratio[(distance == 0) & (error == 0)] = 0.0  # of exact points
    return erfc(ratio / np.sqrt(2))


class Correction(NamedTuple):
    """P-values after a correction, by all that there are: ascending, without ties."""

    levels: np.ndarray
    adjusted: np.ndarray

    @classmethod
    def of(cls, levels, counts, name):
        """Of distinct p-values, and how often each occurs."""
        if name == "fdr":
            steps = levels * counts.sum() / np.cumsum(counts)
            adjusted = np.minimum.accumulate(steps[::-1])[::-1]
        elif name == "sidak":
            with np.errstate(divide="ignore"):
                adjusted = -np.expm1(counts.sum() * np.log1p(-levels))
        else:
            adjusted = levels
        return cls(levels, adjusted)

    def adjust(self, pvalues):
        """The p-values in place of those alone, which are among the levels or not numbers."""
        told, adjusted = np.isfinite(pvalues), np.full(len(pvalues), np.nan)
        adjusted[told] = self.adjusted[np.searchsorted(self.levels, pvalues[told])]
        return adjusted


class Summary(NamedTuple):
    """What is told of all places together."""

    reasons: list[int]  # how many places have each of the `REASONS`
    n_significant: int
    distance: float  # median of those compared, as that below
    level_of_detection: float
    alike: float
    bodies: Bodies | None

    @classmethod
    def of(cls, changes):
        compared, medians = changes.reason == 0, (np.nan, np.nan)
        if compared.any():
            both = changes.distance[compared], changes.level_of_detection[compared]
            medians = np.median(both, axis=1)
        reasons = np.bincount(changes.reason, minlength=len(REASONS)).tolist()
        n_significant = int(np.count_nonzero(changes.significant))
        return cls(reasons, n_significant, *medians, changes.alike, changes.bodies)

    def stored(self):
        """As JSON has it."""
        bodies = self.bodies and {k: v.tolist() for k, v in self.bodies._asdict().items()}
        return self._asdict() | {"bodies": bodies}

    @classmethod
    def read(cls, stored):
        """Of what was `stored`."""
        bodies = stored["bodies"] and {k: np.array(v) for k, v in stored["bodies"].items()}
        return cls(**stored | {"bodies": bodies and Bodies(**bodies)})
