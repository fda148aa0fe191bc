"""Planes on which neighbors agree, on disk: a sweep over the cells for each pass."""

from functools import partial

import numpy as np

from sklearn_mcmd.planes._agreement import AgreementLimits, Offers, offer
from sklearn_mcmd.planes._base import mends_planes
from sklearn_mcmd.planes._record import Planes
from sklearn_mcmd.runtime._chunks import each_slice

COLUMNS = {
    **dict.fromkeys(("centroids", "normals"), (np.float64, (3,))),
    **{"scale": (np.float64, ()), "asks": (bool, ())},
}


def offer_steps(estimator):
    """The steps of `find_offers`, as of `Sweeps`."""
    return [f"offers{n}" for n in range(AgreementLimits().passes)] * mends_planes(estimator)


def find_offers(sweep, job):
    """Fill the columns that `stored_offers` opens; ``sweep(name, work)`` visits all cells."""
    whole, steps = job.whole(), offer_steps(job.estimator)
    for before, step in zip([None, *steps], steps, strict=False):
        whole.make(**{f"{step}_{name}": kind for name, kind in COLUMNS.items()})
        sweep(step, partial(_offer, step=step, before=before))
        if before is not None:
            remove_offers(whole, before)


def stored_offers(whole, step, private=False):
    """The `Offers` of a step; None where these are not found or no longer needed."""
    if not whole.has(f"{step}_asks"):
        return None
    known = {name: whole.open(f"{step}_{name}", private=private) for name in COLUMNS}
    asks = known.pop("asks")
    return Offers(Planes.empty(0, 3)._replace(**known), asks)


def remove_offers(whole, *steps):
    """Free the disk of what nobody asks for any more."""
    whole.remove(*(f"{step}_{name}" for step in steps for name in COLUMNS))


def each_part(rows, model, work, n_threads):
    """Call ``work(part)`` with the parts of a slice, as long as a model fits at once."""

    def task(part):
        work(slice(rows.start + part.start, rows.start + part.stop))

    each_slice(rows.stop - rows.start, model.chunk(), task, n_threads)


def _offer(cell, job, step, before):
    """Fill what the places of a cell offer."""
    model, whole = job.model(), job.whole()
    own, offers = whole.rows(cell), stored_offers(whole, step, private=True)
    before = None if before is None else stored_offers(whole, before)
    each_part(own, model, partial(offer, model, offers, before), job.n_threads)
    found = {**offers.planes._asdict(), "asks": offers.asks}
    whole.put(cell, **{f"{step}_{name}": found[name][own] for name in COLUMNS})
    whole.columns.finish(cell, step)
