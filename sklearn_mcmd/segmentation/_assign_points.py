"""Points that no region reached, and the regions whose planes claim them."""

import numpy as np

from sklearn_mcmd.planes._explaining import ExplainLimits, explain
from sklearn_mcmd.runtime._chunks import slices
from sklearn_mcmd.segmentation._graph import answers_of
from sklearn_mcmd.segmentation._region_sums import n_regions_of, region_sizes

CHUNK = 30_000  # neighbors looked at at once: what they need stays in the processor's cache


class Claims:
    """Gives points to the regions whose planes claim them.

    A plane claims a point that it explains and that is not farther from the plane's own point than
    that one's neighbors are. A `max_distance` of the rules takes the place of three standard
    deviations, a `max_gap` that of the radii.
    """

    def __init__(self, index, planes, rules, n_jobs=None):
        self.index, self.n_jobs = index, n_jobs
        scale, radius, self.cutoff = planes.scale, planes.radius, ExplainLimits().explained
        if rules.max_distance is not None:
            scale, self.cutoff = np.full_like(scale, rules.max_distance), 1.0
        if rules.max_gap is not None:
            radius = np.full_like(radius, rules.max_gap)
        self.planes = planes._replace(scale=scale, radius=radius)

    def absorb_fragments(self, labels):
        """Give regions no larger than a neighborhood, whose normals come from points of others as
        well, to the region whose planes claim most of their points: new labels."""
        sizes = region_sizes(labels, n_regions_of(labels))
        small = np.append(sizes <= self.index.n_neighbors, False)  # the last is -1
        rows = np.flatnonzero(small[labels])
        owner = self._owners(labels, rows, ~small[labels] & (labels >= 0))
        claimed = np.column_stack([labels[rows], owner])[owner >= 0]
        pairs, counts = np.unique(claimed, axis=0, return_counts=True)
        pairs = pairs[2 * counts > sizes[pairs[:, 0]]]
        number = np.append(np.arange(len(sizes), dtype=np.int32), np.int32(-1))
        number[pairs[:, 0]] = pairs[:, 1]
        return number[labels]

    def assign_unlabeled(self, labels, content=()):
        """Give points without a region, -1, to that of the neighbor whose plane is nearest: labels,
        changed.

        Points claimed in one round may claim others in the next: the outcome depends on no order.
        Regions whose labels are `content` have all their points, and claim none.
        """
        usable = (labels >= 0) & ~np.isin(labels, content)
        unlabeled = asked = np.flatnonzero(labels < 0)
        fresh = np.zeros(len(labels), dtype=bool)
        while len(asked):
            owner = self._owners(labels, asked, usable)
            claimed = asked[owner >= 0]
            labels[claimed], usable[claimed] = owner[owner >= 0], True
            unlabeled, fresh[claimed] = unlabeled[labels[unlabeled] < 0], True
            # Only what has a neighbor that was claimed just now can be claimed next.
            has_fresh = self._in_parts(unlabeled, lambda _, near: fresh[near.indices].any(axis=1))
            asked, fresh[claimed] = unlabeled[has_fresh], False
        return labels

    def _owners(self, labels, rows, usable):
        """The region whose plane, one of the usable, claims each of the rows, or -1."""

        def owners(rows, around):
            queries = self.index.points[rows]
            nearest, share = explain(queries, around, self.planes, usable, np.zeros(len(rows)))
            return np.where((nearest >= 0) & (share <= self.cutoff), labels[nearest], -1)

        return self._in_parts(rows, owners)

    def _in_parts(self, rows, work):
        """What ``work(rows, around)`` returns of all rows, asked in parts."""
        parts = slices(len(rows), max(1, CHUNK // self.index.n_neighbors)) or [slice(0)]

        def work_on(part):
            return work(rows[part], self.index.query_own(rows[part]))

        return np.concatenate(answers_of(work_on, parts, self.n_jobs))
