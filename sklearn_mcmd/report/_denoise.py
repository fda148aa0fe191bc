"""What a report says about outliers."""

import numpy as np

from sklearn_mcmd.io._point_cloud import with_results
from sklearn_mcmd.outliers._kinds import KINDS, kinds_of_outliers
from sklearn_mcmd.report._contents import Contents, Note, Section, percent, share
from sklearn_mcmd.report._facts import Facts
from sklearn_mcmd.report._histogram import histogram
from sklearn_mcmd.report._html import paragraph, table
from sklearn_mcmd.report._maps import found_maps
from sklearn_mcmd.report._notes import CHECKS, cloud_notes, together_notes
from sklearn_mcmd.report._places import Places, place_sections

__all__ = ["denoise_contents", "grade_table", "judged_notes"]

# Near a quarter of outliers, neighborhoods with a half of them are common, and a half is what
# planes withstand.
MANY = 0.25
CLEAR, GROSS = 10, 100  # scores, as the detector's documentation names them
LEAST_SCORE = 0.01  # where the axis of scores begins: smaller ones are on a plane
WORDS = {
    "isolated": "single points and pairs, far from everything else",
    "in groups": "small groups that stand apart: ghosts, birds, dust",
    "off surfaces": "points that lie on no surface: foliage, wires, noise",
}


def denoise_contents(cloud, detector, *, marked, found=None, n_others=0, together=""):
    """The contents of a report of `mcmd denoise`.

    Parameters
    ----------
    cloud : PointCloud
        As it was read.
    detector : MCMDOutlierDetector
        Fitted to it.
    marked : bool
        Whether outliers are marked, or dropped.
    found : ndarray of bool of shape (n,), default=None
        The outliers, if not all that the detector calls so, or others too.
    n_others : int, default=0
        Points of the file that the detector has not seen.
    together : str, default=""
        Where outliers lie together, by `words_of`.
    """
    score, cutoff = -detector.scores_, float(-detector.offset_)
    found = score > cutoff if found is None else found
    n, n_all = int(np.count_nonzero(found)), len(cloud)
    judged = detector._cloud
    paper = judged.own_planes_only
    scales = None if paper else judged.planes.scale
    facts = Facts.of(cloud.xyz, detector.n_neighbors_, scales)
    places = Places.of(cloud.xyz, found, facts.near)
    notes = together_notes(together) + judged_notes(n, n_all)
    notes += _surface_notes(detector, n_all) + cloud_notes(facts)
    on_surface = int(np.count_nonzero(detector.on_surface_))
    done = "are marked" if marked else "were removed"
    cards = [
        (f"{n_all:,}", "points that were used" if n_others else "points in the input"),
        (f"{n:,}", f"outliers, {percent(n, n_all)}"),
        (f"{on_surface:,}", f"on surfaces, {percent(on_surface, n_all)}"),
        (f"{cutoff:.3g}", "cutoff of the score"),
    ]
    if n_others:
        cards.insert(1, (f"{n_others:,}", "others, neither judged nor used"))
    sections = [
        Section("Where the outliers are", found_maps(cloud.xyz, found, facts.near, "outliers")),
        Section(
            "How clear they are",
            histogram(score, cutoff=cutoff, name="score", least=LEAST_SCORE)
            + grade_table(score, cutoff),
        ),
    ]
    if not paper:
        sections.append(Section("What they are", _kind_table(detector, found)))
    sections.append(
        Section("Places", place_sections(places, cloud.xyz, found, facts.near, "outliers"))
    )
    return Contents(
        headline=f"{share(n, n_all)} are outliers; they {done}.",
        cards=cards,
        notes=notes,
        checks=f"many outliers, many that lie together, {CHECKS}",
        sections=sections,
        cloud_rows=facts.rows(cloud),
        output=f"{n_all + n_others - (0 if marked else n):,} points"
        + (", with outlier_score and marks" if marked else ""),
        shown=with_results(
            cloud, {"outlier": found.astype(np.uint8), "outlier_score": score.astype(np.float32)}
        ),
    )


def grade_table(score, cutoff):
    """Outliers by how clear they are."""
    grades = [
        ("doubtful", cutoff, CLEAR),
        ("clear", max(cutoff, CLEAR), GROSS),
        ("gross", max(cutoff, GROSS), np.inf),
    ]
    n = np.count_nonzero(score > cutoff)
    rows = []
    for name, low, high in grades:
        if low < high:
            found = np.count_nonzero((score > low) & (score <= high))
            span = f"{low:.3g} to {high:g}" if np.isfinite(high) else f"above {low:.3g}"
            rows.append((name, span, f"{found:,}", percent(found, n)))
    words = paragraph(
        "A score up to 3 means that the point is on a surface or near other points; 10 is a clear "
        "error, 100 a gross one."
    )
    return words + table(("outliers", "score", "points", "share"), rows, numbers=(2, 3))


def judged_notes(n, n_all):
    """Notes on a verdict: its share."""
    if n <= MANY * n_all:
        return []
    return [
        Note(
            "Many outliers.",
            f"{share(n, n_all)} are flagged. Planes withstand up to a half of outliers in a "
            "neighborhood, and some neighborhoods now have more.",
            "Look at the maps before points are dropped; --mode mark keeps them all.",
        )
    ]


def _surface_notes(detector, n_all):
    from sklearn_mcmd.outliers._detector import EXACT_PLANE_SCORE

    notes = []
    n_exact = int(np.count_nonzero(detector.scores_ < -EXACT_PLANE_SCORE))
    if n_exact >= 0.01 * n_all:
        notes.append(
            Note(
                "Planes without noise.",
                f"{share(n_exact, n_all)} are outliers only because most of their neighbors lie "
                "exactly in one plane, as where coordinates are rounded more coarsely than the "
                "noise.",
                "Check these before they are dropped (--mode mark).",
            )
        )
    n_on = int(np.count_nonzero(detector.on_surface_))
    if n_on < 0.5 * n_all and not detector._cloud.own_planes_only:
        notes.append(
            Note(
                "Few points on surfaces.",
                f"Only {share(n_on, n_all)} lie on a surface. The others are judged by the "
                "company that they keep, which finds fewer outliers.",
                "That is right for foliage. If these are surfaces, they are noisy: give more "
                "--n-neighbors.",
            )
        )
    return notes


def _kind_table(detector, found):
    kinds, n = kinds_of_outliers(detector)[found], int(np.count_nonzero(found))
    counts = np.bincount(kinds[kinds >= 0], minlength=len(KINDS))
    rows = [
        (name, f"{count:,}", percent(count, n), WORDS[name])
        for name, count in zip(KINDS, counts.tolist(), strict=True)
        if count or name != "off surfaces"
    ]
    n_large = int(np.count_nonzero(kinds < 0))
    if n_large:
        words = "groups far below the ground"
        rows.append(("in low groups", f"{n_large:,}", percent(n_large, n), words))
    return table(("kind", "points", "share", ""), rows, numbers=(1, 2))
