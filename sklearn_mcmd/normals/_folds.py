"""Where a quadric explains a neighborhood: does the surface bend there, or is it folded?

A quadric and two planes have the same number of parameters. At a bend the quadric leaves less, at a
fold the planes do. Of a surface that bends, the normal is that of the quadric at the point, and not
that of the plane of all members: beside an end of a fillet this leans.
This NumPy form works in any dimension; ``_folds_numba`` repeats it in three.
"""

from typing import NamedTuple

import numpy as np

from sklearn_mcmd.normals._quadrics import (
    PIVOT,
    back_substituted,
    decompose,
    n_terms,
    quadric_terms,
    tangents_of,
)
from sklearn_mcmd.planes._compiling import compiled_function
from sklearn_mcmd.planes._plane import fit_planes, student_factors

__all__ = ["are_folded", "quadric_normals"]

# A neighborhood is folded if what the quadric leaves exceeds this number of times what two planes
# leave, in squares.
LEAST_EVIDENCE = 1.0
# Each leaves the sum of the least squares of this share of the members, since others may be
# outliers.
BEST = 0.75
# Members farther from the robust plane than this number of its standard deviations are what the
# second plane is fitted to first. Then members join the nearer plane and both are fitted anew.
OFF = 1.5
ROUNDS = 5


class FoldLimits(NamedTuple):
    """What the compiled form of `are_folded` is told."""

    evidence: float
    best: float
    off: float
    rounds: int


def are_folded(points, around, planes, faces, compiled):
    """Whether two planes leave less of neighborhoods than a quadric does.

    Parameters
    ----------
    points : ndarray of shape (n, d)
    around : Neighborhoods
    planes : Planes
        Of all members (m).
    faces : Planes
        The robust planes, each of the majority of the members.
    compiled : bool

    Returns
    -------
    folded : ndarray of bool of shape (m,)
    """
    limits = FoldLimits(LEAST_EVIDENCE, BEST, OFF, ROUNDS)
    tangents = tangents_of(planes.normals)
    find = compiled_function("normals._folds_numba", "are_folded_3d") if compiled else None
    if find is not None:
        folded = np.empty(len(around.sizes), dtype=bool)
        find(points, around, planes, tangents, faces, limits, folded)
        return folded
    members, valid = points[around.indices], around.valid
    quadrics = _fit(members, valid, planes, tangents)
    heights = quadrics.heights - np.einsum("mki,mi->mk", quadrics.design, quadrics.coefficients)
    by_quadric = _least(heights * quadrics.extent[:, None], around, limits.best)
    by_planes = _least(_heights_over_two(members, valid, faces, limits), around, limits.best)
    return by_quadric > limits.evidence * by_planes


def _heights_over_two(members, valid, faces, limits):
    """Distances (m, k) of members from the nearer of two planes."""
    d = members.shape[-1]
    deviations = members - faces.centroids[:, None]
    first = np.abs(np.einsum("mkd,md->mk", deviations, faces.normals))
    rest = valid & (first > limits.off * faces.scale[:, None])
    second = np.full_like(first, np.inf)
    two = np.flatnonzero(rest.sum(axis=1) >= d)
    second[two] = _distances(members[two], rest[two])
    for _ in range(limits.rounds):
        rest = valid[two] & (second[two] < first[two])
        n_rest = rest.sum(axis=1)
        enough = (n_rest >= d) & (valid[two].sum(axis=1) - n_rest >= d)
        two, rest = two[enough], rest[enough]
        first[two] = _distances(members[two], valid[two] & ~rest)
        second[two] = _distances(members[two], rest)
    return np.minimum(first, second)


def _distances(members, chosen):
    """Distances (m, k) of members from the planes of some of them."""
    centroids, _, axes = fit_planes(members, chosen)
    return np.abs(np.einsum("mkd,md->mk", members - centroids[:, None], axes[..., 0]))


