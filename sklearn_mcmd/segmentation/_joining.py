"""Planes of regions, and the joining of regions that are parts of one plane."""

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from sklearn_mcmd.planes._chunks import run

__all__ = ["MOST_NOISE", "join_coplanar", "median_by_region", "region_planes"]

# Largest ratio of two root mean squares that count as equal. A region is flat if the distances from
# its plane are at most this many times the noise of its neighborhoods. Another region lies in that
# plane if they are at most as many times the noise of the quieter of the two: noise of a curved one
# contains its bend.
MOST_NOISE = 1.5
# Parts are joined over a gap of at most this share of the smaller one's length.
MOST_GAP = 0.5
# Rounding error of a least eigenvalue, as a share of the largest one.
ROUNDING = 16 * np.finfo(np.float64).eps
# Number of regions whose pairs are tried at once; it limits the memory.
CHUNK = 256
# Medians of smaller regions are sought together: each by itself would take longer. And one point
# in so many is asked first whether a region is near.
FEW = 128


def region_planes(points, labels, n_regions, weights=None, n_jobs=None):
    """Sizes, centroids, covariances and principal axes of regions.

    Parameters
    ----------
    points : ndarray of shape (n, d)
    labels : ndarray of int of shape (n,)
        Points of label -1 belong to none.
    n_regions : int
    weights : ndarray of shape (n,), default=None
        Copies of each point.
    n_jobs : int, default=None

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
    labels, columns = labels[inside], np.empty((d, len(inside)))
    weights = np.ones(len(inside)) if weights is None else weights[inside].astype(float)
    share = _grouping(labels, n_regions, weights)
    sizes = share.sum(axis=1)
    divisor = np.maximum(sizes, 1.0)
    centroids, covariances = np.zeros((d, n_regions)), np.empty((n_regions, d, d))

    def center(i):
        columns[i] = points[inside, i]
        for _ in range(2):  # twice, because the first mean of large coordinates is rounded
            mean = (share @ columns[i]) / divisor
            centroids[i] += mean
            columns[i] -= mean[labels]

    def multiply(i, j):
        moment = (share @ (columns[i] * columns[j])) / divisor
        covariances[:, i, j] = covariances[:, j, i] = moment

    run([(i,) for i in range(d)], center, n_jobs)
    run([(i, j) for i in range(d) for j in range(i + 1)], multiply, n_jobs)
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
    inside = np.flatnonzero(labels >= 0)
    groups = _grouping(labels[inside], n_regions)
    values, first, sizes = (
        values[inside[groups.indices]],
        groups.indptr[:-1],
        np.diff(groups.indptr),
    )
    middle, medians = sizes // 2, np.empty(n_regions)
    few = sizes < FEW
    for region in np.flatnonzero(~few).tolist():
        own = values[first[region] : first[region] + sizes[region]]
        medians[region] = np.partition(own, middle[region])[middle[region]]
    region = np.repeat(np.flatnonzero(few), sizes[few])
    own = values[np.repeat(few, sizes)]
    order = np.lexsort((own, region))
    medians[few] = own[order[np.cumsum(sizes[few]) - sizes[few] + middle[few]]]
    return medians


def join_coplanar(points, labels, noise, n_jobs=None):
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
    n_jobs : int, default=None

    Returns
    -------
    labels : ndarray of int of shape (n,)
        A joined region has the number of its first part.
    """
    n_regions = int(labels.max(initial=-1)) + 1
    if n_regions < 2:
        return labels
    planes = region_planes(points, labels, n_regions, n_jobs=n_jobs)[:3]
    scale = median_by_region(noise, labels, n_regions)
    inside = np.flatnonzero(labels >= 0)
    members = inside[_grouping(labels[inside], n_regions).indices]
    whole = np.arange(n_regions)  # the joined region to which each region belongs
    while True:  # each round joins at least two parts
        pairs, most = _pairs_in_a_plane(*planes, scale, n_jobs)
        if len(pairs) > 0:
            ends = np.searchsorted(whole[labels[members]], np.arange(len(scale) + 1))
            pairs = pairs[_near(points, members, ends, pairs, most, n_jobs)]
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


def _pairs_in_a_plane(sizes, centroids, covariances, scale, n_jobs=None):
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
    parts = [slice(start, start + CHUNK) for start in range(0, len(flat), CHUNK)]
    found = [np.empty((0, 2), dtype=int)] * (len(parts) + 1)

    def search(place, rows):
        apart = centroids[None] - centroids[rows][:, None]
        normal = normals[rows]
        heights = np.einsum("rsd,rd->rs", apart, normal)
        tilted = np.einsum("sde,rd,re->rs", covariances, normal, normal, optimize=True)
        limit = (MOST_NOISE * np.minimum(scale[None], scale[rows][:, None])) ** 2
        limit += np.maximum(rounding[None], rounding[rows][:, None])
        candidate = heights**2 + tilted <= limit
        candidate &= rank[None] < rank[rows][:, None]
        r, s = np.nonzero(candidate)
        # This is a lower bound of the gap: no point is farther from its centroid than the length.
        beyond = np.linalg.norm(apart[r, s], axis=-1) - reach[rows][r] - reach[s]
        near = beyond <= MOST_GAP * reach[s]
        found[place] = np.column_stack([flat[s[near]], flat[rows][r[near]]])

    run(list(enumerate(parts, 1)), search, n_jobs)
    return np.concatenate(found), MOST_GAP * length


def _near(points, members, ends, pairs, most, n_jobs=None):
    """Whether the gap between the regions of each pair is small enough for the first region."""

    def part(region):
        return points[members[ends[region] : ends[region + 1]]]

    parts = {region: part(region) for region in np.unique(pairs).tolist()}
    near = np.zeros(len(pairs), dtype=bool)

    def search(large):
        own, tree = parts[large], None
        low, high = own.min(axis=0), own.max(axis=0)
        rounding = ROUNDING * np.maximum(np.abs(low), np.abs(high))
        for row in np.flatnonzero(pairs[:, 1] == large).tolist():
            small = pairs[row, 0]
            queries, reach = parts[small], (1 + ROUNDING) * most[small] + rounding
            for axis in range(points.shape[1]):  # those beyond the box are too far away
                column = queries[:, axis]
                inside = (column >= low[axis] - reach[axis]) & (column <= high[axis] + reach[axis])
                queries = queries if inside.all() else queries[inside]
            if len(queries) == 0:
                continue
            tree = cKDTree(own, balanced_tree=False) if tree is None else tree
            for some in (queries[::FEW], queries):  # a few mostly tell
                gaps, _ = tree.query(some, distance_upper_bound=most[small])
                near[row] = np.isfinite(gaps).any()
                if near[row]:
                    break

    run([(large,) for large in np.unique(pairs[:, 1]).tolist()], search, n_jobs)
    return near


def _grouping(labels, n_regions, weights=None):
    """Sparse matrix (n_regions, n) of weights, 1 by default; `indices` are the rows by region.

    It sorts by counting; the rows of a region keep their order.
    """
    n = len(labels)
    weights = np.ones(n) if weights is None else weights
    return coo_array((weights, (labels, np.arange(n))), shape=(n_regions, n)).tocsr()
