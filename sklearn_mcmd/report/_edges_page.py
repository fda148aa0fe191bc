"""What a report says about edges."""

import numpy as np

from sklearn_mcmd.report._contents import Contents, note_if, share
from sklearn_mcmd.report._maps import fullest_cells, marked_maps

MANY = 0.4  # share of edge points, of areas and not of lines; machined parts have a third


def edges_contents(shown, criterion, n, limit, more_rows):
    """The contents of a report of `mcmd edges`, of whose points `n` are of edges.

    What is shown has ``edge`` and ``edge_score``. The limit is of scores; None is the least value
    of an edge. `more_rows` follow in the table of results.
    """
    n_all, xyz, near = shown.n_all, shown.xyz, shown.near
    is_edge = shown.cloud.attributes["edge"] > 0
    if limit is None:
        values = shown.cloud.attributes["edge_score"].astype(np.float64)
        limit = values[is_edge].min(initial=values.max())
    what = "distance from a crease, in spacings" if criterion == "crease" else criterion
    return Contents(
        shown,
        headline=f"{share(n, n_all, 'lie')} on edges.",
        results=[
            ("edge points", share(n, n_all)),
            (f"limit of {what}", f"{limit:.3g}"),
            *more_rows,
        ],
        maps=marked_maps(xyz, is_edge, near, "edge point"),
        tables=fullest_cells(xyz, is_edge, near, "edge points"),
        notes=_notes(n, n_all),
        checks="edges that are areas, no edges",
        output=f"{n_all:,} points{shown.files}, with edge and edge_score",
    )


def _notes(n, n_all):
    """Warnings of no edges, or of edges that are areas."""
    return note_if(
        n == 0,
        "No edges.",
        "No point lies on an edge: there are none, they are blunter than --min-angle, or the "
        "neighborhoods do not see two faces.",
        "Give a smaller --min-angle or more --n-neighbors.",
    ) + note_if(
        n > MANY * n_all,
        "Edges that are areas.",
        f"{share(n, n_all, 'lie')} on edges. Lines take few points: these are things as narrow as "
        "a neighborhood, foliage, or noise.",
        "Denoise the cloud first, or give a smaller --threshold or a larger --min-angle.",
    )
