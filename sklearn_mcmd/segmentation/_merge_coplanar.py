"""Planes of regions, and the joining of regions that are parts of one plane."""

from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from sklearn_mcmd.planes._explaining import ExplainLimits
from sklearn_mcmd.runtime._chunks import run, slices, spatial_order
from sklearn_mcmd.segmentation._graph import answers_of
from sklearn_mcmd.segmentation._region_sums import (
    Groups,
    Moments,
    median_by_region,
    n_regions_of,
    region_moments,
)

ROUNDING = 16 * np.finfo(np.float64).eps  # of a least eigenvalue, as a share of the largest one
CHUNK = 64  # regions whose pairs are sought at once,
PAIRS = 2**16  # and pairs that are tried at once; both limit the memory
FEW = 128  # one point in so many is asked first whether a region is near
WIDER = 1.0 + 1e-9  # a search reaches farther than the largest gap by more than rounding


class JoinLimits(NamedTuple):
    """When regions are one surface."""

    # Largest ratio of two root mean squares that count as equal. A region is flat if the distances
    # from its plane are at most this many times the noise of its neighborhoods. Another region lies
    # in that plane if they are at most as many times the noise of the quieter of the two: noise of
    # a curved one contains its bend.
    most_noise: float = 1.5
    most_gap: float = 0.5  # parts are joined over a gap of this share of the smaller one's length


class RegionPlanes(NamedTuple):
    """The planes of regions, by their moments."""

    sizes: np.ndarray  # as `Moments`, as are the next two
    centroids: np.ndarray
    covariances: np.ndarray
    eigenvalues: np.ndarray  # (n_regions, d), ascending: the first is the mean square distance
    axes: np.ndarray  # (n_regions, d, d), as columns, of which the first is the normal

    @classmethod
    def of(cls, moments):
        """Those of `Moments`."""
        eigenvalues, axes = np.linalg.eigh(moments.covariances)
        # Rounding makes the least eigenvalue of an exact plane negative.
        return cls(
            sizes=moments.sizes,
            centroids=moments.centroids,
            covariances=moments.covariances,
            eigenvalues=np.maximum(eigenvalues, 0.0),
            axes=axes,
        )


def join_coplanar(points, labels, around, n_jobs=None):
    """Give one label to regions that are parts of one plane: new labels, by first parts.

    A smaller region lies in the plane of a larger, flat one if the noise explains its root mean
    square distance to that plane. It is joined to the nearest such plane if the gap between them is
    small. Labels are from 0 on without gaps, -1 for none; `around` are the planes of the points.
    """
    n_regions = n_regions_of(labels)
    if n_regions < 2:
        return labels
    planes, groups = region_moments(points, labels, n_regions), Groups.of(labels)
    parts = [[points[rows]] for rows in groups.split()]
    noise, reach = (
        median_by_region(values, labels, n_regions) for values in (around.scale, around.radius)
    )
    noise = np.column_stack([noise, flat_noise(planes.covariances, reach)])
    whole = np.append(np.arange(n_regions, dtype=np.int32), np.int32(-1))  # of which a region is
    while True:  # each round joins at least two parts
        pairs, most = _pairs_in_a_plane(planes, noise, n_jobs)
        pairs = pairs[_near(parts, pairs, most, n_jobs)]
        if len(pairs) == 0:
            break
        # A small part that lies in two planes joins the nearer: it is no bridge between them.
        pairs = pairs[np.unique(pairs[:, 0], return_index=True)[1]]
        graph = coo_array((np.ones(len(pairs)), pairs.T), shape=(len(noise), len(noise)))
        # Parts are numbered by their first region, which keeps the order of regions.
        n_parts, part = connected_components(graph, directed=False)
        planes, noise = pooled(planes, noise, part)
        joined: list[list] = [[] for _ in range(n_parts)]
        for number, arrays in zip(part.tolist(), parts, strict=True):
            joined[number] += arrays
        parts, whole = joined, np.append(part, -1).astype(np.int32)[whole]
    return whole[labels]


def flat_noise(covariances, radius):
    """Root mean square distances of flat regions from their planes, 0 of others: three times that
    distance is within a neighborhood's radius where a region is flat."""
    rms = rms_from_planes(covariances)
    return np.where(ExplainLimits().explained * rms <= radius, rms, 0.0)


def rms_from_planes(covariances):
    """Root mean square distances of regions from their planes."""
    return np.sqrt(np.maximum(np.linalg.eigvalsh(covariances)[:, 0], 0.0))


def pooled(moments, noise, part):
    """The `Moments` and the noise of joined regions, from those of their parts."""
    (sizes, centroids, covariances), n_parts = moments, int(part.max()) + 1
    of_part = part, np.arange(len(part))
    share = coo_array((sizes, of_part), shape=(n_parts, len(part))).tocsr()
    total = np.bincount(part, sizes, n_parts)
    # The first part is the origin, so that large coordinates cost no accuracy.
    first = np.unique(part, return_index=True)[1]
    local = centroids - centroids[first[part]]
    mean = (share @ local) / total[:, None]
    # The covariance of a whole is the mean of those of its parts, about the common mean.
    apart = local - mean[part]
    squares = covariances + apart[:, :, None] * apart[:, None, :]
    d = centroids.shape[1]
    pooled = (share @ squares.reshape(-1, d * d)) / total[:, None]
    joined = Moments(total, centroids[first] + mean, pooled.reshape(-1, d, d))
    return joined, (share @ noise) / total[:, None]


