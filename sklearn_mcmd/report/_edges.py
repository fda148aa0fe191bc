"""What a report says about edges."""

import numpy as np

from sklearn_mcmd.io._point_cloud import with_results
from sklearn_mcmd.report._contents import Contents, Note, Section, percent, share
from sklearn_mcmd.report._facts import Facts
from sklearn_mcmd.report._histogram import histogram
from sklearn_mcmd.report._html import paragraph
from sklearn_mcmd.report._maps import found_maps
from sklearn_mcmd.report._notes import CHECKS, cloud_notes
from sklearn_mcmd.report._places import Places, place_sections

__all__ = ["edge_notes", "edges_contents", "score_words"]

# Share of edge points from which on lines have become areas. A line in a cloud of 50,000 points
# takes one in a hundred; machined parts with many edges have a third.
MANY = 0.4


def edges_contents(cloud, detector):
    """The contents of a report of `mcmd edges`.

    Parameters
    ----------
    cloud : PointCloud
        As it was read.
    detector : SharpFeatureDetector
        Fitted to it.
    """
    is_crease = detector.criterion == "crease"
    found = detector.scores_ < detector.offset_
    values, limit = detector.scores_, float(detector.offset_)
    if not is_crease:
        values, limit = -values, -limit
    n, n_all = int(np.count_nonzero(found)), len(cloud)
    kept = detector.inlier_mask_
    estimator = detector.normal_estimator_
    scales = getattr(estimator, "plane_scale_", None)
    facts = Facts.of(cloud.xyz, detector.n_neighbors, scales)
    places = Places.of(cloud.xyz, found, facts.near)
    n_outliers = int(np.count_nonzero(~kept))
    name = "distance to the nearest crease, in spacings" if is_crease else detector.criterion
    limit_name = "limit, in spacings" if is_crease else f"limit of {detector.criterion}"
    sections = [
        Section("Where the edges are", found_maps(cloud.xyz, found, facts.near, "edge points")),
        Section(
            "Scores",
            histogram(values, cutoff=limit, cutoff_name="limit", above=not is_crease, name=name)
            + score_words(is_crease),
        ),
        Section("Places", place_sections(places, cloud.xyz, found, facts.near, "edge points")),
    ]
    return Contents(
        headline=f"{share(n, n_all)} lie on edges.",
        cards=[
            (f"{n_all:,}", "points"),
            (f"{n:,}", f"edge points, {percent(n, n_all)}"),
            (f"{limit:.3g}", limit_name),
            (f"{n_outliers:,}", "outliers that were left out"),
        ],
        notes=edge_notes(n, n_all) + cloud_notes(facts),
        checks=f"edges that are areas, no edges, {CHECKS}",
        sections=sections,
        cloud_rows=facts.rows(cloud),
        output=f"{n_all:,} points, with edge and edge_score",
        shown=with_results(
            cloud, {"edge": found.astype(np.uint8), "edge_score": values.astype(np.float32)}
        ),
    )


def score_words(is_crease):
    """What to know of scores and counts."""
    words = "Points farther than 20 spacings from all creases have the score 20. " * is_crease
    words += "Edges are counted in points and not in lengths, which sampling alone would change."
    return paragraph(words, "soft")


def edge_notes(n, n_all):
    """Warnings of no edges, or of edges that are areas."""
    if n == 0:
        return [
            Note(
                "No edges.",
                "No point lies on an edge: there are none, they are blunter than --min-angle, or "
                "the neighborhoods do not see two faces.",
                "Give a smaller --min-angle or more --n-neighbors.",
            )
        ]
    if n <= MANY * n_all:
        return []
    return [
        Note(
            "Edges that are areas.",
            f"{share(n, n_all)} lie on edges. Lines take few points, so these are things as narrow "
            "as a neighborhood, foliage, or noise.",
            "Denoise the cloud first, or give a smaller --threshold or a larger --min-angle.",
        )
    ]
