"""Parts of a graph whose points lie in cells: each cell finds its own, one step joins these."""

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from sklearn_mcmd.tiling._memory import check_parts


def write_parts(whole, cell, name, labels, pairs, known=None, **sums):
    """Write what a cell has found of its parts, of which each row has the number, `labels`.

    `pairs` (n, 2) are links from its rows to those of other cells or parts. Of each part there are
    `sums`. Only parts that are `known`, bool, or that such links leave are written; of the others
    nobody asks. A part is named by its first row in the cell, its root.
    """
    first = whole.rows(cell).start
    roots = np.empty(labels.max(initial=-1) + 1, np.int64)
    roots[labels[::-1]] = first + np.arange(len(labels))[::-1]
    written = np.ones(len(roots), bool) if known is None else known.copy()
    written[labels[pairs[:, 0] - first]] = True
    whole.put(cell, **{f"{name}_root": roots[labels]})
    out = np.unique(np.column_stack([roots[labels[pairs[:, 0] - first]], pairs[:, 1]]), axis=0)
    arrays = {"pairs": out, "roots": roots[written]}
    arrays.update((key, values[written]) for key, values in sums.items())
    whole.columns.write(cell, **{f"{name}_{key}": values for key, values in arrays.items()})


class JoinedParts:
    """The parts of all cells, joined where links lead from cell to cell; one process has all.

    It takes memory for each part and for each link between cells, not for each point.
    """

    def __init__(self, whole, cells, name, memory):
        self._whole, self._name = whole, name
        self._cells = [int(cell) for cell in np.flatnonzero(cells.counts)]
        sizes = [len(whole.columns.mapped(cell, f"{name}_roots")) for cell in self._cells]
        n_pairs = sum(len(whole.columns.mapped(cell, f"{name}_pairs")) for cell in self._cells)
        check_parts(sum(sizes), n_pairs, memory)
        written, pairs = self._read("roots"), self._read("pairs")
        linked = self._roots_of(pairs[:, 1])
        # A part that only another cell links to is one row, and was not written.
        self.roots = np.union1d(written, linked)
        self._written = np.searchsorted(self.roots, written)
        self._join(np.searchsorted(self.roots, [pairs[:, 0], linked]))

    def _join(self, ends):
        shape = (len(self.roots),) * 2
        graph = coo_array((np.ones(ends.shape[1], bool), ends), shape=shape)
        self.n, self.labels = connected_components(graph, directed=False)

    def total(self, name):
        """The sum of each joined part; a part that was not written counts as 1."""
        values = np.ones(len(self.roots))
        values[self._written] = self._read(name)
        return np.bincount(self.labels, values, self.n)

    def one(self):
        """A row of each joined part."""
        one = np.empty(self.n, np.int64)
        one[self.labels[::-1]] = self.roots[::-1]
        return one

    def each_cell(self):
        """Each cell with the joined parts of its rows, -1 of those of which nobody asks."""
        known, labels = np.append(self.roots, -1), np.append(self.labels, -1)
        for cell in self._cells:
            roots = self._roots_of(self._whole.rows(cell))
            at = np.searchsorted(self.roots, roots)
            yield cell, np.where(known[at] == roots, labels[at], -1)

    def rows(self, chosen):
        """The rows of the chosen parts, bool, ascending, and their parts."""
        rows, parts = [np.empty(0, np.int64)], [np.empty(0, np.int64)]
        for cell, labels in self.each_cell():
            own = np.flatnonzero((labels >= 0) & np.append(chosen, False)[labels])
            rows.append(self._whole.rows(cell).start + own)
            parts.append(labels[own])
        return np.concatenate(rows), np.concatenate(parts)

    def _read(self, name):
        return self._whole.columns.gather(self._cells, f"{self._name}_{name}")

    def _roots_of(self, rows):
        return self._whole.rows_of(f"{self._name}_root", rows)
