"""Groups of points that lie far below the ground."""

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from sklearn_mcmd.outliers._groups import separation_of_sorted
from sklearn_mcmd.outliers._surfaces import SurfaceLimits

AT_ONCE = 100_000  # points whose nearest are asked for at once; it limits the memory


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
