"""Groups of points linked by being near neighbors mutually, compiled."""

import numpy as np

from sklearn_mcmd.planes._kernels import kernel

__all__ = ["label_groups"]


@kernel(cache=True)
def label_groups(points, rows, neighbors, n_links, roots):
    """Fill `roots` with a representative of the group of each of `rows`, by union and find.

    Parameters
    ----------
    points : float64 (n, d)
    rows : int (m,), the points that are neighbors of each other
    neighbors : int (n, k), rows, the point itself first
    n_links : int below k
    roots : int64 (n,)
    """
    reach = np.zeros(len(points))
    for row in rows:
        roots[row] = row
        reach[row] = _square(points, row, neighbors[row, n_links])
    for row in rows:
        for j in range(1, n_links + 1):
            other = neighbors[row, j]
            square = _square(points, row, other)
            # Links of the other to this one are found from its side.
            if square <= reach[other]:
                a, b = _root(roots, row), _root(roots, other)
                if a < b:
                    roots[b] = a
                else:
                    roots[a] = b
    for row in rows:
        roots[row] = _root(roots, row)


@kernel(cache=True)
def _square(points, i, j):
    total = 0.0
    for axis in range(points.shape[1]):
        gap = points[i, axis] - points[j, axis]
        total += gap * gap
    return total


@kernel(cache=True)
def _root(roots, row):
    while roots[row] != row:
        roots[row] = roots[roots[row]]
        row = roots[row]
    return row
