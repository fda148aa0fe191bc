"""Points that no region reached, and the regions whose planes claim them."""

import numpy as np

from sklearn_mcmd.planes._chunks import run
from sklearn_mcmd.planes._explaining import ExplainLimits, explain
from sklearn_mcmd.segmentation._graph import COMPILE_FROM, CUTOFF

__all__ = ["Claims"]

MAX_ROUNDS = 50
# Neighbors looked at at once: what they need stays in the processor's cache.
CHUNK = 30_000
# Of planes that claim a point the nearest does, in units of their limits.
NEAREST = ExplainLimits(likely=False)


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
        limit, reach = CUTOFF * planes.scale, planes.radius
        if rules.max_distance is not None:
            limit = np.full(n, float(rules.max_distance))
        if rules.max_gap is not None:
            reach = np.full(n, float(rules.max_gap))
        self.planes = planes._replace(scale=limit, radius=reach)

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
        large = np.append(sizes > self.index.n_neighbors, False)
        owner = self._owners(labels, rows, self.index.query_own(rows), large[labels])
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
        usable, fresh = claiming[labels], np.zeros(len(labels), dtype=bool)
        rest = asked = np.flatnonzero(labels < 0)
        around = neighbors = self.index.query_own(rest)
        for _ in range(MAX_ROUNDS):
            owner = self._owners(labels, asked, neighbors, usable)
            claimed = owner >= 0
            if not claimed.any():
                break
            new = asked[claimed]
            labels[new], usable[new] = owner[claimed], True
            left = np.flatnonzero(labels[rest] < 0)
            rest, around = rest[left], around.take(left)
            # Only those beside the new ones have new answers.
            fresh[new] = True
            beside = np.flatnonzero(fresh[around.indices].any(axis=1))
            fresh[new] = False
            asked, neighbors = rest[beside], around.take(beside)
        return labels

    def _owners(self, labels, rows, around, usable):
        """Label of the neighbor, one of the usable, whose plane claims each of the rows, or -1."""
        owner = np.full(len(rows), -1, dtype=labels.dtype)
        compiled = len(labels) >= COMPILE_FROM

        def task(part):
            queries, m = self.index.points[rows[part]], len(rows[part])
            found, share = explain(
                queries, around.take(part), self.planes, NEAREST, usable,
                np.zeros(m), np.full(m, np.inf), compiled,
            )  # fmt: skip
            owner[part] = np.where(share <= 1, labels[found], -1)

        self._each_part(len(rows), task)
        return owner

    def _each_part(self, m, task):
        step = max(1, CHUNK // self.index.n_neighbors)
        run([(slice(start, start + step),) for start in range(0, m, step)], task, self.n_jobs)
