"""One graph: which neighbors have planes that explain each other, and what hangs together so."""

from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from sklearn_mcmd.planes._chunks import each_slice
from sklearn_mcmd.planes._compiling import compiled_function

__all__ = ["LinkLimits", "connected", "link_planes"]

# Neighbors a task: what bounds the memory.
CHUNK = 200_000


class LinkLimits(NamedTuple):
    """When two points are linked.

    min_cosine : float
        Least cosine of the angle between their normals, whatever the signs of these.
    explained : float
        A plane explains a point within so many of its standard deviations.
    max_gap : float
        Largest distance between the points, in their units.
    mutual : bool
        Whether each plane must explain the other's point. Otherwise that of the point whose
        neighbors are asked must explain the neighbor.
    both_near : bool
        Whether each must be among the other's neighbors. Otherwise one among the other's suffices,
        and the link stands in the row of that other one only.
    """

    min_cosine: float
    explained: float = 3.0
    max_gap: float = np.inf
    mutual: bool = True
    both_near: bool = False


def link_planes(points, neighbors, planes, limits, usable, compiled, n_jobs=None):
    """Link each point to those of its neighbors whose planes and its own explain each other.

    Parameters
    ----------
    points : ndarray of float64 of shape (n, d)
    neighbors : Neighborhoods
        Of each of the points, with or without itself.
    planes : Planes
        The plane of each of the points: centroid, normal and scale are asked for. One of a negative
        scale explains nothing.
    limits : LinkLimits
    usable : ndarray of bool of shape (n,)
        Points that may be linked.
    compiled : bool
        Whether to use compiled code, if Numba is there; the links are the same.
    n_jobs : int, default=None

    Returns
    -------
    links : ndarray of int32 of shape (n, width)
        The neighbors linked, in the order of `neighbors`, then -1. The point itself is none.
    """
    n, k = neighbors.indices.shape
    links = np.empty((n, k), np.int32)
    own = LinkLimits(*map(float, limits[:3]), *map(bool, limits[3:]))
    link = (_compiled("link_rows") if compiled else None) or _link_rows

    def task(rows):
        link(points, neighbors, planes, own, usable, rows.start, links[rows])

    each_slice(n, max(1, CHUNK // max(k, 1)), task, n_jobs)
    return links


def connected(links, compiled):
    """Connected parts of a graph; a link in one direction is one in both.

    Parameters
    ----------
    links : ndarray of int32 of shape (n, width)
        As by `link_planes`.
    compiled : bool
        Whether to use compiled code, if Numba is there; the parts are the same.

    Returns
    -------
    labels : ndarray of int32 of shape (n,)
        Part of each point, from 0 on in the order of their first points. Which points are one
        part does not depend on the order of points or links.
    sizes : ndarray of int of shape (n_parts,)
    """
    label = _compiled("label_parts") if compiled else None
    if label is not None:
        labels = label(links)
    else:
        n = len(links)
        rows, columns = np.nonzero(links >= 0)
        ones = np.ones(len(rows), dtype=np.int8)
        graph = coo_array((ones, (rows, links[rows, columns])), shape=(n, n))
        labels = connected_components(graph, directed=False)[1]
    return labels, np.bincount(labels)


def _link_rows(points, neighbors, planes, limits, usable, start, links):
    """Any dimension, one chunk: fill the links of the points from row `start` on."""
    rows = np.arange(start, start + len(links))
    near = neighbors.indices[rows]
    gaps = points[near] - points[rows][:, None]
    fits = neighbors.take(rows).valid & (near != rows[:, None])
    fits &= usable[rows][:, None] & usable[near]
    fits &= np.sqrt(np.square(gaps).sum(axis=-1)) <= limits.max_gap
    own, other = planes.normals[rows][:, None], planes.normals[near]
    fits &= np.abs((other * own).sum(axis=-1)) >= limits.min_cosine
    height = ((points[near] - planes.centroids[rows][:, None]) * own).sum(axis=-1)
    fits &= np.abs(height) <= limits.explained * planes.scale[rows][:, None]
    if limits.mutual:
        height = ((points[rows][:, None] - planes.centroids[near]) * other).sum(axis=-1)
        fits &= np.abs(height) <= limits.explained * planes.scale[near]
    if limits.both_near:
        fits &= (neighbors.indices[near] == rows[:, None, None]).any(axis=-1)
    found = np.where(fits, near, -1)
    links[:] = np.take_along_axis(found, np.argsort(~fits, axis=1, kind="stable"), axis=1)


def _compiled(name):
    return compiled_function("planes._linking_numba", name)
