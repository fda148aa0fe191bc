"""Points that no region reached, and the regions whose planes claim them."""

import numpy as np

from sklearn_mcmd.planes._chunks import run
from sklearn_mcmd.segmentation._graph import CUTOFF

__all__ = ["Claims"]

MAX_ROUNDS = 50
# Shares of a limit are equal if they are to so many digits.
DIGITS = 6
# Neighbors looked at at once: what bounds the memory.
CHUNK = 200_000


class Claims:
    """The planes of all points, and which points they claim.

    A plane claims a point that is within `CUTOFF` standard deviations of it and not farther
    from the plane's own point than that one's neighbors are.

    Parameters
    ----------
    index : NeighborIndex
    planes : Planes
    rules : GrowthRules
        A `max_distance` takes the place of the standard deviations, a `max_gap` that of the radii.
    n_jobs : int, default=None
    """

    def __init__(self, index, planes, rules, n_jobs=None):
        n = len(index.points)
        self.index, self.n_jobs = index, n_jobs
        self.normals, self.centroids = planes.normals, planes.centroids
        self.limit, self.reach = CUTOFF * planes.scale, planes.radius
        if rules.max_distance is not None:
            self.limit = np.full(n, float(rules.max_distance))
        if rules.max_gap is not None:
            self.reach = np.full(n, float(rules.max_gap))

    def absorb_fragments(self, labels):
        """Give fragments to the region whose planes claim most of their points.

        A fragment is a region no larger than a neighborhood: its normals come from points of
        other surfaces as well.

        Parameters
        ----------
        labels : ndarray of int of shape (n,)

        Returns
        -------
        labels : ndarray of int of shape (n,)
        """
        sizes = np.bincount(labels[labels >= 0])
        fragment = np.append(sizes <= self.index.n_neighbors, False)  # the last is -1
        rows = np.flatnonzero(fragment[labels])
        if rows.size == 0:
            return labels
        neighbors, shares = self._claimants(rows)
        foreign = (labels[neighbors] >= 0) & ~fragment[labels[neighbors]]
        owner = _owners(labels, neighbors, np.where(foreign, shares, np.inf))
        rows, owner = rows[owner >= 0], owner[owner >= 0]
        pairs, counts = np.unique(
            np.column_stack([labels[rows], owner]), axis=0, return_counts=True
        )
        most = 2 * counts > sizes[pairs[:, 0]]
        number = np.arange(len(sizes) + 1)
        number[-1] = -1
        number[pairs[most, 0]] = pairs[most, 1]
        return number[labels]

    def assign_rest(self, labels, content=()):
        """Give points without a region to that of the neighbor whose plane is nearest.

        Points claimed in one round may claim others in the next: the outcome depends on no
        order.

        Parameters
        ----------
        labels : ndarray of int of shape (n,)
            -1 for points without a region.
        content : ndarray of int, default=()
            Labels of regions that have all their points, and claim none.

        Returns
        -------
        labels : ndarray of int of shape (n,)
        """
        labels = labels.copy()
        claiming = np.append(np.ones(int(labels.max(initial=-1)) + 1, dtype=bool), False)
        claiming[np.asarray(content, dtype=np.intp)] = False
        rest = np.flatnonzero(labels < 0)
        neighbors, shares = self._claimants(rest)
        for _ in range(MAX_ROUNDS):
            owner = _owners(
                labels, neighbors, np.where(claiming[labels[neighbors]], shares, np.inf)
            )
            claimed = owner >= 0
            if not claimed.any():
                break
            labels[rest[claimed]] = owner[claimed]
            rest, neighbors, shares = rest[~claimed], neighbors[~claimed], shares[~claimed]
        return labels

    def _claimants(self, rows):
        """Neighbors of rows, and each one's distance as a share of its limit; inf beyond."""
        n, k = len(rows), self.index.n_neighbors
        neighbors, shares = np.empty((n, k), dtype=np.int32), np.empty((n, k))
        step = max(1, CHUNK // k)
        parts = [(slice(start, start + step),) for start in range(0, n, step)]

        def task(part):
            neighbors[part], shares[part] = self._claimants_of_chunk(rows[part])

        run(parts, task, self.n_jobs)
        return neighbors, shares

    def _claimants_of_chunk(self, rows):
        points, k = self.index.points, self.index.n_neighbors
        distances, neighbors = self.index.tree.query(points[rows], k=k)
        distances, neighbors = distances.reshape(-1, k), neighbors.reshape(-1, k)
        heights = np.zeros(distances.shape)
        for axis in range(points.shape[1]):
            gaps = points[rows, axis][:, None] - self.centroids[neighbors, axis]
            heights += gaps * self.normals[neighbors, axis]
        limit = self.limit[neighbors]
        heights = np.abs(heights, out=heights)
        usable = (heights <= limit) & (distances <= self.reach[neighbors])
        shares = np.divide(heights, limit, out=np.zeros_like(heights), where=heights > 0)
        # Planes through the same point are the same but for rounding: the nearer neighbor's counts.
        shares = np.round(shares, DIGITS)
        return neighbors, np.where(usable, shares, np.inf)


def _owners(labels, neighbors, shares):
    """Label of the neighbor of the least share for each row; -1 where all are inf."""
    if len(neighbors) == 0:
        return np.empty(0, dtype=labels.dtype)
    best = shares.argmin(axis=1)
    each = np.arange(len(best))
    return np.where(np.isfinite(shares[each, best]), labels[neighbors[each, best]], -1)
