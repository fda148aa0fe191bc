"""What a report says about normals."""

from itertools import pairwise

import numpy as np

from sklearn_mcmd.io._point_cloud import with_results
from sklearn_mcmd.report._contents import Contents, Note, Section, percent, share
from sklearn_mcmd.report._facts import Facts
from sklearn_mcmd.report._histogram import histogram
from sklearn_mcmd.report._html import paragraph, table
from sklearn_mcmd.report._maps import ball, maps
from sklearn_mcmd.report._notes import CHECKS, cloud_notes
from sklearn_mcmd.report._places import Places, place_sections

__all__ = ["normals_contents", "normals_maps", "normals_notes", "removed_words", "tilt_table"]

# Standard error in degrees from which on a normal is unreliable: the true one is then within 1.73
# errors, 17 degrees, with 95 % confidence, and region growing separates faces at 15.
UNRELIABLE = 10.0
# Share of unreliable normals that is worth a warning; edges and rims alone have less.
SOME = 0.05
# Share of a neighborhood whose removal tells that it holds two things of about one size.
HALF = 0.4
TILTS = ((0, 10, "level"), (10, 45, "sloping"), (45, 80, "steep"), (80, 90.01, "upright"))


def normals_contents(cloud, estimator, results):
    """The contents of a report of `mcmd normals`.

    Parameters
    ----------
    cloud : PointCloud
        As it was read.
    estimator : RobustNormalEstimator
        Fitted to it.
    results : dict of str to ndarray
        The columns that were written.
    """
    errors, n_all = estimator.normal_error_, len(cloud)
    n_neighbors = int(np.median(estimator.n_neighbors_))
    facts = Facts.of(cloud.xyz, n_neighbors, estimator.plane_scale_)
    known = errors[np.isfinite(errors)]
    unreliable = ~(errors <= UNRELIABLE)
    n = int(np.count_nonzero(unreliable))
    median, most = np.quantile(known, [0.5, 0.95]) if known.size else (np.nan, np.nan)
    places = Places.of(cloud.xyz, unreliable, facts.near)
    removed = estimator.removed_fraction_
    sections = [
        Section("Normals", normals_maps(cloud.xyz, estimator.normals_, facts.near)),
        Section(
            "How exact they are",
            histogram(
                errors, cutoff=UNRELIABLE, cutoff_name="unreliable from",
                name="standard error of the normal in degrees", least=0.01,
            )
            + paragraph(
                "The true normal is within 1.73 standard errors with 95 % confidence, as far as "
                "noise goes. Rims, corners and things smaller than a neighborhood are worse.",
                "soft",
            )
            + _error_table(errors),
        ),
        Section(
            "Where they are unreliable",
            place_sections(places, cloud.xyz, unreliable, facts.near, "unreliable normals"),
        ),
        Section(
            "Directions and neighborhoods", tilt_table(estimator.normals_) + removed_words(removed)
        ),
    ]  # fmt: skip
    notes = normals_notes(errors, removed) + cloud_notes(facts)
    return Contents(
        headline=f"{n_all:,} points have normals. Half of these are exact to {median:.2g} degrees, "
        f"95 % to {most:.2g} (standard errors).",
        cards=[
            (f"{n_all:,}", "points"),
            (f"{median:.2g}°", "median standard error"),
            (f"{n:,}", f"unreliable normals, {percent(n, n_all)}"),
            (percent(removed.mean(dtype=float), 1.0), "of a neighborhood removed, on average"),
        ],
        notes=notes,
        checks=f"unreliable normals, neighborhoods of two things, {CHECKS}",
        sections=sections,
        cloud_rows=facts.rows(cloud),
        output=f"{n_all:,} points, with {', '.join(results)}",
        shown=with_results(cloud, results | {"normal_error": errors.astype(np.float32)}),
    )


def normals_maps(xyz, normals, near):
    """Maps by direction, and the legend."""
    from sklearn_mcmd.plotting import NormalsDisplay

    def draw(rows, view, ax, max_points):
        NormalsDisplay(xyz[rows], normals[rows]).plot(view=view, ax=ax, max_points=max_points)

    return ball() + maps(draw, xyz, near)


def normals_notes(errors, removed):
    """Notes on standard errors, None if they are not known, and on removed shares."""
    notes, n_all = [], len(removed)
    n = 0 if errors is None else int(np.count_nonzero(~(errors <= UNRELIABLE)))
    if n > SOME * n_all:
        notes.append(
            Note(
                "Unreliable normals.",
                f"{share(n, n_all, 'normals')} have a standard error above {UNRELIABLE:g} degrees: "
                "their neighborhoods are sparse, narrow or noisy.",
                "Give more --n-neighbors, or --n-neighbors auto, and look at the table of places.",
            )
        )
    n_half = int(np.count_nonzero(removed > HALF))
    if n_half > SOME * n_all:
        notes.append(
            Note(
                "Neighborhoods of several things.",
                f"For {share(n_half, n_all)} more than {100 * HALF:g} % of the neighborhood was "
                "removed: it reaches over an edge, into foliage, or holds many outliers.",
                "Denoise the cloud first, or give a smaller --n-neighbors.",
            )
        )
    return notes


def _error_table(errors):
    limits = [0, 1, 2, 5, UNRELIABLE, np.inf]
    rows = []
    for low, high in pairwise(limits):
        n = np.count_nonzero((errors >= low) & (errors < high))
        span = f"{low:g} to {high:g}" if np.isfinite(high) else f"{low:g} and more"
        rows.append((span, f"{n:,}", percent(n, len(errors))))
    n = np.count_nonzero(~np.isfinite(errors))
    if n:
        rows.append(("not known", f"{n:,}", percent(n, len(errors))))
    return table(("standard error, degrees", "points", "share"), rows, numbers=(1, 2))


def tilt_table(normals):
    tilt = np.degrees(np.arccos(np.clip(np.abs(normals[:, 2]), 0.0, 1.0)))
    rows = []
    for low, high, name in TILTS:
        n = np.count_nonzero((tilt >= low) & (tilt < high))
        rows.append((name, f"{low} to {min(high, 90):g}", f"{n:,}", percent(n, len(tilt))))
    header = ("surface", "tilt, degrees", "points", "share")
    return table(header, rows, numbers=(2, 3))


def removed_words(removed):
    n = int(np.count_nonzero(removed > HALF))
    return paragraph(
        f"On average {100 * removed.mean(dtype=float):.1f} % of a neighborhood was removed before "
        f"its plane was fitted; for {share(n, len(removed))} more than {100 * HALF:g} %.",
        "soft",
    )
