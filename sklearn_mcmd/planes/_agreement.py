"""Planes on which neighbors agree, in place of the best that each of them drew by chance.

The plane of the best of 69 trials is one of many that are nearly as good, so that another seed
finds another one. But the points around drew their own. So each point asks its neighbors for the
planes that they have found. It keeps the one to which its neighborhood lies closest, refits it to
the members near it, and offers the result in turn. All members far off a plane count alike. Each
pass reads only what the pass before has found, so that neither order nor threads change anything. A
neighborhood that deviates from the plane of all its members by noise alone leaves nothing to
chance: it offers that plane, and does not ask.

Next to an edge less than half of a neighborhood may be of the point's own face. What is near that
face is then told by the noise that is usual around. Normals are found so. A detector asks for the
plane of a majority: faces of a few points are no surfaces.
"""

from functools import partial
from typing import NamedTuple

import numpy as np

from sklearn_mcmd.planes._record import Planes

# Fields of planes that are not offered.
UNUSED = "eigenvalues", "kept", "radius", "normal_error"


FAR = 100  # hops of neighbors, which no point is away


class AgreementLimits(NamedTuple):
    """How points ask their neighbors."""

    passes: int = 2  # times that each point asks, the last time for the plane that it keeps
    # Least share of a neighborhood that a normal's plane may be fitted to, by the noise that is
    # usual around: a face of three that meet at a corner. If less is near, the own noise tells.
    face: float = 1 / 3


class Offers(NamedTuple):
    """What the points of a cloud offer to those around them."""

    planes: Planes  # without fields that are not offered
    asks: np.ndarray  # bool (n,): whether a point asks others for planes


def agreed_offers(model, n_jobs, keep=None, hops=FAR):
    """The `Offers` of all points of a model's index before they ask for the last time.

    Those that ask are at most so many `hops` away, as of `NeighborIndex.each_asked`. ``keep``, if
    it is given, gets the rows of a slice, planes of all members, and their `QuadricFit`.
    """
    index, n = model.index, len(model.index.points)
    planes, asks = Planes.empty(*index.points.shape).without(*UNUSED), np.empty(n, dtype=bool)

    def offer(rows):
        points, around = index.points[rows], index.query_own(rows)
        first, asks[rows] = model.first_planes(points, around, keep and partial(keep, rows))
        planes.put(rows, first)

    n_passes = AgreementLimits().passes
    index.each_asked(hops + n_passes, model.chunk(), offer, n_jobs)
    for left in range(n_passes - 1, 0, -1):
        planes = _asked(model, Offers(planes, asks), hops + left, n_jobs)
    return Offers(planes, asks)


def _asked(model, offers, hops, n_jobs):
    """The planes that points have once they have asked, from what all offered before."""
    index, planes = model.index, Planes(*map(np.copy, offers.planes))

    def ask(part):
        asking = np.flatnonzero(offers.asks[part])
        if len(asking):
            rows = np.arange(len(offers.asks))[part][asking]
            around = index.query_own(part).take(asking)
            points = index.points[rows]
            robust = model.robust_planes(points, around, model.rounding, offers.planes)
            planes.put(rows, robust.planes)

    index.each_asked(hops, model.chunk(), ask, n_jobs)
    return planes
