"""Flat surfaces of two clouds as bodies: how far each moved, beside the motion that most share."""

import itertools
import math
import warnings
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree
from scipy.special import chdtrc, chdtri, fdtrc
from sklearn.utils import check_array, check_random_state

from sklearn_mcmd._errors import ParameterError
from sklearn_mcmd.adjustment import BaardaPlaneDetector
from sklearn_mcmd.adjustment._precision import parameter_derivatives, welch
from sklearn_mcmd.adjustment._tests import local_level
from sklearn_mcmd.change._distances import on_known_sides
from sklearn_mcmd.planes._quadrics import tangents_of
from sklearn_mcmd.segmentation import RegionGrowing

# Numbers of a body: two tilts and an offset. A pair of neighborhoods of cells tells its form.
TELLS, LEAST_POINTS = 3, 32
ROUNDS = 20  # in which the set of those that stay has long settled
TRIALS = 300  # sets of three bodies that are asked, at most
ROUNDING = 1e-12  # of angles, and of lengths over the extent


class Bodies(NamedTuple):
    """Flat surfaces of two clouds, a row for each, as of `moved_bodies`.

    Attributes
    ----------
    before, after : ndarray of int of shape (n,)
        Numbers of the regions of both clouds.
    points : ndarray of int of shape (n,)
        Points of the first cloud that both regions cover.
    place, normal : ndarray of shape (n, 3)
        Their mean, and the normal of the first plane, on the side of ``CloudChange.normals_``.
    offset, offset_error : ndarray of shape (n,)
        How far the second plane is off along the normal, in units of X.
    tilt, tilt_error : ndarray of shape (n,)
        Angles between both planes, in degrees.
    pvalue : ndarray of shape (n,)
        Of the test against the motion of the others that stayed; not a number where these do not
        control it.
    moved : ndarray of bool of shape (n,)
        Whether that is below the level.
    motion, motion_covariance : ndarray of shape (6,) and (6, 6)
        Of those that stayed: three shifts, and three turns in radians about the mean of the first
        cloud. What no body tells, as a shift along all walls, is 0 with a wide variance.
    """

    before: NDArray[np.intp]
    after: NDArray[np.intp]
    points: NDArray[np.intp]
    place: NDArray[np.float64]
    normal: NDArray[np.float64]
    offset: NDArray[np.float64]
    offset_error: NDArray[np.float64]
    tilt: NDArray[np.float64]
    tilt_error: NDArray[np.float64]
    pvalue: NDArray[np.float64]
    moved: NDArray[np.bool_]
    motion: NDArray[np.float64]
    motion_covariance: NDArray[np.float64]

    @property
    def registration(self):
        """The motion taken for an error of that size: a covariance (6, 6)."""
        return np.outer(self.motion, self.motion) + self.motion_covariance


