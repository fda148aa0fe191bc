"""Density: where points lie sparser than the surfaces around, and what keeps company there."""

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

__all__ = ["Company", "DenseSpacing", "group_sizes", "sample_rows"]

# The surroundings of a point: so many points, or a share of small clouds, thinned to SAMPLE.
WINDOW, WINDOW_SHARE = 2048, 1 / 16
SAMPLE = 64
DENSE = 0.1  # quantile of the spacing that stands for the dense part of the surroundings
LINKS = 12
COMPANIONS = 8
# Rejected points whose own spacing is below so many times that of surfaces are an object's, if
# they fill a ball, next to what is explained; ...
COMPANY = 2.5
# ... at most below so many times if they are thin or flat, ...
COMPANY_OF_THIN = 4.0
# ... but not within so many spacings of explained points: there the tails of noise are as flat.
BESIDE = 1.5
# Product of the axes over the longest one, of some 100 points in a ball (in three dimensions); and
# the least to be told from that of a face, which noise and chance give some depth.
BALL, FLAT = 0.77, 0.1
# Members of groups looked at at once: what bounds the memory.
CHUNK = 200_000
MANTISSA, MIXER = np.uint64(2**52 - 1), np.uint64(0x9E3779B97F4A7C15)


class DenseSpacing:
    """Spacing of the dense part of the surroundings, far wider than a neighborhood.

    The sheets that mixed pixels make, and uniform outliers where they are among themselves,
    are as dense as their neighbors: what is sparse shows only against the surfaces around.

    Parameters
    ----------
    points : ndarray of float64 of shape (n, d)
        Distinct.
    spacing : ndarray of shape (n,)
    """

    def __init__(self, points, spacing):
        window = min(WINDOW, int(WINDOW_SHARE * len(points)))
        stride = max(1, window // SAMPLE)
        rows = sample_rows(points, stride)
        sample, values = points[rows], spacing[rows]
        self.tree = cKDTree(sample)
        n_near = min(SAMPLE, len(sample))
        _, near = self.tree.query(sample, n_near)
        position = int(DENSE * n_near)
        near = values[near.reshape(len(sample), n_near)]
        self.values = np.partition(near, position, axis=1)[:, position]

    def around(self, queries):
        """Dense spacing around queries (m, d)."""
        return self.values[self.tree.query(queries)[1]]


class Company:
    """Rejected points among themselves: what is dense and many is an object, not outliers.

    Foliage, thin objects, strips of surface and what stands out of one have no plane that explains
    them, but they lie together nearly as densely as surfaces do. Outliers don't, or in small
    groups; only where they are many, as in the sheets of mixed pixels behind edges, chance brings
    them as close. But they scatter to all sides, away from what is explained. So the rounder the
    group is, and the farther from explained points, the closer its points have to be.

    Parameters
    ----------
    points : ndarray of shape (n, d)
        The rejected.
    n_neighbors : int
        Of the neighborhoods whose spacing company is compared with.
    n_group : int
        Size of the group whose shape is seen, the least that may be an object.
    alone : ndarray of bool of shape (n,)
        Who belongs to a small group, which is no company.
    """

    def __init__(self, points, n_neighbors, n_group, alone):
        n, d = points.shape
        self.points, self.alone = points, alone
        self.n_near = COMPANIONS + 1
        self.n_group = min(max(n_group, self.n_near), n)
        self.tree = cKDTree(points) if n > self.n_near else None
        # From the mean distance of k points of a surface to that of a few.
        self.per_neighborhood = (COMPANIONS / n_neighbors) ** (1 / (d - 1))

    def isolation(self, queries, usual_spacing, gaps):
        """How far queries (m, d) are from having company, up to 1 they have: (m,).

        Parameters
        ----------
        queries : ndarray of shape (m, d)
        usual_spacing : ndarray of shape (m,)
            Of the surfaces around.
        gaps : ndarray of shape (m,)
            Distance of the nearest retained point.
        """
        if self.tree is None:
            return np.full(len(queries), np.inf)
        distances, near = self.tree.query(queries, self.n_near)
        step = self.per_neighborhood * usual_spacing
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            spacing, gaps = distances[:, 1:].mean(axis=1) / step, gaps / step
            limit = np.where(gaps <= BESIDE, COMPANY, COMPANY_OF_THIN)
            isolation = spacing / limit
        isolation[self.alone[near[:, 0]] | np.isnan(isolation)] = np.inf
        rows = np.flatnonzero(isolation <= 1)
        at_once = max(1, CHUNK // self.n_group)
        for part in (rows[i : i + at_once] for i in range(0, len(rows), at_once)):
            _, group = self.tree.query(queries[part], self.n_group)
            fullness = _fullness(self.points[group])
            stricter = np.sqrt(fullness * np.sqrt(np.maximum(gaps[part], 1.0)))
            # A root, so that what no plane explains ranks above most of what one does, kept or not.
            isolation[part] = (spacing[part] * stricter / COMPANY) ** 0.25
        return isolation


def _fullness(groups):
    """How much of a ball around them groups of points (m, k, d) fill: a ball 1, thin ones less."""
    deviations = groups - groups.mean(axis=1, keepdims=True)
    squares = np.linalg.eigvalsh(deviations.swapaxes(1, 2) @ deviations)
    axes = np.sqrt(np.maximum(squares, 0.0) / squares[:, -1:])
    return np.maximum(axes.prod(axis=1), FLAT) / BALL


def group_sizes(points, rows, neighbors, compiled):
    """Size of the group of each of some points, of those that are near neighbors mutually.

    Parameters
    ----------
    points : ndarray of float64 of shape (n, d)
    rows : ndarray of int of shape (m,)
        The points that are neighbors of each other.
    neighbors : ndarray of int of shape (n, k)
        Rows, nearest first, the point itself before the others.
    compiled : bool

    Returns
    -------
    sizes : ndarray of int of shape (m,)
    """
    n_links = min(LINKS, neighbors.shape[1] - 1)
    if compiled:
        from sklearn_mcmd.outliers._groups_numba import label_groups

        labels = np.zeros(len(points), dtype=np.int64)
        label_groups(points, rows, neighbors, n_links, labels)
    else:
        others = neighbors[rows, 1 : n_links + 1]
        distances = np.linalg.norm(points[others] - points[rows][:, None], axis=2)
        reach = np.zeros(len(points))
        reach[rows] = distances[:, -1]
        mutual = distances <= reach[others]
        links = np.repeat(rows, mutual.sum(axis=1)), others[mutual]
        ones = np.ones(len(links[0]), dtype=np.int8)
        graph = coo_array((ones, links), shape=(len(points), len(points)))
        labels = connected_components(graph, directed=False)[1]
    return np.bincount(labels[rows], minlength=1)[labels[rows]]


def sample_rows(points, stride):
    """About one in `stride` points, by a hash of the coordinates.

    So the sample depends neither on the order of rows nor on a unit that is a power of two.
    """
    mixed = np.zeros(len(points), dtype=np.uint64)
    for column in points.T:
        mantissa = np.ascontiguousarray(column).view(np.uint64) & MANTISSA
        mixed = (mixed ^ mantissa) * MIXER
        mixed ^= mixed >> np.uint64(29)
    rows = np.flatnonzero((mixed * MIXER >> np.uint64(33)) % np.uint64(stride) == 0)
    return rows if len(rows) >= SAMPLE else np.arange(len(points))
