"""What a report says about outliers."""

import numpy as np

from sklearn_mcmd.io._classes import HIGH_NOISE, LOW_NOISE
from sklearn_mcmd.outliers._detector import judged_cloud
from sklearn_mcmd.report._contents import note_if, percent, share
from sklearn_mcmd.report._histogram import histogram
from sklearn_mcmd.report._maps import found_maps, fullest_cells
from sklearn_mcmd.report._rendering import join, paragraph, part, table
from sklearn_mcmd.report._shown import Shown, removed_of, step_of

MANY = 0.25  # share of outliers; neighborhoods with a half, which planes withstand, are then common
CLEAR = 10  # score of a clear error, as the detector's documentation says
GROSS = 100  # score of a gross one
WORST = 10  # outliers, or groups of them, whose reasons are given
LEAST_SCORE = 0.01  # where the axis of scores begins: smaller ones are on a plane
KINDS = {  # and what they are
    "isolated": "single points and pairs, far from everything else",
    "in groups": "small groups that stand apart: ghosts, birds, dust",
    "off surfaces": "points that lie on no surface: foliage, wires, noise",
}


def shown_of_tiles(catalog, outputs, run, marked):
    """What is shown of a run by tiles: a sample of the judged points, and which are outliers."""
    if marked:
        names = "outlier_score", "classification"
        cloud = Shown.of_tiles(catalog, outputs, run, names).cloud
        cloud = cloud.subset(np.isfinite(cloud.attributes["outlier_score"]))
        found = np.isin(cloud.attributes["classification"], (LOW_NOISE, HIGH_NOISE))
    else:
        cloud, found = removed_of(catalog.paths, outputs, step_of(run))
    if found is not None:
        cloud = cloud.with_attributes(outlier=found.astype(np.uint8))
    return Shown.of_sample(cloud, catalog, outputs, run)


def denoise_contents(shown, told, n, cutoff, *, marked, detector=None):
    """The contents of a report of `mcmd denoise`.

    What is shown has ``outlier``, and ``outlier_score`` if scores are known; neither if nobody
    knows which points were removed. `told` has the counts of the run, `n` is that of outliers, and
    the cutoff of scores is None if it is unknown. Outliers are marked, or dropped. The fitted
    detector is there after a run in memory.
    """
    n_all, n_others = told.n_used, told.n_points - told.n_used
    given, xyz, near = shown.cloud.attributes, shown.xyz, shown.near
    found, score = given.get("outlier"), given.get("outlier_score")
    cards = [(f"{n_others:,}", "points neither judged nor used")] if n_others else []
    if found is None:
        drawn = paragraph(
            "The outputs replaced the inputs, or have other coordinates. --mode mark keeps "
            "outliers, and then they have maps."
        )
    else:
        found = found > 0
        drawn = found_maps(xyz, found, near, "outlier")
    sections = [("Where the outliers are", drawn)]
    if score is not None:
        score = score.astype(np.float64)
        if cutoff is None:  # the run found it: the largest score below it
            cutoff = float(score[~found].max(initial=0.0))
        drawn = histogram(score, cutoff=cutoff, name="score", least=LEAST_SCORE)
        clear, gross = (np.count_nonzero(score > max(least, cutoff)) for least in (CLEAR, GROSS))
        of = np.count_nonzero(score > cutoff)
        drawn += paragraph(
            f"A score up to 3 means that the point is on a surface or near other points. "
            f"{share(clear, of, 'have', 'outlier')} a clear error's score, above {CLEAR}; "
            f"{share(gross, of, 'have', 'outlier')} a gross error's, above {GROSS}."
        )
        sections.append(("How clear they are", drawn))
    if detector is not None:
        on_surface = int(np.count_nonzero(detector.on_surface_))
        cards.append((f"{on_surface:,}", f"on surfaces, {percent(on_surface, n_all)}"))
        cards.append((f"{cutoff:.3g}", "cutoff of the score"))
        if plane_scales(detector) is not None:
            drawn = _kind_table(detector, found) + _worst_table(detector, xyz, found)
            sections.append(("What they are", drawn))
    if found is not None:
        sections.append(("Places", fullest_cells(xyz, found, near, "outliers")))
    n_out = n_all + n_others - (0 if marked else n)
    done = "marked" if marked else "removed"
    return shown.contents(
        headline=f"{share(n, n_all, 'are outliers')}: {done}.",
        cards=cards,
        notes=_notes(detector, n, n_all),
        checks="many outliers, many that lie together",
        sections=sections,
        output=f"{n_out:,} points{shown.files}" + ", with outlier_score and marks" * marked,
        rows=told.sensor.items(),
    )