def moved_bodies(
    before: "ArrayLike",
    after: "ArrayLike",
    *,
    alpha: float = 0.05,
    random_state: int | np.random.RandomState | None = None,
    n_jobs: int | None = None,
) -> Bodies:
    """Pair the flat regions of two clouds, and test which of them moved against the others.

    Regions are those of :class:`~sklearn_mcmd.RegionGrowing`, paired where most of their points
    are nearest to each other, and compared as by :func:`sklearn_mcmd.adjustment.compare_planes` on
    what both cover. The largest set of pairs that agrees on one motion of six parameters stayed.
    The others are tested against it: a congruency test.

    Parameters
    ----------
    before, after : array-like of shape (n, 3) and (m, 3)
        Two clouds of one place, in one coordinate system and unit.
    alpha : float in (0, 1), default=0.05
        Chance that any body is told to have moved against the others, though none has.
    random_state : int, RandomState instance or None, default=None
    n_jobs : int, default=None
        As of :class:`~sklearn_mcmd.RegionGrowing`.

    Returns
    -------
    bodies : Bodies
        A named tuple of arrays.

    Raises
    ------
    ValueError
        If there are no three flat surfaces that both clouds have.

    Examples
    --------
    A room is scanned twice. The second scan is off by 2 mm, and one wall moved by 10 mm:

    >>> import numpy as np
    >>> from sklearn_mcmd.change import moved_bodies
    >>> def room(rng, wall):
    ...     sides = [rng.uniform(0.02, 0.98, (900, 3)) * [5, 4, 3] for _ in range(6)]
    ...     for axis, side in enumerate(sides):
    ...         side[:, axis % 3] = [0, 0, 0, 5 + wall, 4, 3][axis]
    ...     return np.vstack(sides) + rng.normal(0, 0.002, (5400, 3))
    >>> rng = np.random.default_rng(0)
    >>> bodies = moved_bodies(room(rng, 0), room(rng, 0.01) + [0, 0, 0.002], random_state=0)
    >>> for offset, normal in zip(bodies.offset[bodies.moved], bodies.normal[bodies.moved]):
    ...     print(f"{1000 * offset:.1f} mm along {normal.round(2) + 0.0}")
    10.0 mm along [1. 0. 0.]
    >>> print(f"{1000 * bodies.motion[2]:.1f} mm up")
    2.0 mm up
    """
    first = check_array(before, dtype=np.float64, input_name="before")
    second = check_array(after, dtype=np.float64, input_name="after")
    if (first.shape[1], second.shape[1]) != (3, 3) or not 0 < alpha < 1:
        raise ValueError(
            f"Bodies are of two clouds of 3 columns, and alpha is between 0 and 1; got "
            f"{first.shape[1]} and {second.shape[1]} columns, and {alpha!r}."
        )
    pairs = list(_pairs(first, second, random_state, n_jobs))
    if len(pairs) < TELLS:
        raise ParameterError(
            f"The clouds have {len(pairs)} flat surfaces of {LEAST_POINTS} points in common: three "
            "are needed to tell their motion. Give $registration as a number."
        )
    center = first.mean(axis=0)
    observed, places = [], []
    for _, (rows, others) in pairs:
        one, other = _plane_of(first[rows]), _plane_of(second[others])
        places.append(first[rows].mean(axis=0))
        observed.append(_observe(one, other, places[-1], center))
    values, covariances, moves, dofs, normals = map(np.array, zip(*observed, strict=True))
    congruency = _Congruency(values, covariances, moves, dofs, np.array(places))
    level = local_level(alpha, len(pairs))
    rng = check_random_state(random_state)
    congruency.widen(congruency.stable(level, rng))
    stays = congruency.stable(level, rng)
    motion, covariance = congruency.adjust(stays)
    pvalue = congruency.pvalues(stays)
    errors = congruency.widening * np.sqrt(covariances[:, 2, 2])
    tilts = np.sqrt(np.linalg.eigvalsh(covariances[:, :2, :2])[:, -1])
    return Bodies(
        before=np.array([names[0] for names, _ in pairs]),
        after=np.array([names[1] for names, _ in pairs]),
        points=np.array([len(rows_of[0]) for _, rows_of in pairs]),
        place=np.array(places),
        normal=normals,
        offset=values[:, 2],
        offset_error=errors,
        tilt=np.degrees(np.linalg.norm(values[:, :2], axis=1)),
        tilt_error=np.degrees(congruency.widening * tilts),
        pvalue=pvalue,
        moved=pvalue < level,
        motion=motion,
        motion_covariance=covariance,
    )


def moves_of(places, normals, center):
    """How far places move along normals by unit shifts and by turns about the center: (m, 6)."""
    return np.hstack([normals, np.cross(places - center, normals)])


def _pairs(before, after, random_state, n_jobs):
    """Numbers of flat regions, and the rows of both clouds that both regions cover."""
    growings = [
        RegionGrowing(random_state=random_state, n_jobs=n_jobs).fit(xyz) for xyz in (before, after)
    ]
    labels = [growing.labels_ for growing in growings]
    nearest = [
        labels[1 - i][cKDTree(other).query(xyz)[1]]
        for i, (xyz, other) in enumerate(((before, after), (after, before)))
    ]
    for region in np.flatnonzero(growings[0].regions_["kind"] == "plane"):
        own = np.flatnonzero(labels[0] == region)
        met = nearest[0][own]
        if not (met >= 0).any():
            continue
        other = int(np.bincount(met[met >= 0]).argmax())
        if growings[1].regions_["kind"][other] != "plane":
            continue
        theirs = np.flatnonzero((labels[1] == other) & (nearest[1] == region))
        own = own[met == other]
        if min(len(own), len(theirs)) >= LEAST_POINTS and 2 * len(own) > len(met):
            yield (region, other), (own, theirs)


def _plane_of(xyz):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of regions without noise
        return BaardaPlaneDetector(
            sigma0="auto", surface="orthogonal", robust_start=True, random_state=0
        ).fit(xyz)


