"""Points that no region reached, and the regions whose planes claim them."""

import numpy as np

from sklearn_mcmd.planes._explaining import ExplainLimits, explain
from sklearn_mcmd.runtime._chunks import run, slices
from sklearn_mcmd.segmentation._region_sums import region_sizes, relabeled, rows_of

CHUNK = 30_000  # neighbors looked at at once: what they need stays in the processor's cache
KEPT = 16_000_000  # more neighbors than these are not kept from round to round


class Claims:
    """The planes of all points, and which points they claim.

    A plane claims a point that it explains and that is not farther from the plane's own point than
    that one's neighbors are. A `max_distance` of the rules takes the place of three standard
    deviations, a `max_gap` that of the radii.
    """

    def __init__(self, index, planes, rules, n_jobs=None):
        n = len(index.points)
        self.index, self.n_jobs = index, n_jobs
        scale, reach, self.cutoff = planes.scale, planes.radius, ExplainLimits().explained
        if rules.max_distance is not None:
            scale, self.cutoff = index.empty(n), 1.0
            scale[:] = rules.max_distance
        if rules.max_gap is not None:
            reach = index.empty(n)
            reach[:] = rules.max_gap
        self.planes = planes._replace(scale=scale, radius=reach)

    def absorb_fragments(self, labels):
        """Give regions no larger than a neighborhood, whose normals come from points of others as
        well, to the region whose planes claim most of their points: labels, changed."""
        sizes = region_sizes(labels, int(labels.max(initial=-1)) + 1).astype(np.int64)
        fragment = np.append(sizes <= self.index.n_neighbors, False)  # the last is -1
        rows = rows_of(labels, fragment)
        if rows.size == 0:
            return labels
        large = np.append(sizes > self.index.n_neighbors, False)
        owner = self._owners(labels, rows, _Around(self.index, rows), large[labels])
        rows, owner = rows[owner >= 0], owner[owner >= 0]
        claimed = np.column_stack([labels[rows], owner])
        pairs, counts = np.unique(claimed, axis=0, return_counts=True)
        most = 2 * counts > sizes[pairs[:, 0]]
        number = np.arange(len(sizes) + 1)
        number[-1] = -1
        number[pairs[most, 0]] = pairs[most, 1]
        return relabeled(labels, number)

    def assign_unlabeled(self, labels, content=()):
        """Give points without a region, -1, to that of the neighbor whose plane is nearest: labels,
        changed.

        Points claimed in one round may claim others in the next: the outcome depends on no order.
        Regions whose labels are `content` have all their points, and claim none.
        """
        claiming = np.append(np.ones(int(labels.max(initial=-1)) + 1, dtype=bool), False)
        claiming[np.asarray(content, dtype=np.intp)] = False
        usable, fresh = claiming[labels], np.zeros(len(labels), dtype=bool)
        rest = asked = rows_of(labels, np.append(np.zeros(len(claiming) - 1, dtype=bool), True))
        around = neighbors = _Around(self.index, rest)
        while True:  # each round claims a point
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
            beside = around.beside(fresh)
            fresh[new] = False
            asked, neighbors = rest[beside], around.take(beside)
        return labels

    def _owners(self, labels, rows, around, usable):
        """Label of the neighbor, one of the usable, whose plane claims each of the rows, or -1."""
        owner = np.full(len(rows), -1, dtype=labels.dtype)

        def task(part):
            queries, floor = self.index.points[rows[part]], np.zeros(len(rows[part]))
            found, share = explain(queries, around.of(part), self.planes, usable, floor)
            owner[part] = np.where((found >= 0) & (share <= self.cutoff), labels[found], -1)

        step = max(1, CHUNK // self.index.n_neighbors)
        run([(part,) for part in slices(len(rows), step)], task, self.n_jobs)
        return owner


class _Around:
    """Neighborhoods of rows, which are kept if they are few, else asked for again."""

    def __init__(self, index, rows, found=None):
        self.index, self.rows, self.found = index, rows, found
        if found is None and len(rows) * index.n_neighbors <= KEPT:
            self.found = index.query_own(rows)

    def of(self, part):
        """The neighborhoods of a slice of the rows."""
        if self.found is None:
            return self.index.query_own(self.rows[part])
        return self.found.take(part)

    def take(self, places):
        found = None if self.found is None else self.found.take(places)
        return _Around(self.index, self.rows[places], found)

    def beside(self, chosen):
        """Places of the rows with a neighbor that is chosen."""
        places, step = [np.empty(0, np.intp)], max(1, KEPT // self.index.n_neighbors)
        for start in range(0, len(self.rows), step):
            near = self.of(slice(start, start + step)).indices
            places.append(start + np.flatnonzero(chosen[near].any(axis=1)))
        return np.concatenate(places)
