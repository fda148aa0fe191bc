"""One graph: which neighbors have planes that explain each other, and what hangs together so."""

from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from sklearn_mcmd.planes._chunks import each_slice
from sklearn_mcmd.planes._compiling import compiled_function
from sklearn_mcmd.planes._progress import progress_part

__all__ = [
    "LinkLimits",
    "connected",
    "connected_planes",
    "farthest_neighbors",
    "link_planes",
    "row_linker",
]


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
        Whether each must be as near to the other as the last of the other's neighbors. Otherwise
        one among the other's suffices, and the link stands in the row of that other one only.
    """

    min_cosine: float
    explained: float = 3.0
    max_gap: float = np.inf
    mutual: bool = True
    both_near: bool = False


def link_planes(index, k, planes, limits, usable, compiled, n_jobs=None, farthest=None):
    """Link each point to those of its neighbors whose planes and its own explain each other.

    Parameters
    ----------
    index : NeighborIndex
    k : int
        Neighbors that may be linked, the point itself among them.
    planes : Planes
        The plane of each of the points: centroid, normal and scale are asked for. One of a negative
        scale explains nothing.
    limits : LinkLimits
    usable : ndarray of bool of shape (n,)
        Points that may be linked.
    compiled : bool
        Whether to use compiled code, if Numba is there; the links are the same.
    n_jobs : int, default=None
    farthest : ndarray of shape (n,), default=None
        Distance of the last of each point's k neighbors, where the index does not know all.

    Returns
    -------
    links : ndarray of int32 of shape (n, k)
        The neighbors linked, the nearest first, then -1. The point itself is none.
    """
    n = len(index.points)
    links = np.empty((n, k), np.int32)
    link = row_linker(index, k, planes, limits, usable, compiled, n_jobs, farthest)

    def task(rows):
        link(rows, links[rows])

    each_slice(n, index.chunk, task, n_jobs)
    return links


def connected_planes(index, k, planes, limits, usable, compiled):
    """What hangs together by the links of `link_planes`, as by `connected`, in less memory."""
    join = _compiled("join") if compiled else None
    if join is None:
        return connected(link_planes(index, k, planes, limits, usable, compiled), compiled)
    roots = np.arange(len(index.points), dtype=np.int32)
    _join_planes(join, roots, index, k, planes, limits, usable)
    labels = _compiled("number_parts")(roots)
    return labels, np.bincount(labels)


def _join_planes(join, roots, index, k, planes, limits, usable):
    """Join the parts of linked rows, chunk by chunk; `roots` are those of compiled code."""
    link = row_linker(index, k, planes, limits, usable, compiled=True)
    links = np.empty((index.chunk, k), np.int32)

    def task(rows):
        part = links[: rows.stop - rows.start]
        link(rows, part)
        join(part, rows.start, roots)

    each_slice(len(roots), index.chunk, task, 1)


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
    n = len(links)
    join = _compiled("join") if compiled else None
    if join is not None:
        roots = np.arange(n, dtype=np.int32)
        join(links, 0, roots)
        labels = _compiled("number_parts")(roots)
    else:
        rows, columns = np.nonzero(links >= 0)
        ones = np.ones(len(rows), dtype=np.int8)
        graph = coo_array((ones, (rows, links[rows, columns])), shape=(n, n))
        labels = connected_components(graph, directed=False)[1]
    return labels, np.bincount(labels)


def farthest_neighbors(points, around, start, compiled):
    """Distances of the last of the neighbors `around` the points from row `start` on: (m,)."""
    farthest = np.empty(len(around.sizes))
    measure = (_compiled("farthest_of_rows") if compiled else None) or _farthest_of_rows
    measure(points, around, start, farthest)
    return farthest


def row_linker(index, k, planes, limits, usable, compiled, n_jobs=None, farthest=None):
    """A function that fills the links of a slice of rows, with the parameters of `link_planes`."""
    own = LinkLimits(*map(float, limits[:3]), *map(bool, limits[3:]))
    link = (_compiled("link_rows") if compiled else None) or _link_rows

    def measure_part(rows):
        around = index.query_own(rows, k)
        farthest[rows] = farthest_neighbors(index.points, around, rows.start, compiled)

    if farthest is None:
        farthest = np.empty(len(index.points) if own.both_near else 0)
        if own.both_near:
            with progress_part(0.0, 0.4):
                each_slice(len(farthest), index.chunk, measure_part, n_jobs)

    def fill(rows, links):
        around = index.query_own(rows, k)
        link(index.points, around, planes, own, usable, farthest, rows.start, links)

    return fill


def _farthest_of_rows(points, around, start, farthest):
    """Fill the distances of the last neighbors."""
    rows = np.arange(start, start + len(farthest))
    gaps = points[around.indices] - points[rows][:, None]
    distances = np.sqrt(np.square(gaps).sum(axis=-1))
    farthest[:] = np.where(around.valid, distances, 0.0).max(axis=1)


def _link_rows(points, around, planes, limits, usable, farthest, start, links):
    """Any dimension, one chunk: fill the links of the points from row `start` on."""
    rows = np.arange(start, start + len(links))
    near = around.indices
    gaps = points[near] - points[rows][:, None]
    distances = np.sqrt(np.square(gaps).sum(axis=-1))
    fits = around.valid & (near != rows[:, None])
    fits &= usable[rows][:, None] & usable[near]
    fits &= distances <= limits.max_gap
    own, other = planes.normals[rows][:, None], planes.normals[near]
    fits &= np.abs((other * own).sum(axis=-1)) >= limits.min_cosine
    height = ((points[near] - planes.centroids[rows][:, None]) * own).sum(axis=-1)
    fits &= np.abs(height) <= limits.explained * planes.scale[rows][:, None]
    if limits.mutual:
        height = ((points[rows][:, None] - planes.centroids[near]) * other).sum(axis=-1)
        fits &= np.abs(height) <= limits.explained * planes.scale[near]
    if limits.both_near:
        fits &= distances <= farthest[near]
    found = np.where(fits, near, -1)
    links[:] = np.take_along_axis(found, np.argsort(~fits, axis=1, kind="stable"), axis=1)


def _compiled(name):
    return compiled_function("planes._linking_numba", name)
