"""What a report says about outliers."""

import numpy as np

from sklearn_mcmd.io._classes import HIGH_NOISE, LOW_NOISE
from sklearn_mcmd.outliers._detector import judged_cloud
from sklearn_mcmd.report._contents import Contents, Table, note_if, share
from sklearn_mcmd.report._maps import fullest_cells, marked_maps
from sklearn_mcmd.report._shown import Shown, sample_of, step_of

MANY = 0.25  # share of outliers; neighborhoods with a half, which planes withstand, are then common
CLEAR = 10  # score of a clear error, as the detector's documentation says
GROSS = 100  # score of a gross one
WORST = 10  # outliers, or groups of them, that are listed
KINDS = {  # and what they are
    "isolated": "single points and pairs, far from everything else",
    "in groups": "small groups that stand apart: ghosts, birds, dust",
    "off surfaces": "points that lie on no surface: foliage, wires, noise",
}


def shown_of_tiles(catalog, outputs, run, marked):
    """What is shown of a run by tiles: a sample of the input; if outliers are marked in the output,
    of its judged points, with these marks."""
    step = step_of(run)
    if not marked:
        return Shown.of_sample(sample_of(catalog.paths, step), catalog, outputs, run)
    cloud = sample_of(outputs, step, ("outlier_score", "classification"))
    cloud = cloud.subset(np.isfinite(cloud.attributes["outlier_score"]))
    is_outlier = np.isin(cloud.attributes["classification"], (LOW_NOISE, HIGH_NOISE))
    cloud = cloud.with_attributes(outlier=is_outlier.astype(np.uint8))
    return Shown.of_sample(cloud, catalog, outputs, run)


def denoise_contents(shown, outcome, n, cutoff, *, marked, detector=None):
    """The contents of a report of `mcmd denoise`.

    What is shown has ``outlier`` and ``outlier_score``; neither where tiles have removed outliers.
    `outcome` has the counts of the run, `n` is that of outliers,
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
        results.append(("maps", "none: --mode mark keeps outliers, and then they have maps"))
    else:
        is_outlier, score = is_outlier > 0, score.astype(np.float64)
        maps = marked_maps(xyz, is_outlier, near, "outlier")
        tables = fullest_cells(xyz, is_outlier, near, "outliers")
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


def _kinds(detector, is_outlier):
    """Rows on how many outliers are of each kind."""
    counts = np.bincount(kinds_of_outliers(detector)[is_outlier], minlength=len(KINDS)).tolist()
    return [
        (": ".join(kind), share(n, sum(counts), noun="outlier"))
        for kind, n in zip(KINDS.items(), counts, strict=True)
        if n
    ]


def _worst(detector, xyz, is_outlier):
    """A table of the worst outliers and their kinds, of each group its worst."""
    rows = np.flatnonzero(is_outlier & (detector.scores_ < detector.offset_))
    rows = rows[np.argsort(detector.scores_[rows], kind="stable")]
    alone = -1 - np.arange(len(xyz))  # points on surfaces have no group
    groups = np.where(detector.on_surface_, alone, detector.group_index_)[rows]
    rows = rows[np.sort(np.unique(groups, return_index=True)[1])[:WORST]]
    kinds = np.array([*KINDS])[kinds_of_outliers(detector)]
    cells = [
        (*(f"{value:.9g}" for value in xyz[row]), f"{-detector.scores_[row]:.3g}", kinds[row])
        for row in rows
    ]
    header = ("x", "y", "z", "score", "kind")
    return [Table("The worst outliers", cells, header, numbers=range(4))] if cells else []
