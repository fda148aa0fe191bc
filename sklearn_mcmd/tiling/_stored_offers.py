"""Planes of all places on disk: those on which neighbors agree, pass by pass, then the final ones.

Each place has one plane. A sweep reads those of the sweep before and keeps what it changes beside
them; when all cells are done, `settle` puts it in place.
"""

from functools import partial

from sklearn_mcmd.planes._agreement import AgreementLimits, Offers, offers_of
from sklearn_mcmd.planes._base import mends_planes
from sklearn_mcmd.planes._record import Planes

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


def settle(cell, job, names=tuple(FACES)):
    """Put into `FACES` what a cell has changed of them in a sweep, which all cells have done."""
    whole = job.whole()
    if whole.columns.path(cell, "changes").exists():  # else an earlier run has put it there
        faces = {name: whole.rows_of(name, whole.rows(cell)) for name in names}
        whole.changed(cell, **faces)
        whole.put(cell, **faces)
        whole.columns.drop(cell, "changes")


def stored_offers(whole):
    """The `Offers` that are stored; None where these are not found or no longer needed."""
    if not whole.has("asks"):
        return None
    prefix = OLD * whole.has(f"{OLD}asks")
    known = {name: whole.open(f"{prefix}{name}") for name in FACES}
    return Offers(Planes.empty(0, 3)._replace(**known), whole.open("asks"))


def _offer(cell, job, before):
    """Find what the places of a cell offer."""
    model, whole = job.model(), job.whole()
    known = model.offers if before else None
    offers = offers_of(model, known, whole.rows(cell), job.n_threads)
    faces = {name: getattr(offers.planes, name) for name in FACES}
    return whole.change(cell, **faces) if before else {"asks": offers.asks, **faces}
