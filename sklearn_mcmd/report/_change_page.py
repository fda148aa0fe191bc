"""What a report says about what has moved."""

import numpy as np

from sklearn_mcmd.plotting import plot_cloud
from sklearn_mcmd.plotting._displays import add_color_bar
from sklearn_mcmd.plotting._still import color_modules
from sklearn_mcmd.report._contents import Contents, Table, note_if, share
from sklearn_mcmd.report._maps import MOST_DRAWN, fullest_cells, maps

MANY = 0.5  # share of moved points, of clouds that are off as a whole
STEPS = 20  # bars of the histogram, an even number so that 0 is a border


def change_contents(shown, told, rows, unit):
    """The contents of a report of `mcmd change`, by the points of the first cloud."""
    distance, reason = (shown.cloud.attributes[name] for name in ("distance", "reason"))
    compared, moved = reason == 0, shown.cloud.attributes["significant"] > 0
    n, n_compared = told.n_significant, told.reasons[0]
    unit = f" {unit}" if unit else ""
    headline = f"{share(n, n_compared, 'have')} moved, of those that can be compared."
    if moved.any():
        sizes = np.abs(distance[moved])
        headline += f" Half of these by {np.median(sizes):.3g}{unit} and more."
    tables = [_histogram(distance[compared], moved[compared], unit)] if compared.any() else []
    if told.bodies is not None:
        tables.insert(0, _bodies(told.bodies, unit))
    return Contents(
        shown,
        headline=headline,
        results=list(rows.items()),
        maps=_maps(shown.xyz, distance, compared & shown.near, unit),
        tables=[*tables, *fullest_cells(shown.xyz, moved, shown.near, "moved points")],
        notes=note_if(
            n_compared > 0 and n > MANY * n_compared,
            "Most points moved.",
            f"{share(n, n_compared, 'have')} moved: the registration may be off.",
            "Give --registration, or --registration auto.",
        ),
        checks="clouds that are off as a whole",
        output=f"{shown.n_all:,} points{shown.files}, with distance, its error, level of "
        "detection, pvalue, significant, reason",
    )


def _maps(xyz, distance, drawn, unit):
    """Distances in colors whose middle is 0, where there are any."""
    rows = np.flatnonzero(drawn)
    if not len(rows):
        return []
    rows = rows[:: len(rows) // MOST_DRAWN + 1]
    most = float(np.quantile(np.abs(distance[rows]), 0.98)) or 1.0

    cm, colors = color_modules()
    shade = cm.ScalarMappable(colors.Normalize(-most, most, clip=True), "coolwarm")
    shades = shade.to_rgba(distance[rows])[:, :3]

    def plot(view, ax):
        plot_cloud(xyz[rows], color=shades, view=view, scale_bar=True, ax=ax)
        add_color_bar(ax, shade, f"distance{unit and f' in{unit}'}")

    return maps("Distance", plot)


def _histogram(distance, moved, unit):
    """How many points moved how far."""
    most = float(np.quantile(np.abs(distance), 0.98)) or 1.0
    edges = np.linspace(-most, most, STEPS + 1)
    inside = np.clip(distance, -most, most)
    counts, of_moved = (np.histogram(part, edges)[0] for part in (inside, inside[moved]))
    rows = [
        (f"{low:.3g} to {high:.3g}", f"{count:,}", f"{count_moved:,}")
        for low, high, count, count_moved in zip(edges, edges[1:], counts, of_moved, strict=False)
    ]
    words = "Larger distances are in the first and last row."
    header = (f"distance{unit}", "points", "significant")
    return Table("Distances", rows, header, numbers=(1, 2), words=words)


def _bodies(bodies, unit):
    """The flat surfaces of both clouds, those first that moved most surely."""
    digits = place_digits(bodies.place)
    rows = [
        (
            "not controlled"
            if np.isnan(bodies.pvalue[k])
            else ("stayed", "moved")[int(bodies.moved[k])],
            f"{bodies.offset[k]:.3g} ± {bodies.offset_error[k]:.2g}",
            f"{bodies.tilt[k]:.3g} ± {bodies.tilt_error[k]:.2g}",
            f"{bodies.pvalue[k]:.2g}",
            f"{bodies.points[k]:,}",
            " ".join(f"{value:.{digits}f}" for value in bodies.place[k]),
        )
        for k in np.argsort(bodies.pvalue, kind="stable")
    ]
    header = ("against the others", f"offset{unit}", "tilt, degrees", "p", "points", "place")
    return Table("Flat surfaces of both scans", rows, header, numbers=(1, 2, 3, 4))


def place_digits(places):
    """Decimals that show a thousandth of the extent of places, however far these are away."""
    extent = float(np.ptp(places, axis=0).max()) or 1.0
    return int(np.clip(3 - np.floor(np.log10(extent)), 0, 9))