def _observe(first, second, at, center):
    """What two planes tell of the motion between them, in units of their errors."""
    normal = on_known_sides(first.normal_[None])[0]
    tangents, other = tangents_of(normal[None])[0], second.normal_
    other = np.copysign(1.0, other @ normal) * other
    near, far = (
        (at - one._fitted.plane.center) @ up for one, up in ((first, normal), (second, other))
    )
    values = np.append(tangents @ other, near - far)
    roots, squares, dofs = [], [], []
    for one in (first, second):
        scale, dof = one._scale_by("posterior")
        derivatives = scale * parameter_derivatives(one._fitted.plane)
        derivatives[-1] -= at @ derivatives[:-1]  # the distance from the place
        roots.append(np.vstack([tangents @ derivatives[:-1], derivatives[-1:]]))
        squares.append(np.square(roots[-1][-1]).sum())  # of the offset, whatever the unit
        dofs.append(dof)
    covariance = sum(root @ root.T for root in roots)
    # A turn w moves the normal by w x n, along a tangent e by w . (n x e).
    turns = np.hstack([np.zeros((2, 3)), np.cross(normal, tangents)])
    moves = np.vstack([turns, moves_of(at[None], normal[None], center)])
    return values, covariance, moves, welch(squares, dofs), normal


class _Congruency:
    """Tests of n bodies against the motion that others have in common, in units of errors."""

    def __init__(self, values, covariances, moves, dofs, places):
        # Of bodies without noise errors are rounding.
        least = np.square(ROUNDING * np.array([1.0, 1.0, np.ptp(places, axis=0).max()]))
        whitening = np.linalg.inv(np.linalg.cholesky(covariances + np.diag(least)))
        self.values = np.einsum("nij,nj->ni", whitening, values)
        self.moves, self.dofs, self.offsets = whitening @ moves, dofs, moves[:, 2]
        # Before anything is adjusted no parameter moves places by more than the largest offset,
        # give or take: what no body determines, as a shift along all walls, stays none.
        errors = np.sqrt(covariances[:, 2, 2] + least[2])
        self.most = max(np.abs(values[:, 2]).max(), 4 * errors.max())
        arm = np.sqrt(np.square(places - places.mean(axis=0)).sum(axis=1).mean())
        self.prior = np.diag(np.repeat([1.0, arm**2], 3)) / self.most**2

    def adjust(self, members):
        """The motion of members, and its covariance."""
        moves = self.moves[members].reshape(-1, 6)
        covariance = np.linalg.inv(moves.T @ moves + self.prior)
        return covariance @ (moves.T @ self.values[members].ravel()), covariance

    def pvalues(self, members):
        """p of all bodies against the motion of members; of a member, of the others. Not a number
        where these leave open by more than half of the largest offset how far it would move."""
        pvalues = np.full(len(self.values), np.nan)
        for k, (value, moves) in enumerate(zip(self.values, self.moves, strict=True)):
            motion, covariance = self.adjust(members[members != k])
            if self.offsets[k] @ covariance @ self.offsets[k] > (self.most / 2) ** 2:
                continue
            gap, together = value - moves @ motion, np.eye(TELLS) + moves @ covariance @ moves.T
            squared = gap @ np.linalg.solve(together, gap)
            known = np.isinf(self.dofs[k])
            pvalues[k] = (
                chdtrc(TELLS, squared) if known else fdtrc(TELLS, self.dofs[k], squared / TELLS)
            )
        return pvalues

    def widen(self, members):
        """Widen all errors by what most bodies leave of the motion of members, if that is more:
        noise that is alike over a whole wall shows in no wall, and between them."""
        motion, _ = self.adjust(members)
        squares = np.square(self.values - self.moves @ motion).sum(axis=1)
        # Six parameters take a share of the squares; half of those of a chi-squared are below.
        share = 1 - 6 / (TELLS * max(len(members), 3))
        factor = np.median(squares) / (chdtri(TELLS, 0.5) * share)
        self.widening = float(np.sqrt(max(factor, 1.0)))
        self.values, self.moves = self.values / self.widening, self.moves / self.widening

    def stable(self, level, rng):
        """The bodies that stayed: the largest set that agrees with the motion of three of it, of
        equal ones that of the least motion. Each then answers to the others."""
        n, most = len(self.values), chdtri(TELLS, level)
        if math.comb(n, 3) > TRIALS:
            triples = [rng.choice(n, 3, replace=False) for _ in range(TRIALS)]
        else:
            triples = [np.array(three) for three in itertools.combinations(range(n), 3)]
        stays, best = np.arange(n), (0, 0.0)
        for members in triples:
            for _ in range(2):  # concentration steps
                motion, _ = self.adjust(members)
                squares = np.square(self.values - self.moves @ motion).sum(axis=1)
                members = np.flatnonzero(squares <= max(most, np.sort(squares)[2]))
            agreement = len(members), -motion @ self.prior @ motion
            if agreement > best:
                stays, best = members, agreement
        for _ in range(ROUNDS):
            new = np.flatnonzero(~(self.pvalues(stays) < level))
            if np.array_equal(new, stays) or len(new) < 3:
                break
            stays = new
        return stays
