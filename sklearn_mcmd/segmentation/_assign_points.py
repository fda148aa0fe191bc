"""Points that no region reached, and the regions whose planes claim them."""

from dataclasses import dataclass

import numpy as np

from sklearn_mcmd.planes._explaining import ExplainLimits, explain
from sklearn_mcmd.planes._neighborhoods import NeighborIndex
from sklearn_mcmd.planes._record import Neighborhoods, Planes
from sklearn_mcmd.runtime._chunks import slices
from sklearn_mcmd.segmentation._parts import PART, Parts
from sklearn_mcmd.segmentation._region_sums import n_regions_of, region_sizes, relabeled

ROWS = 2**16  # points at once, of which some are asked who claims them
CHUNK = 30_000  # neighbors looked at at once: what they need stays in the processor's cache
SLACK = 1.0 + 1e-6  # by which planes may miss a point that is asked again whether they claim it


@dataclass(frozen=True)
class Claimants:
    """The planes of all points, and how far they claim others.

    A plane claims a point that it explains and that is not farther from the plane's own point than
    that one's neighbors are. A `max_distance` of the rules takes the place of three standard
    deviations, a `max_gap` that of the radii.
    """

    index: NeighborIndex
    planes: Planes
    max_distance: float | None
    max_gap: float | None

    @classmethod
    def of(cls, index, planes, rules):
        planes = planes.without("eigenvalues", "kept", "spacing", "normal_error")
        return cls(index, planes, rules.max_distance, rules.max_gap)

    @property
    def cutoff(self):
        """The largest share of its standard deviation at which a plane claims a point."""
        return ExplainLimits().explained if self.max_distance is None else 1.0

    def take(self, rows):
        """The planes of some rows."""
        planes = self.planes.take(rows)
        if self.max_distance is not None:
            planes.scale[:] = self.max_distance
        if self.max_gap is not None:
            planes.radius[:] = self.max_gap
        return planes

    def owners(self, queries, candidates, planes, regions, claiming):
        """The region whose plane claims each query, -1 for none, and those that are `claiming`."""
        found, share = explain(queries, candidates, planes, claiming, np.zeros(len(queries)))
        return np.where((found >= 0) & (share <= self.cutoff), regions[found], -1)


