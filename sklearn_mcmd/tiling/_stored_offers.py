"""Planes of all places on disk: those on which neighbors agree, pass by pass, then the final ones.

Each place has one plane. A sweep reads those of the sweep before and keeps what it changes beside
them; when all cells are done, `settle` puts it in place.
"""

from functools import partial

from sklearn_mcmd.planes._agreement import AgreementLimits, Offers, offer
from sklearn_mcmd.planes._base import mends_planes
from sklearn_mcmd.planes._record import Planes
from sklearn_mcmd.runtime._chunks import each_slice

VECTOR = float, 3  # a row of three coordinates
FACES = {"centroids": VECTOR, "normals": VECTOR, "scale": float}
OLD = "offers_"  # before the names of faces that are kept for new points


def offer_steps(estimator):
    """The steps of `find_offers`, as of `Sweeps`."""
    return [f"offers{n}" for n in range(AgreementLimits().passes)] * mends_planes(estimator)


def find_offers(sweep, job):
    """Fill `FACES`, and asks, with the `Offers`; ``sweep(name, work)`` visits all cells."""
    whole, before = job.whole(), False
    for step in offer_steps(job.estimator):
        whole.make(asks=bool, **FACES)
        sweep(step, partial(_offer, before=before))
        if before:
            sweep(f"{step}-settled", settle)
        before = True


def settle(cell, job):
    """Put into `FACES` what a cell has changed of them in a sweep, which all cells have done."""
    whole = job.whole()
    if whole.columns.path(cell, "changes").exists():  # else an earlier run has put it there
        faces = {name: whole.open(name, private=True) for name in FACES}
        whole.changed(cell, **faces)
        whole.put(cell, **{name: values[whole.rows(cell)] for name, values in faces.items()})
        whole.columns.drop(cell, "changes")


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


def _offer(cell, job, before):
    """Find what the places of a cell offer."""
    model, whole = job.model(), job.whole()
    own, offers = whole.rows(cell), stored_offers(whole, private=True)
    known = model.offers if before else None
    each_part(own, model, partial(offer, model, offers, known), job.n_threads)
    faces = {name: getattr(offers.planes, name)[own] for name in FACES}
    if before:
        return whole.change(cell, **faces)
    return {"asks": offers.asks[own], **faces}
