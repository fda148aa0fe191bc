"""Planes of regions, and the joining of regions that are parts of one plane."""

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

__all__ = ["MOST_NOISE", "join_coplanar", "median_by_region", "region_planes"]

# Largest ratio of two root mean squares that count as equal. A region is flat, and another region
# lies in its plane, if the distances are at most this many times the noise of neighborhoods.
MOST_NOISE = 1.5
# Parts are joined over a gap of at most this share of the smaller one's length.
MOST_GAP = 0.5
# Rounding error of a least eigenvalue, as a share of the largest one.
ROUNDING = 16 * np.finfo(np.float64).eps
# Number of regions whose pairs are tried at once; it limits the memory.
CHUNK = 256


def region_planes(points, labels, n_regions, weights=None):
    """Sizes, centroids, covariances and principal axes of regions.

    Parameters
    ----------
    points : ndarray of shape (n, d)
    labels : ndarray of int of shape (n,)
        Points of label -1 belong to none.
    n_regions : int
    weights : ndarray of shape (n,), default=None
        Copies of each point.

    Returns
    -------
    sizes : ndarray of shape (n_regions,)
    centroids : ndarray of shape (n_regions, d)
    covariances : ndarray of shape (n_regions, d, d)
    eigenvalues : ndarray of shape (n_regions, d), ascending
    axes : ndarray of shape (n_regions, d, d)
        As columns; the first is the normal.
    """
    d = points.shape[1]
    inside = np.flatnonzero(labels >= 0)
    labels, columns = labels[inside], points[inside].T.copy()
    weights = np.ones(len(inside)) if weights is None else weights[inside].astype(float)
    share = _grouping(labels, n_regions, weights)
    sizes = share.sum(axis=1)
    divisor = np.maximum(sizes, 1.0)
    # Center twice, because the first mean of large coordinates is rounded.
    centroids = np.zeros((d, n_regions))
    for _ in range(2):
        for i in range(d):
            mean = (share @ columns[i]) / divisor
            centroids[i] += mean
            columns[i] -= mean[labels]
    covariances = np.empty((n_regions, d, d))
    for i in range(d):
        for j in range(i + 1):
            moment = (share @ (columns[i] * columns[j])) / divisor
            covariances[:, i, j] = covariances[:, j, i] = moment
    eigenvalues, axes = np.linalg.eigh(covariances)
    return sizes, centroids.T.copy(), covariances, np.maximum(eigenvalues, 0.0), axes


