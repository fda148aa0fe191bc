"""What a report says about normals."""

import numpy as np

from sklearn_mcmd.plotting import NormalsDisplay
from sklearn_mcmd.report._contents import Contents, note_if, percent, share
from sklearn_mcmd.report._maps import display_maps, fullest_cells

# Degrees of standard error; the true normal is within 17 of it, and growing separates faces at 15.
UNRELIABLE = 10.0
SOME = 0.05  # share of unreliable normals that is worth a warning; edges and rims have less
HALF = 0.4  # removed share of a neighborhood that holds two things of about one size


def normals_contents(shown, names, removed):
    """The contents of a report of `mcmd normals`.

    What is shown has the columns that were written, by their names, and ``normal_error``, if it is
    known. `removed` is the mean share of a neighborhood that was removed.
    """
    columns, n_all, xyz, near = shown.cloud.attributes, shown.n_all, shown.xyz, shown.near
    normals = np.column_stack([columns[f"normal_{axis}"] for axis in "xyz"]).astype(np.float64)
    errors, results, tables = columns.get("normal_error"), [], []
    headline = f"{n_all:,} points have normals."
    if errors is not None:
        finite, unreliable = errors[np.isfinite(errors)], ~(errors <= UNRELIABLE)
        median, most = np.quantile(finite, [0.5, 0.95]) if finite.size else (np.nan, np.nan)
        headline += f" Half of these are exact to {median:.2g} degrees, 95 % to {most:.2g} "
        headline += "(standard errors)."
        n = int(np.count_nonzero(unreliable))
        name = f"unreliable normals, whose standard error is above {UNRELIABLE:g}°"
        results = [
            ("standard error", f"{median:.2g}° (median), 95 % to {most:.2g}°"),
            (name, share(n, len(errors), noun="normal")),
        ]
        tables = fullest_cells(xyz, unreliable, near, "unreliable normals")
    results += [
        ("surface variation (median)", f"{np.median(columns['surface_variation']):.2g}"),
        ("removed of a neighborhood (mean)", percent(removed, 1.0)),
    ]
    return Contents(
        shown,
        headline=headline,
        results=results,
        maps=display_maps("Normals as colors", NormalsDisplay(xyz[near], normals[near])),
        tables=tables,
        notes=_notes(errors, columns["removed_fraction"]),
        checks="unreliable normals, neighborhoods of two things",
        output=f"{n_all:,} points{shown.files}, with {', '.join(names)}",
    )


def _notes(errors, removed):
    """Notes on standard errors, None if they are not known, and on removed shares."""
    n_all, n_half = len(removed), int(np.count_nonzero(removed > HALF))
    n = 0 if errors is None else int(np.count_nonzero(~(errors <= UNRELIABLE)))
    return note_if(
        n > SOME * n_all,
        "Unreliable normals.",
        f"{share(n, n_all, 'have', 'normal')} a standard error above {UNRELIABLE:g} degrees: their "
        "neighborhoods are sparse, narrow or noisy.",
        "Give more --n-neighbors, or --n-neighbors auto, and look at the table of places.",
    ) + note_if(
        n_half > SOME * n_all,
        "Neighborhoods of several things.",
        f"For {share(n_half, n_all)} more than {100 * HALF:g} % of the neighborhood was removed: "
        "it reaches over an edge, into foliage, or holds many outliers.",
        "Denoise the cloud first, or give a smaller --n-neighbors.",
    )