def _notes(detector, n, n_all):
    """Notes on the share of outliers, and if the detector is known, on that of surfaces."""
    n_on = n_all if detector is None else int(np.count_nonzero(detector.on_surface_))
    return note_if(
        n > MANY * n_all,
        "Many outliers.",
        f"{share(n, n_all, 'are')} flagged. Planes withstand up to a half of outliers in a "
        "neighborhood, and some neighborhoods now have more.",
        "Look at the maps before points are dropped; --mode mark keeps them all.",
    ) + note_if(
        n_on < 0.5 * n_all and plane_scales(detector) is not None,
        "Few points on surfaces.",
        f"Only {share(n_on, n_all, 'lie')} on a surface. The others are judged by the company that "
        "they keep, which finds fewer outliers.",
        "That is right for foliage. If these are surfaces, they are noisy: give more "
        "--n-neighbors.",
    )


def plane_scales(detector):
    """Standard deviations of the planes of a fitted detector; None where each point is judged by
    its own plane alone."""
    cloud = judged_cloud(detector)
    return None if cloud.own_planes_only else cloud.planes.scale


def kinds_of_outliers(detector):
    """Why each fitted point is an outlier: its place in `KINDS`, and -1 of all others."""
    is_outlier, cutoff = detector.scores_ < detector.offset_, -detector.offset_
    if detector.isolation_ is None:
        return np.where(is_outlier, np.int8(2), np.int8(-1))
    cloud = judged_cloud(detector)
    straight = np.zeros(len(cloud.model.index.points), dtype=bool)
    straight[cloud.off_surface.rest.rows] = cloud.off_surface.straight
    # A point in a row is as isolated as the row is separated, at most.
    by_row = straight[cloud.model.index.places] & (detector.isolation_ == detector.separation_)
    apart = (detector.isolation_ > cutoff) & ~by_row, detector.separation_ > cutoff
    return np.select([~is_outlier, *apart], [np.int8(-1), np.int8(0), np.int8(1)], np.int8(2))


def reasons_of(detector, rows):
    """Why each of these rows is an outlier, in words with numbers: a list of str."""
    cloud, kinds = judged_cloud(detector), kinds_of_outliers(detector)
    groups = detector.group_index_
    at = np.searchsorted(cloud.off_surface.rest.rows, cloud.model.index.places)
    sizes, far = np.bincount(groups + 1), detector.separation_ > -detector.offset_
    reasons = []
    for row in rows:
        kind, n, score = kinds[row], sizes[groups[row] + 1], -detector.scores_[row]
        away = (detector.separation_ if kind == 1 else detector.isolation_)[row]
        who = f"group of {n:,}" if kind == 1 else f"one of {n:,} together"
        who = who if n > 1 and groups[row] >= 0 else "single point"
        straight = kind == 1 and cloud.off_surface.straight[at[row]]
        who = f"straight thing of {n:,} that hangs" if straight else who
        if kind == 2 or score < away:
            away, unit = score, "standard deviations off a surface"
        elif kind == 1 and n > 1:
            unit = f"of its {'lengths' if straight else 'sizes'} away"
        else:
            unit = f"usual spacings from {'anything' if far[row] else 'its neighbors'}"
        words = f"{who}, {float(f'{away:.2g}'):,g} {unit}"
        if kind == 2 and groups[row] >= 0:
            words = "off every surface"
        elif kind == 0 and cloud.rays is not None and cloud.rays.rest.by_sheet[at[row]]:
            words = "on a sheet of rays"
        reasons.append(words)
    return reasons


def _kind_table(detector, found):
    kinds, n = kinds_of_outliers(detector)[found], int(np.count_nonzero(found))
    counts = np.bincount(kinds[kinds >= 0], minlength=len(KINDS))
    rows = [
        (name, f"{count:,}", percent(count, n), words)
        for (name, words), count in zip(KINDS.items(), counts.tolist(), strict=True)
        if count or name != "off surfaces"
    ]
    n_large = int(np.count_nonzero(kinds < 0))
    if n_large:
        words = "groups far below the ground"
        rows.append(("in low groups", f"{n_large:,}", percent(n_large, n), words))
    return table(("kind", "points", "share", ""), rows, numbers=(1, 2))


def _worst_table(detector, xyz, found):
    """The worst outliers and why they are, of each group its worst."""
    rows = np.flatnonzero(found & (detector.scores_ < detector.offset_))
    rows = rows[np.argsort(detector.scores_[rows], kind="stable")]
    alone = -1 - np.arange(len(xyz))  # points on surfaces have no group
    groups = np.where(detector.on_surface_, alone, detector.group_index_)[rows]
    rows = rows[np.sort(np.unique(groups, return_index=True)[1])[:WORST]]
    rows = [
        (*(f"{value:.9g}" for value in xyz[row]), f"{-detector.scores_[row]:.3g}", reason)
        for row, reason in zip(rows, reasons_of(detector, rows), strict=True)
    ]
    drawn = table(("x", "y", "z", "score", "why"), rows, numbers=range(4))
    return join(part("heading", "The worst"), drawn) if rows else ""
