"""Planes of all places on disk: those on which neighbors agree, pass by pass, then the final ones.

Each place has one plane. A sweep reads those of the sweep before and keeps what it changes beside
them; when all cells are done, `StoredColumns.settle` puts it in place.
"""

from functools import partial

import numpy as np

from sklearn_mcmd.planes._agreement import AgreementLimits, Offers, offer
from sklearn_mcmd.planes._base import mends_planes
from sklearn_mcmd.planes._record import Planes
from sklearn_mcmd.runtime._chunks import each_slice

NUMBER, VECTOR = (np.float64, ()), (np.float64, (3,))
FACES = {"centroids": VECTOR, "normals": VECTOR, "scale": NUMBER}
OLD = "offers_"  # before the names of faces that are kept for new points


def offer_steps(estimator):
    """The steps of `find_offers`, as of `Sweeps`."""
    return [f"offers{n}" for n in range(AgreementLimits().passes)] * mends_planes(estimator)


def find_offers(sweep, job):
    """Fill `FACES`, and asks, with the `Offers`; ``sweep(name, work)`` visits all cells."""
    whole, before = job.whole(), False
    for step in offer_steps(job.estimator):
        whole.make(asks=(bool, ()), **FACES)
        sweep(step, partial(_offer, step=step, before=before))
        if before:
            sweep(f"{step}-settled", partial(settle, step=step))
        before = True


def settle(cell, job, step):
    """Put into `FACES` what a cell has changed of them in a step, which all cells have done."""
    job.whole().settle(cell, step, FACES)


def stored_offers(whole, private=False):
    """The `Offers` that are stored; None where these are not found or no longer needed."""
    if not whole.has("asks"):
        return None
    prefix = OLD * whole.has(f"{OLD}asks")
    known = {name: whole.open(f"{prefix}{name}", private=private) for name in FACES}
    asks = whole.open("asks", private=private)
    return Offers(Planes.empty(0, 3)._replace(**known), asks)


def each_part(rows, model, work, n_threads):
    """Call ``work(part)`` with the parts of a slice, as long as a model fits at once."""

    def task(part):
        work(slice(rows.start + part.start, rows.start + part.stop))

    each_slice(rows.stop - rows.start, model.chunk(), task, n_threads)


def _offer(cell, job, step, before):
    """Fill what the places of a cell offer."""
    model, whole = job.model(), job.whole()
    own, offers = whole.rows(cell), stored_offers(whole, private=True)
    known = model.offers if before else None
    each_part(own, model, partial(offer, model, offers, known), job.n_threads)
    faces = {name: getattr(offers.planes, name)[own] for name in FACES}
    if before:
        whole.change(cell, **faces)
    else:
        whole.put(cell, asks=offers.asks[own], **faces)
    whole.columns.finish(cell, step)
