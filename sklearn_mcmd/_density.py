"""Density: where points lie sparser than the surfaces around, and what keeps company there."""

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

__all__ = ["Company", "DenseSpacing", "group_sizes"]

# The surroundings of a point: so many points, or a share of small clouds, thinned to SAMPLE.
WINDOW, WINDOW_SHARE = 2048, 1 / 16
SAMPLE = 64
DENSE = 0.1  # quantile of the spacing that stands for the dense part of the surroundings
LINKS = 12
COMPANIONS = 8


class DenseSpacing:
    """Spacing of the dense part of the surroundings, far wider than a neighborhood.

    The sheets that mixed pixels make, and uniform outliers where they are among themselves,
    are as dense as their neighbors: what is sparse shows only against the surfaces around.

    Parameters
    ----------
    points : ndarray of shape (n, d)
        Distinct, in spatial order.
    spacing : ndarray of shape (n,)
    """

    def __init__(self, points, spacing):
        window = min(WINDOW, int(WINDOW_SHARE * len(points)))
        stride = max(1, window // SAMPLE)
        sample, values = points[::stride], spacing[::stride]
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

    Foliage, thin objects and what stands out of a surface have no plane that explains them,
    but they lie together as densely as surfaces do. Outliers don't, or in small groups.

    Parameters
    ----------
    points : ndarray of shape (n, d)
        The rejected.
    n_neighbors : int
        Of the neighborhoods whose spacing company is compared with.
    alone : ndarray of bool of shape (n,)
        Who belongs to a small group, which is no company.
    """

    def __init__(self, points, n_neighbors, alone):
        n, d = points.shape
        self.alone = alone
        self.n_near = COMPANIONS + 1
        self.tree = cKDTree(points) if n > self.n_near else None
        # From the mean distance of k points of a surface to that of a few.
        self.per_neighborhood = (COMPANIONS / n_neighbors) ** (1 / (d - 1))

    def isolation(self, queries, usual_spacing):
        """Spacing among the rejected over the usual spacing of surfaces: (m,)."""
        if self.tree is None:
            return np.full(len(queries), np.inf)
        distances, near = self.tree.query(queries, self.n_near)
        spacing = distances[:, 1:].mean(axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            isolation = spacing / (self.per_neighborhood * usual_spacing)
        isolation[self.alone[near[:, 0]] | np.isnan(isolation)] = np.inf
        return isolation


def group_sizes(points, tree=None):
    """Size of the group of each point, of those linked by being near neighbors mutually."""
    tree = cKDTree(points) if tree is None else tree
    n, n_links = len(points), min(LINKS, len(points) - 1)
    distances, others = tree.query(points, n_links + 1)
    distances, others = distances[:, 1:], others[:, 1:]
    mutual = distances <= distances[:, -1][others]
    rows = np.repeat(np.arange(n, dtype=np.int32), mutual.sum(axis=1))
    ones = np.ones(len(rows), dtype=np.int8)
    graph = coo_array((ones, (rows, others[mutual])), shape=(n, n))
    _, labels = connected_components(graph, directed=False)
    return np.bincount(labels)[labels]