class Claims:
    """Gives points to the regions whose planes claim them."""

    def __init__(self, index, planes, rules, parts=None):
        self.known = Claimants.of(index, planes, rules)
        self.parts = parts or Parts(len(index.points))

    def absorb_fragments(self, labels):
        """Give regions no larger than a neighborhood, whose normals come from points of others as
        well, to the region whose planes claim most of their points: labels, changed."""
        sizes = region_sizes(labels, n_regions_of(labels)).astype(np.int64)
        small = sizes <= self.known.index.n_neighbors
        if not small.any():
            return labels
        known = labels, np.append(small, False), np.append(~small, False), self.known  # -1 is last
        found = self.parts.each(_count_claims, *known, size=ROWS)
        claimed, counts = map(np.concatenate, zip(*found, strict=True))
        pairs, of = np.unique(claimed, axis=0, return_inverse=True)
        most = 2 * np.bincount(of.ravel(), counts, len(pairs)) > sizes[pairs[:, 0]]
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
        claiming = np.append(np.ones(n_regions_of(labels), dtype=bool), False)
        claiming[np.asarray(content, dtype=np.intp)] = False
        found = self.parts.each(_claim, labels, claiming, self.known, size=ROWS)
        new, owner, *waiting = map(np.concatenate, zip(*found, strict=True))
        labels[new] = owner
        rows, owner = self._claim_on(labels, claiming, new, *waiting)
        labels[rows] = owner
        return labels

    def _claim_on(self, labels, claiming, new, rows, counts, near):
        """Rows that the `new` ones claim, and those that these claim in turn, and their regions.

        Each of the rows has `counts` neighbors that may claim it, `near`, one row after the other.
        """
        names, index = np.unique(near), self.known.index
        for some in slices(len(near), PART):
            near[some] = np.searchsorted(names, near[some])
        regions, owner = labels[names], np.full(len(rows), -1, np.int32)
        starts, fresh = np.cumsum(counts) - counts, np.isin(names, new)
        place = np.searchsorted(names, rows)  # of rows that may claim others
        others = np.append(names, -1)[place] != rows
        while fresh.any():  # each round claims a point
            asked = np.flatnonzero((owner < 0) & np.logical_or.reduceat(fresh[near], starts))
            for some in slices(len(asked), max(1, CHUNK // index.n_neighbors)):
                own = asked[some]
                columns = np.arange(counts[own].max())
                at = starts[own, None] + np.minimum(columns, counts[own, None] - 1)
                around = Neighborhoods(_numbered(at), counts[own].astype(np.int64))
                there = near[at].ravel()
                known = around, self.known.take(names[there]), regions[there]
                owner[own] = self.known.owners(
                    index.points[rows[own]], *known, claiming[regions[there]]
                )
            claimed = asked[(owner[asked] >= 0) & ~others[asked]]
            fresh[:] = False
            fresh[place[claimed]] = True
            regions[place[claimed]] = owner[claimed]
        return rows[owner >= 0], owner[owner >= 0]


def _numbered(values):
    """Numbers from 0 on, in the shape of some values."""
    return np.arange(values.size, dtype=np.int32).reshape(values.shape)


def _around(part, labels, wanted, known):
    """Some at a time, the rows of a part whose region is wanted, and what is around them: points,
    neighbors, their places and regions, and the planes of these."""
    rows, k = part.start + np.flatnonzero(wanted[labels[part]]), known.index.n_neighbors
    for some in slices(len(rows), max(1, CHUNK // k)):
        own = rows[some]
        around = known.index.query_own(own)
        near, places = around.indices, Neighborhoods(_numbered(around.indices), around.sizes)
        planes = known.take(near.ravel())
        yield own, known.index.points[own], near, places, labels[near.ravel()], planes


def _count_claims(part, labels, wanted, claiming, known):
    """Pairs of a wanted region and one that claims points of it, and how many."""
    pairs = [np.empty((0, 2), np.int64)]
    for rows, points, _, around, regions, planes in _around(part, labels, wanted, known):
        owner = known.owners(points, around, planes, regions, claiming[regions])
        pairs.append(np.column_stack([labels[rows], owner])[owner >= 0])
    return np.unique(np.concatenate(pairs), axis=0, return_counts=True)


def _claim(part, labels, claiming, known):
    """Rows without region that are claimed, and their regions; of others that may be in a later
    round, the rows, and how many and which neighbors may claim them."""
    found = [[np.empty(0, np.int32)] * 5]
    free = np.append(np.zeros(len(claiming) - 1, dtype=bool), True)
    for rows, points, near, around, regions, planes in _around(part, labels, free, known):
        owner = known.owners(points, around, planes, regions, claiming[regions])
        left, shape = owner < 0, near.shape
        gaps = points[:, None] - planes.centroids.reshape(*shape, -1)
        heights = np.abs(np.einsum("mkd,mkd->mk", gaps, planes.normals.reshape(gaps.shape)))
        may = heights <= SLACK * known.cutoff * planes.scale.reshape(shape)
        may &= np.sqrt(np.square(gaps).sum(axis=-1)) <= SLACK * planes.radius.reshape(shape)
        may &= (claiming | free)[regions].reshape(shape) & (near != rows[:, None])
        left &= (may & (regions.reshape(shape) < 0)).any(axis=1)
        may[~left] = False
        counts = np.count_nonzero(may[left], axis=1)
        some = rows[owner >= 0], owner[owner >= 0], rows[left], counts, near[may]
        found.append([values.astype(np.int32) for values in some])
    return tuple(map(np.concatenate, zip(*found, strict=True)))
