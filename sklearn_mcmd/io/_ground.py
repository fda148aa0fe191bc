"""Heights over the ground, where points have the class ground."""

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from sklearn_mcmd.io._classes import GROUND, classes_of, ground_in
from sklearn_mcmd.io._point_cloud import PointFileError

__all__ = ["depths_of_groups", "ground_of", "heights_over_ground"]

CORNERS = 3  # of a triangle of ground points, as of the ground's triangulation
# Nearest points that a point of a group may be linked to, as in surfaces. With fewer a group may
# fall apart, and its parts are smaller than it.
LINKED = 16


def ground_of(cloud):
    """A mask of the points of the ground; those that are marked withheld are none.

    Raises
    ------
    PointFileError
        If there is no ground.
    """
    classes_of(cloud)
    ground = ground_in(cloud)
    if np.count_nonzero(ground) < CORNERS:
        raise PointFileError(
            f"heights over the ground are asked for, and fewer than {CORNERS} points have the "
            f"class {GROUND} (ground)"
        )
    return ground


def heights_over_ground(xyz, ground):
    """Height of each point over the mean of the three ground points that are nearest in plan.

    Parameters
    ----------
    xyz : ndarray of shape (n, 3)
    ground : ndarray of bool of shape (n,)

    Returns
    -------
    ndarray of shape (n,)
    """
    _, near = _nearest_in_plan(xyz, ground)
    return xyz[:, 2] - near.mean(axis=1)


def depths_of_groups(xyz, ground, candidates):
    """How deep below ground the group of each candidate lies, in units of the group's size.

    A point is below ground if it is lower than the three ground points nearest in plan by more than
    these are away in plan. Points below ground are linked to those of their nearest neighbors that
    are closer than the ground is above them. What is linked is a group. Its depth is that of its
    highest point. Its size is the standard deviation along its longest axis, as of the detector's
    groups, but no less than the distance in plan to the third nearest ground point.

    Parameters
    ----------
    xyz : ndarray of shape (n, 3)
    ground, candidates : ndarray of bool of shape (n,)

    Returns
    -------
    ndarray of shape (n,)
        0 for what is not below ground.
    """
    away, near = _nearest_in_plan(xyz, ground)
    depth, away = near.min(axis=1) - xyz[:, 2], away[:, -1]
    rows = np.flatnonzero(candidates & ~ground & (depth > away))
    result = np.zeros(len(xyz))
    if not len(rows):
        return result
    points, depth = xyz[rows], depth[rows]
    n = len(rows)
    distances, others = cKDTree(points, balanced_tree=False).query(points, min(LINKED, n))
    distances, others = distances.reshape(n, -1), others.reshape(n, -1)
    own, column = np.nonzero(distances < depth[:, None])
    links = coo_array((np.ones(len(own), bool), (own, others[own, column])), shape=(n, n))
    n_groups, group = connected_components(links, directed=False)
    highest = np.full(n_groups, np.inf)
    np.minimum.at(highest, group, depth)
    size = np.maximum(
        _longest_deviations(points, group, n_groups),
        np.bincount(group, away[rows]) / np.bincount(group),
    )
    with np.errstate(divide="ignore"):
        result[rows] = (highest / size)[group]
    return result


def _nearest_in_plan(xyz, ground):
    """Distances in plan (n, 3) of the nearest ground points, and their heights."""
    tree = cKDTree(xyz[ground][:, :2], balanced_tree=False)
    distances, rows = tree.query(xyz[:, :2], CORNERS)
    return distances, xyz[ground, 2][rows]


def _longest_deviations(points, group, n_groups):
    """The standard deviation of each group along its longest axis."""
    counts = np.bincount(group, minlength=n_groups)
    centers = np.stack([np.bincount(group, axis) / counts for axis in points.T], axis=1)
    away = points - centers[group]
    covariance = np.empty((n_groups, 3, 3))
    for i in range(3):
        for j in range(3):
            covariance[:, i, j] = np.bincount(group, away[:, i] * away[:, j]) / counts
    return np.sqrt(np.maximum(np.linalg.eigvalsh(covariance)[:, -1], 0.0))
