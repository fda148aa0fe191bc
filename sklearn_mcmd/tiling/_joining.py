"""Connected parts of a graph across cells: parts of each cell, joined by the links between cells.

A part within one cell is complete unless a link leads out of it. So only the parts at borders are
joined, whose number is small against that of points.
"""

from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

__all__ = ["Parts", "join_parts", "parts_of_cell"]


class Parts(NamedTuple):
    """Connected parts of one cell.

    labels : ndarray of int32 of shape (n,)
        Of each row; -1 of one that is no part.
    sizes : ndarray of shape (n_parts,)
    links : ndarray of int64 of shape (n_links, 3)
        Links to other cells: the part, the other cell, and the row there.
    """

    labels: np.ndarray
    sizes: np.ndarray
    links: np.ndarray


def parts_of_cell(labels, weights, rows, cells, other_rows):
    """The `Parts` of labels that may have gaps.

    Parameters
    ----------
    labels : ndarray of int of shape (n,)
        -1 of rows that are no part.
    weights : ndarray of shape (n,)
        What a row adds to the size of its part.
    rows, cells, other_rows : ndarray of int of shape (n_links,)
        Own rows with a link to another cell, and that cell and the row there.
    """
    some = labels >= 0
    labels, weights = labels.astype(np.int32), weights[some]
    _, numbers = np.unique(labels[some], return_inverse=True)
    labels[some] = numbers
    links = np.unique(np.stack([labels[rows], cells, other_rows], axis=1).astype(np.int64), axis=0)
    return Parts(labels, np.bincount(numbers, weights), links.reshape(-1, 3))


def join_parts(columns, n_cells, name, least=0.0):
    """Join the parts of all cells, which lie in the columns `name`_labels, _sizes and _links.

    Writes the column `name`_whole, sizes of parts with what belongs to them in other cells, and
    `name`_others, of wholes in several cells that are smaller than `least`: the own part, another
    cell, the part there, and the number of the whole.

    Returns
    -------
    largest : float
        Size of the largest part.
    """
    sizes = [columns.read(cell, f"{name}_sizes") for cell in range(n_cells)]
    starts = np.cumsum([0, *map(len, sizes)])
    pairs = [np.empty((0, 2), np.int64)]
    for cell in range(n_cells):
        links = columns.read(cell, f"{name}_links")
        for other in np.unique(links[:, 1]):
            own, _, rows = links[links[:, 1] == other].T
            there = columns.read(other, f"{name}_labels", mmap=True)[rows]
            joined = np.stack([starts[cell] + own, starts[other] + there], axis=1)
            pairs.append(np.unique(joined, axis=0))
    nodes, ends = np.unique(np.vstack(pairs), return_inverse=True)
    ends = ends.reshape(-1, 2)
    shape = (len(nodes), len(nodes))
    graph = coo_array((np.ones(len(ends), np.int8), (ends[:, 0], ends[:, 1])), shape=shape)
    n_wholes, whole_of = connected_components(graph, directed=False) if len(nodes) else (0, nodes)
    sizes = np.concatenate(sizes)
    total = np.bincount(whole_of, sizes[nodes], minlength=n_wholes)
    sizes[nodes] = total[whole_of]
    others = _others(nodes, whole_of, total < least, starts)
    for cell in range(n_cells):
        whole = sizes[starts[cell] : starts[cell + 1]]
        some = others[others[:, 0] == cell, 1:]
        columns.write(cell, **{f"{name}_whole": whole, f"{name}_others": some})
    return float(sizes.max(initial=0))


def _others(nodes, whole_of, small, starts):
    """Pairs of parts of one small whole: cell, part, other cell, part there, and the whole."""
    order = np.argsort(whole_of, kind="stable")
    ends = np.cumsum(np.bincount(whole_of, minlength=len(small)))
    cells = np.searchsorted(starts, nodes, side="right") - 1
    parts = nodes - starts[cells]
    pairs = [np.empty((0, 5), np.int64)]
    for whole in np.flatnonzero(small):
        members = order[ends[whole - 1] if whole else 0 : ends[whole]]
        one, other = (m.ravel() for m in np.meshgrid(members, members))
        one, other = one[one != other], other[one != other]
        same = np.full(len(one), whole)
        pairs.append(np.stack([cells[one], parts[one], cells[other], parts[other], same], axis=1))
    return np.vstack(pairs)
