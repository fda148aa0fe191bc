"""Small cells of regions, gathered of neighbors, and how they are joined to patches."""

from typing import NamedTuple

import numpy as np

from sklearn_mcmd.planes._around import quantile_around, ratio
from sklearn_mcmd.planes._indexed_cloud import distinct_numbers
from sklearn_mcmd.runtime._chunks import each_slice, slices
from sklearn_mcmd.runtime._compiling import compiled_function
from sklearn_mcmd.segmentation._graph import HEIGHT_BITS, GrowthLimits, n_linked
from sklearn_mcmd.segmentation._region_sums import median_by_region, region_moments

UPPER = [0, 1, 2, 4, 5, 8]  # places of the six numbers of a symmetric matrix in its nine
ROWS = 2**14  # whose neighbors are looked at at once; it limits the memory


class Sums(NamedTuple):
    """What is known of cells, or of patches, in units of noise; scatters are the upper halves."""

    sizes: np.ndarray
    weights: np.ndarray
    means: np.ndarray  # (m, 3)
    scatters: np.ndarray  # (m, 6)


class Cells(NamedTuple):
    """The cells of the regions of n points, the flattest first."""

    of: np.ndarray  # (n,), int32, the cell of each point; -1 for none
    rows: np.ndarray  # of the points, cell after cell, at first that at which the cell begins
    ends: np.ndarray  # (m + 1,), where the rows of each cell begin, and where the last end
    beside: np.ndarray  # pairs (p, 2) of cells of one region with points that are neighbors

    @classmethod
    def gathered(cls, labels, order, index, size, n_jobs=None):
        """Each of the points in order begins a cell, if it has none, of those among its nearest
        `size` that are of its region and have none."""
        n = len(labels)
        near, starts = np.empty((n, size), np.int32), size * np.arange(n + 1)

        def find(rows):
            near[rows] = index.query_own(rows, size).indices

        each_slice(n, index.chunk, find, n_jobs)
        of, begins = gathered(order, starts, near.ravel(), labels)
        around, pairs = near[begins], []
        in_cell = of[around] == np.arange(len(begins))[:, None]
        for rows in slices(n, ROWS):
            both = np.broadcast_arrays(of[rows, None], of[near[rows]])
            one_region = (labels[near[rows]] == labels[rows, None]) & (labels[rows, None] >= 0)
            pairs.append(once(np.column_stack([cells[one_region] for cells in both])))
        ends = np.append(0, np.cumsum(in_cell.sum(axis=1)))
        return cls(of, around[in_cell], ends, once(np.concatenate(pairs)))

    @property
    def begins(self):
        """The points at which the cells begin."""
        return self.rows[self.ends[:-1]]

    def members(self, cells):
        """The rows of some cells, one cell after the other, and how many each has."""
        sizes = np.diff(self.ends)[cells]
        gaps = self.ends[cells] - np.cumsum(sizes) + sizes
        return self.rows[np.repeat(gaps, sizes) + np.arange(sizes.sum())], sizes

    def sums(self, points, noise, unit):
        """The `Sums` of the cells of points, whose noise, in units, is given."""
        m = len(self.ends) - 1
        of, low = np.repeat(np.arange(m, dtype=np.int32), np.diff(self.ends)), points.min(axis=0)
        sizes, centroids, covariances = region_moments(points[self.rows], of, m)
        weights = sizes / np.square(median_by_region(noise[self.rows], of, m))
        return Sums(
            sizes=sizes,
            weights=weights,
            means=(centroids - low) / unit,
            scatters=covariances.reshape(-1, 9)[:, UPPER] * (weights / unit**2)[:, None],
        )


def gathered(order, starts, near, labels):
    """The group, int32 (n,), of each node, -1 for none, and the node at which each group begins.

    Of the nodes in order, each that no group has begins one, of all in its list that have its label
    and no group. The list of node i is near[starts[i] : starts[i + 1]].
    """
    group, begins = np.full(len(labels), -1, np.int32), np.empty(len(order), np.int64)
    n = _compiled("gather")(order, starts, near, labels, group, begins)
    return group, begins[:n]


def usual_noise(index, planes, rules, n_jobs=None):
    """Standard deviation (n,) that is usual around each point."""
    noise, limits = np.empty(len(index.points)), GrowthLimits()
    bend = limits.bent * np.arccos(min(rules.min_cosine, 1.0))

    def measure(rows):
        around = index.query_own(rows, n_linked(index, rules))
        usual = quantile_around(planes.scale, around, limits.usual)
        noise[rows] = np.hypot(usual, bend * planes.radius[rows])

    each_slice(len(noise), index.chunk, measure, n_jobs)
    return noise


def flattest_first(rows, points, scale, noise):
    """Some rows, the flattest first. Their order depends on no rounding error, and on no rows.

    `scale` and `noise` (n,) are those of planes and what is usual around them.
    """
    flatness = np.rint(np.ldexp(ratio(scale[rows], noise[rows]), HEIGHT_BITS))
    return rows[np.lexsort((*points[rows].T, flatness))]


def once(pairs):
    """Pairs (p, 2) of different numbers, each once and both ways, in ascending order."""
    pairs = pairs[pairs[:, 0] != pairs[:, 1]].astype(np.int64)
    keys = distinct_numbers(pairs << 32 | pairs[:, ::-1])
    return np.column_stack([keys >> 32, keys & (2**32 - 1)])


def joined(sums, beside):
    """Cells joined to patches, see `join_cells`: the patch (m,) of each, numbered in the order of
    their first cells, and the `Sums` of patches. Pairs of cells are `beside` each other."""
    m, sums = len(sums.sizes), Sums._make(np.array(values, order="C") for values in sums)
    left, turn, root = np.empty(m), np.zeros(m, np.int64), np.arange(m)
    edges = beside[beside[:, 0] < beside[:, 1]]
    _compiled("join_cells")(sums, edges, left, turn, root)
    first, patch = np.unique(root, return_inverse=True)
    return patch, Sums._make(values[first] for values in sums)


def _compiled(name):
    return compiled_function("segmentation._regions_numba", name)
