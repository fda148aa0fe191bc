"""Groups of points: which are flat, how far they stand off, and how deep below ground they lie."""

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from sklearn_mcmd.outliers._surfaces import SurfaceLimits
from sklearn_mcmd.planes._around import ratio

AT_ONCE = 100_000  # points whose nearest are asked for at once; it limits the memory


def are_flat_groups(points, group, flat):
    """Which groups are flat. The deviation off the plane has as many degrees of freedom as points
    beyond those that a plane needs, and counts with its standard error: few are flat by chance."""
    order = np.lexsort(points.T[::-1])
    sizes = np.bincount(group)
    spare = sizes - points.shape[1]
    deviations = _deviations(points[order], group[order], sizes, spare > 0)
    spare = np.maximum(spare, 1)
    off = deviations[:, 0] * np.sqrt(sizes / spare) * (1 + 1 / np.sqrt(2 * spare))
    return (deviations[:, -1] > 0) & (flat * off <= deviations[:, -1])


def gaps_of_groups(group, gaps):
    """The least of the gaps of the points of each group."""
    least = np.full(group.max(initial=-1) + 1, np.inf)
    np.minimum.at(least, group, gaps)
    return least


def separation_of_groups(points, group, usual, gaps):
    """Gap of each group over the size of the group, by the usual spacing around each point and its
    gap to the nearest that is real. Sums are taken in the order of coordinates, so they do not
    depend on that of the points."""
    order = np.lexsort(points.T[::-1])
    return separation_of_sorted(points[order], group[order], usual[order], gaps[order])


def separation_of_sorted(points, group, usual, gaps):
    """The same of points whose order is settled."""
    sizes = np.bincount(group)
    size = np.bincount(group, usual) / sizes
    size = np.maximum(size, _deviations(points, group, sizes, sizes > 1)[:, -1])
    return ratio(gaps_of_groups(group, gaps), size)


def _deviations(points, group, sizes, asked):
    """Standard deviations of groups along their axes, ascending; 0 of those that are not asked."""
    d = points.shape[1]
    covariance = np.zeros((len(sizes), d, d))
    centers = np.stack([np.bincount(group, points[:, i]) / sizes for i in range(d)], axis=1)
    away = points - centers[group]
    for i in range(d):
        for j in range(i + 1):
            covariance[:, i, j] = np.bincount(group, away[:, i] * away[:, j]) / sizes
    deviations = np.zeros((len(sizes), d))
    deviations[asked] = np.sqrt(np.maximum(np.linalg.eigvalsh(covariance[asked]), 0.0))
    return deviations


def depths_of_groups(xyz, ground, candidates):
    """How deep below ground the group of each candidate lies, in units of the group's size.

    A point is below ground if it is lower than the three ground points nearest in plan by more than
    these are away in plan. Points below ground are linked to those of their nearest neighbors that
    are closer than the ground is above them. What is linked is a group. Its depth is that of its
    highest point. Its size is the standard deviation along its longest axis, as of the detector's
    groups, but no less than the distance in plan to the third nearest ground point.

    `ground` is a `Ground`, and `candidates` a mask of the points. What is not below ground has 0.
    """
    away, near = ground.nearest(xyz)
    depth, away = near.min(axis=1) - xyz[:, 2], away[:, -1]
    rows = np.flatnonzero(candidates & (depth > away))
    result = np.zeros(len(xyz))
    result[rows] = group_depths(xyz[rows], depth[rows], away[rows])
    return result


def group_depths(points, depth, away):
    """The same of all points (n, 3) below ground: by so much, `depth`, and so far from the third
    nearest ground point in plan, `away`."""
    result = np.empty(len(points))
    if len(points):
        order = np.lexsort(points.T)
        points, depth, away = points[order], depth[order], away[order]
        group = connected_components(_links(points, depth), directed=False)[1]
        result[order] = separation_of_sorted(points, group, away, depth)[group]
    return result


def _links(points, depth):
    """The graph of points and those of their nearest that are closer than the ground is above.

    Points have as many nearest as those of surfaces: of fewer a group may fall apart.
    """
    tree, n = cKDTree(points, balanced_tree=False), len(points)
    near = np.arange(1, min(SurfaceLimits().n_links, n) + 1)
    links = []
    for first in range(0, n, AT_ONCE):
        some = slice(first, first + AT_ONCE)
        distances, others = tree.query(points[some], near)
        own, column = np.nonzero(distances < depth[some, None])
        links.append(np.stack([first + own, others[own, column]]).astype(np.int32))
    own, others = np.concatenate(links, axis=1)
    return coo_array((np.ones(len(own), bool), (own, others)), shape=(n, n))
