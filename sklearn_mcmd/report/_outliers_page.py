"""What a report says about outliers."""

import numpy as np

from sklearn_mcmd.io._classes import HIGH_NOISE, LOW_NOISE
from sklearn_mcmd.outliers._detector import judged_cloud
from sklearn_mcmd.report._contents import Contents, Table, note_if, share
from sklearn_mcmd.report._maps import fullest_cells, marked_maps
from sklearn_mcmd.report._shown import Shown, removed_of, step_of

MANY = 0.25  # share of outliers; neighborhoods with a half, which planes withstand, are then common
CLEAR = 10  # score of a clear error, as the detector's documentation says
GROSS = 100  # score of a gross one
WORST = 10  # outliers, or groups of them, whose reasons are given
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
        is_outlier = np.isin(cloud.attributes["classification"], (LOW_NOISE, HIGH_NOISE))
    else:
        cloud, is_outlier = removed_of(catalog.paths, outputs, step_of(run))
    if is_outlier is not None:
        cloud = cloud.with_attributes(outlier=is_outlier.astype(np.uint8))
    return Shown.of_sample(cloud, catalog, outputs, run)


def denoise_contents(shown, outcome, n, cutoff, *, marked, detector=None):
    """The contents of a report of `mcmd denoise`.

    What is shown has ``outlier``, and ``outlier_score`` if scores are known; neither if nobody
    knows which points were removed. `outcome` has the counts of the run, `n` is that of outliers,
    and the cutoff of scores is None if it is unknown. Outliers are marked, or dropped. The fitted
    detector is there after a run in memory.
    """
    n_all, n_others = outcome.n_used, outcome.n_points - outcome.n_used
    columns, xyz, near = shown.cloud.attributes, shown.xyz, shown.near
    is_outlier, score = columns.get("outlier"), columns.get("outlier_score")
    done = "marked" if marked else "removed"
    results, maps, tables = [(f"outliers, {done}", share(n, n_all))], [], []
    if n_others:
        results.append(("points neither judged nor used", f"{n_others:,}"))
    if is_outlier is None:
        words = (
            "none: the outputs replaced the inputs, or have other coordinates; --mode mark keeps "
        )
        results.append(("maps", words + "outliers, and then they have maps"))
    else:
        is_outlier = is_outlier > 0
        maps = marked_maps(xyz, is_outlier, near, "outlier")
        tables = fullest_cells(xyz, is_outlier, near, "outliers")
    if score is not None:
        score = score.astype(np.float64)
        if cutoff is None:  # the run found it: the largest score below it
            cutoff = float(score[~is_outlier].max(initial=0.0))
        results.append(("cutoff of the score; up to it a point is real", f"{cutoff:.3g}"))
        n_above = np.count_nonzero(score > cutoff)
        for kind, least in (("clear", CLEAR), ("gross", GROSS)):
            worse = share(np.count_nonzero(score > max(least, cutoff)), n_above, noun="outlier")
            results.append((f"{kind} errors, whose score is above {least}", worse))
    if detector is not None:
        on_surface = int(np.count_nonzero(detector.on_surface_))
        results.append(("points on surfaces", share(on_surface, n_all)))
        if plane_scales(detector) is not None:
            results += _kinds(detector, is_outlier)
            tables = _worst(detector, xyz, is_outlier) + tables
    n_out = n_all + n_others - (0 if marked else n)
    return Contents(
        shown,
        headline=f"{share(n, n_all, 'are outliers')}: {done}.",
        results=results,
        maps=maps,
        tables=tables,
        notes=_notes(detector, n, n_all),
        checks="many outliers, many that lie together",
        output=f"{n_out:,} points{shown.files}" + ", with outlier_score and marks" * marked,
        rows=outcome.sensor.items(),
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
    if detector.isolation_ is None:
        return None
    return judged_cloud(detector).measuring.planes.scale


def kinds_of_outliers(detector):
    """Why each fitted point is an outlier: its place in `KINDS`, and -1 of all others."""
    is_outlier, cutoff = detector.scores_ < detector.offset_, -detector.offset_
    if detector.isolation_ is None:
        return np.where(is_outlier, np.int8(2), np.int8(-1))
    cloud = judged_cloud(detector)
    straight = np.zeros(len(cloud.index.points), dtype=bool)
    straight[cloud.off_surface.rows] = cloud.off_surface.straight
    # A point in a row is as isolated as the row is separated, at most.
    by_row = straight[cloud.index.places] & (detector.isolation_ == detector.separation_)
    apart = (detector.isolation_ > cutoff) & ~by_row, detector.separation_ > cutoff
    return np.select([~is_outlier, *apart], [np.int8(-1), np.int8(0), np.int8(1)], np.int8(2))


def reasons_of(detector, rows):
    """Why each of these rows is an outlier, in words with numbers: a list of str."""
    cloud, kinds = judged_cloud(detector), kinds_of_outliers(detector)
    groups = detector.group_index_
    at = np.searchsorted(cloud.off_surface.rows, cloud.index.places)
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
        elif kind == 0 and cloud.rays is not None and cloud.beside_rays.by_sheet[at[row]]:
            words = "on a sheet of rays"
        reasons.append(words)
    return reasons


def _kinds(detector, is_outlier):
    """Rows on how many outliers are of each kind."""
    kinds = kinds_of_outliers(detector)[is_outlier]
    counts = np.bincount(1 + kinds, minlength=1 + len(KINDS)).tolist()
    names = ["in groups far below the ground", *map(": ".join, KINDS.items())]
    return [
        (name, share(n, len(kinds), noun="outlier"))
        for name, n in zip(names[1:] + names[:1], counts[1:] + counts[:1], strict=True)
        if n
    ]


def _worst(detector, xyz, is_outlier):
    """A table of the worst outliers and why they are, of each group its worst."""
    rows = np.flatnonzero(is_outlier & (detector.scores_ < detector.offset_))
    rows = rows[np.argsort(detector.scores_[rows], kind="stable")]
    alone = -1 - np.arange(len(xyz))  # points on surfaces have no group
    groups = np.where(detector.on_surface_, alone, detector.group_index_)[rows]
    rows = rows[np.sort(np.unique(groups, return_index=True)[1])[:WORST]]
    cells = [
        (*(f"{value:.9g}" for value in xyz[row]), f"{-detector.scores_[row]:.3g}", reason)
        for row, reason in zip(rows, reasons_of(detector, rows), strict=True)
    ]
    header = ("x", "y", "z", "score", "why")
    return [Table("The worst outliers", cells, header, numbers=range(4))] if cells else []
