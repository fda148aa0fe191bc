"""The interface of all methods: they take neighborhoods and return `NeighborhoodFit`."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import lru_cache
from numbers import Real
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.utils import check_random_state
from sklearn.utils.random import sample_without_replacement

from sklearn_mcmd._sklearn import Interval, validate_parameter_constraints
from sklearn_mcmd.planes._principal_planes import fit_planes, orthogonal_distances
from sklearn_mcmd.planes._rules import robust_distances

CHUNK_ENTRIES = 1_000_000  # of the largest temporary array
SHUFFLE_AT_ONCE = 1024  # up to this size all rows are shuffled at once, above it one by one
LARGEST_SEED = 2**31 - 1  # that NumPy's generator takes
LEAST_SCALE = 1e-150  # of copies of the origin; its square is a number


#: A share of each neighborhood, of methods without a cut-off.
SHARE = {"contamination": [Interval(Real, 0, 0.5, closed="both"), None]}


@dataclass(frozen=True)
class NeighborhoodFit:
    """The result of a method for B neighborhoods of n members.

    Attributes
    ----------
    scores : ndarray of shape (B, n)
        Abnormality of each member: larger is more abnormal.
    cutoff : ndarray of shape (B,)
        Members with smaller scores are inliers; NaN for a method without a cut-off.
    inliers : ndarray of bool of shape (B, n)
        Members judged regular: all if the method has no cut-off and got no
        contamination.
    support : ndarray of bool of shape (B, n)
        Members that the plane is fitted to by principal components. These are the inliers, but
        all members for PCA, and the members behind its components for ROBPCA.
    centers, normals : ndarray of shape (B, d)
        Center and unit normal of that plane.
    scale : ndarray of shape (B,)
        Standard deviation of the noise along the normal, in units of the points. It is negative
        where no plane was found; there no member is judged.
    origin : ndarray of shape (B, d)
        Origin of the coordinates that `models` take.
    models : list of (ndarray of int, object)
        Rows of neighborhoods of one size, and what scores any points of theirs (m, d).
    """

    scores: np.ndarray
    cutoff: np.ndarray
    inliers: np.ndarray
    support: np.ndarray
    centers: np.ndarray
    normals: np.ndarray
    scale: np.ndarray
    origin: np.ndarray
    models: list[tuple[NDArray[np.intp], Any]]

    def score(self, queries: NDArray[np.float64]) -> NDArray[np.float64]:
        """Abnormality (B, m) of queries (B, m, d) to each of the neighborhoods."""
        local, scores = queries - self.origin[:, None], np.empty(queries.shape[:2])
        with np.errstate(over="ignore"):  # off copies of the origin, which have no scale
            for rows, model in self.models:
                scores[rows] = model.score(local[rows])
        return scores


class Verdict(NamedTuple):
    """The result of `Method._fit`, with the names of `NeighborhoodFit`."""

    model: object
    scores: np.ndarray
    inliers: np.ndarray
    cutoff: np.ndarray | float
    scale: np.ndarray | float = 0.0  # 0: standard deviation of the support along the normal
    support: np.ndarray | None = None  # None: the inliers


@dataclass(frozen=True)
class WhitenedModel:
    """Lengths of whitened deviations from a center."""

    centers: np.ndarray
    whitening: np.ndarray

    def score(self, points):
        return robust_distances(points, self.centers, self.whitening)


class Method(ABC):
    """A method with its parameters: subclasses are frozen dataclasses of the parameters.

    `_fit` of a subclass judges a group of neighborhoods of equal size. This class does the rest:
    sizes, the origin, the tables of random positions, the final plane.
    """

    has_cutoff: ClassVar[bool] = True  # whether it decides by itself which members are outliers
    _parameter_constraints: ClassVar[dict] = {}

    def __post_init__(self):
        params = {name: getattr(self, name) for name in self._parameter_constraints}
        validate_parameter_constraints(self._parameter_constraints, params, type(self).__name__)

    def fit(
        self, points: "ArrayLike", *, random_state: int | np.random.RandomState | None = None
    ) -> NeighborhoodFit:
        """Judge the members of many neighborhoods.

        Parameters
        ----------
        points : array-like of shape (B, n, d)
            Neighborhoods, in any unit; one cloud X is ``X[None]``. They are centered at each
            neighborhood's first member before any arithmetic.
        random_state : int, RandomState instance or None, default=None
            Seed of the one table of random positions that all neighborhoods use.

        Examples
        --------
        Two walls, one with a car in front of it:

        >>> import numpy as np
        >>> from sklearn_mcmd.baselines import Pca, Ransac, Robpca
        >>> rng = np.random.default_rng(0)
        >>> walls = rng.uniform(0, 2, (2, 50, 3)) * [1, 0, 1] + rng.normal(0, 0.004, (2, 50, 3))
        >>> walls[1, :15] += [0, -0.8, 0]
        >>> for method in (Pca(), Ransac(), Robpca()):
        ...     found = method.fit(walls, random_state=0)
        ...     tilts = np.degrees(np.arccos(np.abs(found.normals[:, 1])))
        ...     print((~found.inliers).sum(axis=1), "removed, tilts", tilts.round(1), "degrees")
        [1 0] removed, tilts [0.1 4.7] degrees
        [ 1 15] removed, tilts [0.  0.1] degrees
        [ 2 15] removed, tilts [0.1 0.1] degrees
        """
        points = np.asarray(points, dtype=np.float64)
        if points.ndim != 3:
            raise ValueError(
                f"points must have shape (neighborhoods, members, d), got {points.shape}; one "
                "cloud X is X[None]."
            )
        n_sets, n, d = points.shape
        if n_sets and n <= d:
            raise ValueError(
                f"{n} members are too few for planes in {d}D: at least {d + 1} are needed."
            )
        return self.fit_sizes(points, np.full(n_sets, n), self.seed(random_state))

    def fit_sizes(
        self,
        points: NDArray[np.float64],
        sizes: NDArray[np.integer],
        seed: int,
        rounding: float = 8 * 2.0**-52,
        least_scale: float = 0.0,
    ) -> NeighborhoodFit:
        """As `fit`, for neighborhoods whose first `sizes` members are in use.

        `rounding` is the relative rounding error of the coordinates, and `least_scale` the error
        from their step. No scale is smaller than these.
        """
        n_sets, n, d = points.shape
        # Large coordinates would cost digits, and rounding of them is the least scale.
        origin = points[:, 0].copy()
        local = points - origin[:, None]
        inside = np.arange(n) < sizes[:, None]
        local[~inside] = 0.0
        extent = np.abs(local).max(axis=(1, 2), initial=0.0)
        floor = np.maximum(rounding * (np.abs(origin).max(axis=1) + extent), least_scale)
        floor = np.maximum(floor, LEAST_SCALE)
        scores = np.zeros((n_sets, n))
        inliers, support = np.zeros((2, n_sets, n), dtype=bool)
        cutoff, scale = np.full(n_sets, np.nan), np.zeros(n_sets)
        models = []
        for size in np.unique(sizes):
            rows = np.flatnonzero(sizes == size)
            table = self.table(int(size), d, seed)
            verdict = self._fit(local[rows, :size], table, floor[rows])
            scores[rows, :size], inliers[rows, :size] = verdict.scores, verdict.inliers
            support[rows, :size] = verdict.inliers if verdict.support is None else verdict.support
            cutoff[rows], scale[rows] = verdict.cutoff, verdict.scale
            models.append((rows, verdict.model))
        # Algorithm 4: the plane of the members left.
        centers, _, axes = fit_planes(local, support)
        unknown = scale == 0
        if unknown.any():
            scales = plane_scale(local, support, centers, axes[..., 0])
            scale = np.where(unknown, np.maximum(scales, floor), scale)
        return NeighborhoodFit(
            scores=scores,
            cutoff=cutoff,
            inliers=inliers,
            support=support,
            centers=centers + origin,
            normals=axes[..., 0],
            scale=scale,
            origin=origin,
            models=models,
        )

    def seed(self, random_state: int | np.random.RandomState | None = None) -> int:
        """The seed of all tables of random positions."""
        return check_random_state(random_state).randint(LARGEST_SEED)

    def table(self, size: int, d: int, seed: int) -> NDArray[np.intp]:
        """The one table of random positions of all neighborhoods of a size."""
        n_rows, n_columns = self.table_shape(size, d)
        return _draw_positions(n_rows, min(n_columns, size), size, seed)

    def usual_cutoff(self, n: int, d: int) -> float | None:
        """Score above which one of n members is an outlier; None for a method without a cut-off."""
        return None

    @abstractmethod
    def table_shape(self, size: int, d: int) -> tuple[int, int]:
        """Rows and columns of the table for neighborhoods of a size."""

    @abstractmethod
    def _fit(self, points, table, floor):
        """The verdicts on neighborhoods of one size, as `Verdict`.

        Points (B, n, d) are without the origin; `table` has random positions, and `floor` (B,) is
        the least scale.
        """


def flag_share(scores, contamination):
    """Inliers (B, n) and cutoff (B,) if this share of the members, the highest scores, is flagged.

    The number is rounded to the nearest integer. Among equal scores the first are flagged.
    """
    n_sets, n = scores.shape
    if contamination is None:
        return np.ones(scores.shape, dtype=bool), np.full(n_sets, np.nan)
    n_flagged = int(np.floor(contamination * n + 0.5))
    order = np.argsort(-scores, axis=1, kind="stable")
    inliers = np.ones(scores.shape, dtype=bool)
    np.put_along_axis(inliers, order[:, :n_flagged], False, axis=1)
    # Scores up to the highest that is kept are below the cutoff.
    highest_kept = np.take_along_axis(scores, order[:, n_flagged : n_flagged + 1], 1)[:, 0]
    return inliers, np.nextafter(highest_kept, np.inf)


def plane_scale(points, members, centers, normals):
    """Standard deviation of the members along the normal, less the plane's degrees of freedom."""
    distances = np.where(members, orthogonal_distances(points, centers, normals), 0.0)
    freedom = np.maximum(members.sum(axis=1) - points.shape[-1], 1)
    return np.sqrt(np.square(distances).sum(axis=1) / freedom)


@lru_cache  # which is asked for by each chunk
def _draw_positions(n_rows, n_columns, size, seed):
    rng = np.random.RandomState(seed)
    if size <= SHUFFLE_AT_ONCE:
        table = rng.random_sample((n_rows, size)).argsort(axis=1)[:, :n_columns]
    else:
        table = np.empty((n_rows, n_columns), dtype=np.intp)
        for row in table:
            row[:] = sample_without_replacement(size, n_columns, random_state=rng)
    table.flags.writeable = False  # all who ask share it
    return table