def median_by_region(values, labels, n_regions):
    """Median of the values of each region; for an even number the upper one.

    Parameters
    ----------
    values : ndarray of shape (n,)
    labels : ndarray of int of shape (n,)
        Points of label -1 belong to none; each region has at least one point.
    n_regions : int

    Returns
    -------
    medians : ndarray of shape (n_regions,)
    """
    order = np.argsort(values)
    order = order[labels[order] >= 0]
    groups = _grouping(labels[order], n_regions)
    first, sizes = groups.indptr[:-1], np.diff(groups.indptr)
    return values[order[groups.indices[first + sizes // 2]]]


def join_coplanar(points, labels, noise):
    """Give one label to regions that are parts of one plane.

    A shadow, or a few bad normals, cut a wall into parts. A smaller region lies in the plane of a
    larger, flat one if the noise explains its root mean square distance to that plane. The two are
    joined if the gap between them is at most half as long as the smaller one.

    Parameters
    ----------
    points : ndarray of shape (n, d)
    labels : ndarray of int of shape (n,)
        From 0 on without gaps, -1 for none.
    noise : ndarray of shape (n,)
        Standard deviation of each neighborhood along its normal, in units of the points.

    Returns
    -------
    labels : ndarray of int of shape (n,)
        A joined region has the number of its first part.
    """
    n_regions = int(labels.max(initial=-1)) + 1
    if n_regions < 2:
        return labels
    planes = region_planes(points, labels, n_regions)[:3]
    scale = median_by_region(noise, labels, n_regions)
    inside = np.flatnonzero(labels >= 0)
    members = inside[_grouping(labels[inside], n_regions).indices]
    whole = np.arange(n_regions)  # the joined region to which each region belongs
    while True:  # each round joins at least two parts
        pairs, most = _pairs_in_a_plane(*planes, scale)
        if len(pairs) > 0:
            ends = np.searchsorted(whole[labels[members]], np.arange(len(scale) + 1))
            pairs = pairs[_near(points, members, ends, pairs, most)]
        if len(pairs) == 0:
            break
        graph = coo_array((np.ones(len(pairs)), pairs.T), shape=(len(scale), len(scale)))
        # Parts are numbered by their first region, which keeps the order of regions.
        _, part = connected_components(graph, directed=False)
        planes, scale = _pool(*planes, scale, part)
        whole = part[whole]
        members = members[np.argsort(whole[labels[members]], kind="stable")]
    return np.where(labels >= 0, whole[labels], -1)


def _pool(sizes, centroids, covariances, scale, part):
    """Sizes, centroids, covariances and scales of joined regions, from those of their parts."""
    n_parts = int(part.max()) + 1
    share = _grouping(part, n_parts, sizes)
    total = np.bincount(part, sizes, n_parts)
    # The first part is the origin, so that large coordinates cost no accuracy.
    first = np.unique(part, return_index=True)[1]
    local = centroids - centroids[first[part]]
    mean = (share @ local) / total[:, None]
    apart = local - mean[part]
    moments = covariances + apart[:, :, None] * apart[:, None, :]
    d = centroids.shape[1]
    pooled = (share @ moments.reshape(-1, d * d)) / total[:, None]
    planes = total, centroids[first] + mean, pooled.reshape(-1, d, d)
    return planes, (share @ scale) / total


def _pairs_in_a_plane(sizes, centroids, covariances, scale):
    """Pairs (smaller, larger) of regions that may be joined, and the gap that each allows."""
    eigenvalues, axes = np.linalg.eigh(covariances)
    eigenvalues, normals = np.maximum(eigenvalues, 0.0), axes[..., 0]
    # Points spread evenly over a length have its root 12th as standard deviation.
    length = np.sqrt(12 * eigenvalues[:, -1])
    rounding = ROUNDING * eigenvalues[:, -1]
    flat = eigenvalues[:, 0] <= (MOST_NOISE * scale) ** 2 + rounding
    flat &= sizes > centroids.shape[1]
    # Regions that are not flat are in no pair; a cloud of noise has very many of them.
    flat = np.flatnonzero(flat)
    rank = np.argsort(np.argsort(sizes[flat], kind="stable"), kind="stable")
    centroids, covariances, normals = centroids[flat], covariances[flat], normals[flat]
    scale, rounding, reach = scale[flat], rounding[flat], length[flat]
    found = [np.empty((0, 2), dtype=int)]
    for start in range(0, len(flat), CHUNK):
        rows = slice(start, start + CHUNK)
        apart = centroids[None] - centroids[rows][:, None]
        normal = normals[rows]
        heights = np.einsum("rsd,rd->rs", apart, normal)
        tilted = np.einsum("sde,rd,re->rs", covariances, normal, normal, optimize=True)
        limit = (MOST_NOISE * np.maximum(scale[None], scale[rows][:, None])) ** 2
        limit += np.maximum(rounding[None], rounding[rows][:, None])
        candidate = heights**2 + tilted <= limit
        candidate &= rank[None] < rank[rows][:, None]
        r, s = np.nonzero(candidate)
        # This is a lower bound of the gap: no point is farther from its centroid than the length.
        beyond = np.linalg.norm(apart[r, s], axis=-1) - reach[rows][r] - reach[s]
        near = beyond <= MOST_GAP * reach[s]
        found.append(np.column_stack([flat[s[near]], flat[rows][r[near]]]))
    return np.concatenate(found), MOST_GAP * length


def _near(points, members, ends, pairs, most):
    """Whether the gap between the regions of each pair is small enough for the first region."""

    def part(region):
        return points[members[ends[region] : ends[region + 1]]]

    trees = {}
    near = np.zeros(len(pairs), dtype=bool)
    for row, (small, large) in enumerate(pairs):
        if large not in trees:
            trees[large] = cKDTree(part(large), balanced_tree=False)
        gaps, _ = trees[large].query(part(small), distance_upper_bound=most[small])
        near[row] = np.isfinite(gaps).any()
    return near


def _grouping(labels, n_regions, weights=None):
    """Sparse matrix (n_regions, n) of weights, 1 by default; `indices` are the rows by region.

    It sorts by counting; the rows of a region keep their order.
    """
    n = len(labels)
    weights = np.ones(n) if weights is None else weights
    return coo_array((weights, (labels, np.arange(n))), shape=(n_regions, n)).tocsr()
