"""Links between planes that explain each other and their parts, compiled; any dimension."""

import numpy as np

from sklearn_mcmd.planes._kernels import kernel

__all__ = ["label_parts", "link_rows"]


@kernel(cache=True, error_model="numpy")
def link_rows(points, neighbors, planes, limits, usable, start, links):
    """`_link_rows` of `_linking`, one point at a time.

    Parameters
    ----------
    points : float64 (n, d)
    neighbors : Neighborhoods of all points
    planes : Planes of all points
    limits : LinkLimits
    usable : bool (n,)
    start : row of the first of the points
    links : int32 (m, width), filled
    """
    centroids, normals, scale = planes.centroids, planes.normals, planes.scale
    d = points.shape[1]
    for row in range(len(links)):
        i = start + row
        n_links = 0
        n_near = neighbors.sizes[i] if usable[i] else 0
        for a in range(n_near):
            j = neighbors.indices[i, a]
            square = cosine = height = back = 0.0
            for axis in range(d):
                gap = points[j, axis] - points[i, axis]
                square += gap * gap
                cosine += normals[i, axis] * normals[j, axis]
                height += (points[j, axis] - centroids[i, axis]) * normals[i, axis]
                back += (points[i, axis] - centroids[j, axis]) * normals[j, axis]
            fits = j != i and usable[j]
            fits &= abs(height) <= limits.explained * scale[i]
            fits &= abs(cosine) >= limits.min_cosine
            fits &= np.sqrt(square) <= limits.max_gap
            if limits.mutual:
                fits &= abs(back) <= limits.explained * scale[j]
            if fits and limits.both_near:
                fits = _has(neighbors.indices[j], neighbors.sizes[j], i)
            if fits:
                links[row, n_links] = j
                n_links += 1
        links[row, n_links:] = -1


@kernel(cache=True)
def label_parts(links):
    """Label the parts by union and find, in the order of their first points."""
    n, width = links.shape
    labels = np.arange(n).astype(np.int32)
    for i in range(n):
        for a in range(width):
            if links[i, a] < 0:
                break
            first, second = _root(labels, i), _root(labels, links[i, a])
            # The root is the first point of its part, in whatever order links are followed.
            labels[max(first, second)] = min(first, second)
    n_parts = 0
    for i in range(n):
        if labels[i] == i:
            labels[i] = n_parts
            n_parts += 1
        else:  # what it points to comes before it and has its label
            labels[i] = labels[labels[i]]
    return labels


@kernel(cache=True)
def _has(rows, size, wanted):
    found = False
    for a in range(size):
        found |= rows[a] == wanted
    return found


@kernel(cache=True)
def _root(roots, row):
    while roots[row] != row:
        roots[row] = roots[roots[row]]
        row = roots[row]
    return row
