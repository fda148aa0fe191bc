"""Proof that results of a part of a cloud are those of the whole cloud.

A part is all points of a box. A neighborhood found in it is that of the whole cloud if it does not
reach the border of the box. A result may also depend on the planes of the neighbors, and these on
those of their neighbors: then all of these neighborhoods must be proved.
"""

import numpy as np

from sklearn_mcmd.planes._around import extents
from sklearn_mcmd.planes._chunks import each_slice

__all__ = ["SLACK", "proved_points", "reaches", "to_border"]

# Distances are computed with rounding errors, of about 1e-16 of their size.
SLACK = 1.0 + 1e-12


def to_border(points, low, high):
    """Distances (m,) of points (m, d) in a box from its border; inf where it has none."""
    return np.minimum(points - low, high - points).min(axis=1)


def reaches(index, n_jobs=None):
    """Distances (m,) up to which the neighborhoods of an index's points depend on the cloud."""
    reach = np.empty(len(index.points))

    def measure(rows):
        points, around = index.points[rows], index.query_own(rows)
        _, reach[rows] = extents(index.points, points, around)
        if index.radius is not None:  # no member was wanted beyond the radius
            few = around.sizes < index.n_neighbors
            reach[rows][few] = np.maximum(reach[rows][few], index.radius)

    each_slice(len(reach), index.chunk, measure, n_jobs)
    reach *= SLACK
    return reach


def proved_points(index, exact, levels, n_jobs=None):
    """Which results do not depend on points outside a box: bool (m,), of the index's points.

    Parameters
    ----------
    index : NeighborIndex
        Of all points of a cloud in the box, and maybe of others.
    exact : ndarray of bool of shape (m,)
        Whose neighborhood does not reach the border of the box.
    levels : int
        Levels of neighbors that a result depends on; 0 is the point's own neighborhood.
    n_jobs : int, default=None
    """
    proved = exact

    def prove(rows):
        proved[rows] = before[index.query_own(rows).indices].all(axis=1)

    for _ in range(levels):
        before, proved = proved, np.empty_like(exact)
        each_slice(len(exact), index.chunk, prove, n_jobs)
    return proved