def _pairs_in_a_plane(moments, noise, n_jobs=None):
    """Pairs (smaller, larger) of regions that may be joined, the nearest planes first, and the gap
    that each region allows."""
    # Step 1: flat regions, which the noise explains. Regions that are not flat are in no pair; a
    # cloud of noise has very many of them.
    sizes, centroids, covariances, eigenvalues, axes = RegionPlanes.of(moments)
    normals = axes[..., 0]
    # Points spread evenly over a length have its root 12th as standard deviation.
    length, (most_noise, most_gap) = np.sqrt(12 * eigenvalues[:, -1]), JoinLimits()
    rounding = ROUNDING * eigenvalues[:, -1]
    flat = eigenvalues[:, 0] <= (most_noise * noise.max(axis=1)) ** 2 + rounding
    flat &= sizes > centroids.shape[1]
    flat = np.flatnonzero(flat)
    rank = np.argsort(np.argsort(sizes[flat], kind="stable"), kind="stable")
    centroids, covariances, normals = centroids[flat], covariances[flat], normals[flat]
    (scale, rms), rounding, reach = noise[flat].T, rounding[flat], length[flat]
    # Step 2: pairs that are near each other. Regions of one length that are near each other are
    # searched at once: few others are near.
    order, place = spatial_order(centroids), np.empty(len(flat), np.intp)
    place[order] = np.arange(len(flat))
    order = np.lexsort((place, np.frexp(reach)[1]))
    beside = WIDER * (1.0 + most_gap) * reach

    def search(part):
        rows = order[part]
        r, s = _near_pairs(centroids, WIDER * reach[rows], beside, rows)
        smaller = rank[s] < rank[r]
        r, s = r[smaller], s[smaller]
        pairs = [those_in_plane(r[chunk], s[chunk]) for chunk in slices(len(r), PAIRS)]
        return np.concatenate([np.empty((0, 3)), *pairs])

    def those_in_plane(r, s):
        """Those of the pairs whose second region lies in the plane of the first, and is near it."""
        apart, normal = centroids[s] - centroids[r], normals[r]
        # This is a lower bound of the gap: no point is farther from its centroid than the length.
        near = np.linalg.norm(apart, axis=-1) - reach[r] - reach[s] <= most_gap * reach[s]
        # The mean square distance of s from the plane of r: its variance along that normal, and the
        # square of its centroid's distance.
        tilted = np.einsum("pde,pd,pe->p", covariances[s], normal, normal)
        square = np.einsum("pd,pd->p", apart, normal) ** 2 + tilted
        thin = np.where((rms[r] > 0) & (rms[s] > 0), np.maximum(rms[r], rms[s]), 0.0)
        limit = (most_noise * np.maximum(np.minimum(scale[r], scale[s]), thin)) ** 2
        near &= square <= limit + np.maximum(rounding[r], rounding[s])
        return np.column_stack([flat[s], flat[r], square])[near]

    # Step 3: the nearest planes first.
    candidates = answers_of(search, slices(len(flat), CHUNK), n_jobs)
    small, large, square = np.concatenate([np.empty((0, 3)), *candidates]).T
    order = np.lexsort((large, square, small))
    return np.column_stack([small, large])[order].astype(int), most_gap * length


def _near_pairs(centers, reach, beside, rows):
    """Pairs of one of some rows, which reach so far, and any row, that are no farther apart than
    this and how far from the other is `beside` it; and perhaps some more."""
    rounding = ROUNDING * np.abs(centers).max(initial=0.0)
    low = (centers[rows] - reach[:, None]).min(axis=0) - rounding
    high = (centers[rows] + reach[:, None]).max(axis=0) + rounding
    near = (centers + beside[:, None] >= low) & (centers - beside[:, None] <= high)
    near = np.flatnonzero(near.all(axis=1))
    square = np.zeros((len(rows), len(near)))
    for axis in range(centers.shape[1]):
        square += np.square(centers[near, axis] - centers[rows, axis][:, None])
    r, s = np.nonzero(square <= np.square(reach[:, None] + beside[near] + rounding))
    return rows[r], near[s]


def _near(parts, pairs, most, n_jobs=None):
    """Whether the gap between the regions of each pair is small enough for the first region.

    `parts` has arrays of the points of each region.
    """
    near = np.zeros(len(pairs), dtype=bool)

    def search(large):
        points, rows = np.concatenate(parts[large]), np.flatnonzero(pairs[:, 1] == large)
        low, high = points.min(axis=0), points.max(axis=0)
        rounding = ROUNDING * np.maximum(np.abs(low), np.abs(high))
        for step in (FEW, 1):  # few points mostly tell
            tree = None
            for row in rows[~near[rows]].tolist():
                queries, gap = np.concatenate(parts[pairs[row, 0]])[::step], most[pairs[row, 0]]
                reach = WIDER * gap + rounding  # those beyond the box are too far away
                inside = ((queries >= low - reach) & (queries <= high + reach)).all(axis=1)
                if inside.any():
                    tree = tree or cKDTree(points[::step], balanced_tree=False)
                    gaps, _ = tree.query(queries[inside], distance_upper_bound=WIDER * gap)
                    near[row] = (gaps <= gap).any()

    run([(large,) for large in np.unique(pairs[:, 1]).tolist()], search, n_jobs)
    return near
