"""What a report says about normals."""

from itertools import pairwise

import numpy as np

from sklearn_mcmd.plotting import NormalsDisplay
from sklearn_mcmd.report._contents import Contents, note_if, percent, share
from sklearn_mcmd.report._histogram import histogram
from sklearn_mcmd.report._maps import ball, maps
from sklearn_mcmd.report._places import place_sections
from sklearn_mcmd.report._rendering import paragraph, table

# Degrees of standard error; the true normal is within 17 of it, and growing separates faces at 15.
UNRELIABLE = 10.0
SOME = 0.05  # share of unreliable normals that is worth a warning; edges and rims have less
HALF = 0.4  # removed share of a neighborhood that holds two things of about one size
TILTS = ((0, 10, "level"), (10, 45, "sloping"), (45, 80, "steep"), (80, 90.01, "upright"))


def normals_contents(shown, names, removed):
    """The contents of a report of `mcmd normals`.

    What is shown has the columns that were written, by their names, and ``normal_error``, if it is
    known. `removed` is the mean share of a neighborhood that was removed.
    """
    given, n_all, xyz, near = shown.cloud.attributes, shown.n_all, shown.xyz, shown.near
    normals = np.column_stack([given[f"normal_{axis}"] for axis in "xyz"]).astype(np.float64)
    errors, variation = given.get("normal_error"), float(np.median(given["surface_variation"]))
    headline = f"{n_all:,} points have normals. The median of the surface variation is "
    headline += f"{variation:.2g}."
    cards = [(f"{n_all:,}", "points"), (f"{variation:.2g}", "surface variation (median)")]
    drawn = ball() + maps(NormalsDisplay(xyz, normals), xyz, near)
    sections = [("Normals", shown.words + drawn)]
    if errors is not None:
        known, unreliable = errors[np.isfinite(errors)], ~(errors <= UNRELIABLE)
        n = int(np.count_nonzero(unreliable))
        median, most = np.quantile(known, [0.5, 0.95]) if known.size else (np.nan, np.nan)
        headline = f"{n_all:,} points have normals. Half of these are exact to {median:.2g} "
        headline += f"degrees, 95 % to {most:.2g} (standard errors)."
        cards[1:] = [
            (f"{median:.2g}°", "median standard error"),
            (percent(n, len(errors)), "of the normals are unreliable"),
        ]
        sections += [
            ("How exact they are", shown.words + _errors_drawn(errors)),
            (
                "Where they are unreliable",
                shown.words + place_sections(xyz, unreliable, near, "unreliable normals"),
            ),
        ]
    left = given["removed_fraction"]
    flatness = histogram(given["surface_variation"], name="surface variation")
    sections += [
        ("Flatness", flatness),
        ("Directions and neighborhoods", _tilt_table(normals) + _removed_words(left)),
    ]
    return Contents(
        headline=headline,
        cards=[
            *cards,
            (percent(removed, 1.0), "of a neighborhood removed, on average"),
            *shown.cards[:1],
        ],
        notes=[*_notes(errors, left), *shown.notes],
        checks=f"unreliable normals, neighborhoods of two things, {shown.checks}",
        sections=sections,
        cloud_rows=shown.rows,
        output=f"{n_all:,} points{shown.files}, with {', '.join(names)}",
        shown=shown.cloud,
    )


def _errors_drawn(errors):
    name = "standard error of the normal in degrees"
    limit = {"cutoff": UNRELIABLE, "cutoff_name": "unreliable from"}
    drawn = histogram(errors, name=name, least=0.01, **limit)
    words = paragraph(
        "The true normal is within 1.73 standard errors with 95 % confidence, as far as noise "
        "goes. Rims, corners and things smaller than a neighborhood are worse.",
        "soft",
    )
    return drawn + words + _error_table(errors)


def _notes(errors, removed):
    """Notes on standard errors, None if they are not known, and on removed shares."""
    n_all, n_half = len(removed), int(np.count_nonzero(removed > HALF))
    n = 0 if errors is None else int(np.count_nonzero(~(errors <= UNRELIABLE)))
    return note_if(
        n > SOME * n_all,
        "Unreliable normals.",
        f"{share(n, n_all, 'normals')} have a standard error above {UNRELIABLE:g} degrees: their "
        "neighborhoods are sparse, narrow or noisy.",
        "Give more --n-neighbors, or --n-neighbors auto, and look at the table of places.",
    ) + note_if(
        n_half > SOME * n_all,
        "Neighborhoods of several things.",
        f"For {share(n_half, n_all)} more than {100 * HALF:g} % of the neighborhood was removed: "
        "it reaches over an edge, into foliage, or holds many outliers.",
        "Denoise the cloud first, or give a smaller --n-neighbors.",
    )


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


def _tilt_table(normals):
    tilt = np.degrees(np.arccos(np.clip(np.abs(normals[:, 2]), 0.0, 1.0)))
    rows = []
    for low, high, name in TILTS:
        n = np.count_nonzero((tilt >= low) & (tilt < high))
        rows.append((name, f"{low} to {min(high, 90):g}", f"{n:,}", percent(n, len(tilt))))
    header = ("surface", "tilt, degrees", "points", "share")
    return table(header, rows, numbers=(2, 3))


def _removed_words(removed):
    n = int(np.count_nonzero(removed > HALF))
    return paragraph(
        f"On average {100 * removed.mean(dtype=float):.1f} % of a neighborhood was removed before "
        f"its plane was fitted; for {share(n, len(removed))} more than {100 * HALF:g} %.",
        "soft",
    )
