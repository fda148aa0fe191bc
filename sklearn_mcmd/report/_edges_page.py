"""What a report says about edges."""

import numpy as np

from sklearn_mcmd.report._contents import note_if, share
from sklearn_mcmd.report._histogram import histogram
from sklearn_mcmd.report._maps import found_maps, fullest_cells
from sklearn_mcmd.report._rendering import paragraph

MANY = 0.4  # share of edge points, of areas and not of lines; machined parts have a third


def edges_contents(shown, criterion, n, limit, cards):
    """The contents of a report of `mcmd edges`, of whose points `n` are of edges.

    What is shown has ``edge`` and ``edge_score``. The limit is of scores; None is the least value
    of an edge. `cards` are what else is known.
    """
    is_crease, n_all, xyz, near = criterion == "crease", shown.n_all, shown.xyz, shown.near
    found = shown.cloud.attributes["edge"] > 0
    values = shown.cloud.attributes["edge_score"].astype(np.float64)
    if limit is None:
        limit = values[found].min(initial=values.max())
    name = "distance to the nearest crease, in spacings" if is_crease else criterion
    limit_name = "limit, in spacings" if is_crease else f"limit of {criterion}"
    drawn = histogram(values, cutoff=limit, cutoff_name="limit", above=not is_crease, name=name)
    words = "Points farther than 20 spacings from all creases have the score 20. " * is_crease
    words += "Edges are counted in points and not in lengths, which sampling alone would change."
    return shown.contents(
        headline=f"{share(n, n_all, 'lie')} on edges.",
        cards=[(f"{limit:.3g}", limit_name), *cards],
        notes=_notes(n, n_all),
        checks="edges that are areas, no edges",
        sections=[
            ("Where the edges are", found_maps(xyz, found, near, "edge point")),
            ("Scores", drawn + paragraph(words, "soft")),
            ("Places", fullest_cells(xyz, found, near, "edge points")),
        ],
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