def quadric_normals(points, queries, around, planes, left, compiled):
    """Tangent planes of quadrics at points, and the errors of their normals.

    Parameters
    ----------
    points : ndarray of shape (n, d)
    queries : ndarray of shape (m, d)
    around : Neighborhoods
    planes : Planes
        Of all members (m).
    left : ndarray of shape (m,)
        Standard deviation of the members from their quadric.
    compiled : bool

    Returns
    -------
    normals : ndarray of shape (m, d)
    centroids : ndarray of shape (m, d)
        Points of the quadrics nearest to the queries, along the normals of the planes. No point is
        farther off the mean, in the plane, than the farthest member.
    errors : ndarray of shape (m,)
        As from `normal_errors`; 90 where the members do not determine the quadric, whose tangent
        plane is then the plane of all members.
    """
    m, d = queries.shape
    tangents = tangents_of(planes.normals)
    tilt = np.empty(m)
    find = compiled_function("normals._folds_numba", "quadric_normals_3d") if compiled else None
    if find is not None:
        normals, centroids = np.empty((2, m, d))
        find(points, queries, around, planes, tangents, PIVOT, normals, centroids, tilt)
    else:
        members, valid = points[around.indices], around.valid
        quadrics = _fit(members, valid, planes, tangents)
        normals, centroids, tilt[:] = _tangent_planes(quadrics, queries, planes, tangents)
    freedom = around.sizes - n_terms(d)
    with np.errstate(invalid="ignore"):
        errors = np.degrees(tilt * left) * student_factors(freedom, d)
    return normals, centroids, np.where(errors <= 90.0, errors, 90.0)


class _Quadrics(NamedTuple):
    """Quadrics over planes of all members, in units of `extent` (m,)."""

    flat: np.ndarray  # coordinates (m, k, d - 1) of members in the plane
    heights: np.ndarray  # (m, k)
    design: np.ndarray
    lower: np.ndarray
    coefficients: np.ndarray
    determined: np.ndarray
    extent: np.ndarray


def _fit(members, valid, planes, tangents):
    extent = np.sqrt(np.maximum(planes.eigenvalues[:, -1], np.finfo(float).tiny))
    local = (members - planes.centroids[:, None]) / extent[:, None, None] * valid[..., None]
    flat = np.einsum("mkd,mtd->mkt", local, tangents)
    heights = np.einsum("mkd,md->mk", local, planes.normals)
    design = quadric_terms(flat) * valid[..., None]
    lower, forward, determined = decompose(design, heights)
    coefficients = back_substituted(lower, forward)
    return _Quadrics(flat, heights, design, lower, coefficients, determined, extent)


def _tangent_planes(quadrics, queries, planes, tangents):
    """Normals, centroids and errors for a noise of one."""
    determined, extent = quadrics.determined, quadrics.extent[:, None]
    foot = np.einsum("md,mtd->mt", (queries - planes.centroids) / extent, tangents)
    farthest = np.square(quadrics.flat).sum(axis=-1).max(axis=1)
    length = np.square(foot).sum(axis=1)
    far = length > farthest
    foot[far] *= np.sqrt(farthest[far] / length[far])[:, None]
    terms = quadric_terms(foot)
    height = np.einsum("mi,mi->m", terms, quadrics.coefficients)
    gradients = _gradients(foot)
    slopes = np.einsum("mti,mi->mt", gradients, quadrics.coefficients)
    steep = 1.0 + np.square(slopes).sum(axis=1)
    normals = planes.normals - np.einsum("mt,mtd->md", slopes, tangents)
    normals /= np.sqrt(steep)[:, None]
    shift = np.einsum("mt,mtd->md", foot, tangents) + height[:, None] * planes.normals
    # A slope ds tilts the normal by the root of ds' (I - s s' / (1 + s' s)) ds / (1 + s' s).
    solved = np.linalg.solve(quadrics.lower, np.swapaxes(gradients, 1, 2))
    along = np.einsum("mit,mt->mi", solved, slopes)
    variance = np.square(solved).sum(axis=(1, 2)) - np.square(along).sum(axis=1) / steep
    tilt = np.sqrt(variance / steep) / quadrics.extent
    normals[~determined], shift[~determined] = planes.normals[~determined], 0.0
    return normals, planes.centroids + shift * extent, np.where(determined, tilt, np.inf)


def _gradients(foot):
    """Derivatives (m, d - 1, terms) of the terms of a quadric by each coordinate."""
    m, d = foot.shape
    columns = np.zeros((m, d, n_terms(d + 1)))
    columns[:, np.arange(d), 1 + np.arange(d)] = 1.0
    pairs = [(i, j) for i in range(d) for j in range(i, d)]
    for place, (i, j) in enumerate(pairs, start=1 + d):
        columns[:, i, place] += foot[:, j]
        columns[:, j, place] += foot[:, i]
    return columns


def _least(heights, around, share):
    """Sums (m,) of the least squares of a share of the members."""
    squares = np.where(around.valid, np.square(heights), np.inf)
    n_best = (share * around.sizes).astype(int)
    chosen = np.arange(squares.shape[1]) < n_best[:, None]
    return np.where(chosen, np.sort(squares, axis=1), 0.0).sum(axis=1)
