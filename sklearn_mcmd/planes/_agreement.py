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
from sklearn_mcmd.runtime._chunks import each_part

# Fields of planes that are not offered.
UNUSED = "eigenvalues", "kept", "radius", "spacing", "normal_error"


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

    @classmethod
    def empty(cls, n, d):
        """A record to be filled."""
        return cls(Planes.empty(n, d).without(*UNUSED), np.empty(n, dtype=bool))


def agreed_offers(model, n_jobs, keep=None):
    """The `Offers` of all points of a model's index before they ask for the last time.

    ``keep(rows, *found)``, if it is given, gets what `whole_planes` of the model finds of slices.
    """
    offers, own = None, slice(0, len(model.index.points))
    for _ in range(AgreementLimits().passes):
        offers = offers_of(model, offers, own, n_jobs, keep)
    return offers


def offers_of(model, before, own, n_jobs, keep=None):
    """What a slice of points offers, from what all offered in the pass before, if any."""
    index, offers = model.index, Offers.empty(own.stop - own.start, model.index.points.shape[1])

    def offer(rows, part):
        points, around = index.points[rows], index.query_own(rows)
        if before is None:
            kept = keep and partial(keep, rows)
            planes, offers.asks[part] = model.first_planes(points, around, kept)
            return offers.planes.put(part, planes)
        offers.asks[part] = before.asks[rows]
        offers.planes.put(part, before.planes.take(rows))
        asking = np.flatnonzero(before.asks[rows])
        if len(asking):
            asked = points[asking], around.take(asking), model.rounding, before.planes
            offers.planes.put(part.start + asking, model.robust_planes(*asked)[0])

    each_part(own, model.chunk(), offer, n_jobs)
    return offers
