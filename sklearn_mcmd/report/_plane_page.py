"""What a report says about the test of one plane."""

from functools import partial

import numpy as np

from sklearn_mcmd.plotting import PlaneResidualDisplay, plot_cloud
from sklearn_mcmd.plotting._displays import add_color_bar, along_normal, those_of_plane
from sklearn_mcmd.plotting._still import color_modules
from sklearn_mcmd.plotting._views import thinned
from sklearn_mcmd.report._contents import Contents, Map, Table, note_if, share
from sklearn_mcmd.report._maps import MOST_DRAWN
from sklearn_mcmd.report._shown import Shown

MANY = 0.25  # share of outliers that makes "one plane" doubtful: the robust start takes a half


def plane_contents(cloud, detector, figures, unit):
    """The contents of a report of `mcmd plane`, whose detector is fitted to the cloud."""
    found, n_all = detector.labels_ == -1, len(cloud)
    n = int(np.count_nonzero(found))
    unit, rows = f" {unit}" if unit else "", figures.rows()
    parts = dict(figures.parts)
    residuals, first = detector.residuals(cloud.xyz), parts.pop("") + parts.pop("Plane")
    rms = float(np.sqrt(np.mean(residuals[those_of_plane(found)] ** 2)))
    results = {"residual": residuals, "test_statistic": detector.test_statistic_}
    results = {name: values.astype(np.float32) for name, values in results.items()}
    results["outlier"] = found.astype(np.uint8)
    shown = Shown.of_memory(cloud, 0, np.array([detector.sigma0_]), **results)
    headline = (
        f"{share(n, n_all, 'do')} not belong to the plane; {'the others' if n < n_all else 'all'} "
    )
    headline += f"are within {rms:.3g}{unit} of it (rms)."
    if "flatness" in rows:
        headline += f" Flatness, {rows['tolerance']}: {rows['flatness']}; outside are "
        headline += f"{rows['outside']}."
    if "against" in rows:
        offset = rows["offset"]._replace(note="")
        headline += f" Against the other plane: {rows['against']}, offset {offset}."
    return Contents(
        shown,
        headline=headline,
        found=[(row.name, row) for row in first],
        maps=[
            *_residual_maps(cloud.xyz, residuals, found, shown.near, unit),
            *_bias_map(cloud.xyz[shown.near], figures.reliability, shown.near, unit),
        ],
        tables=[
            *(Table(title, [(row.name, row) for row in part]) for title, part in parts.items()),
            *(
                Table(title, cells, header, numbers=range(len(header)))
                for title, (header, cells) in figures.tables.items()
            ),
        ],
        notes=_notes(detector, n, n_all, unit, rows),
        checks="many outliers, a rejected plane",
        output=f"{n_all:,} points, with residual, test_statistic and marks of outliers",
    )


def _residual_maps(xyz, residuals, is_outlier, near, unit):
    """The residuals, along the normal of the plane and along it: floors are seen from their edge,
    walls too."""
    display = PlaneResidualDisplay(xyz[near], residuals[near], np.where(is_outlier[near], -1, 1))
    front = along_normal(xyz[those_of_plane(is_outlier)])
    across, words = ("front", "from the front") if front[1] > 45 else ("top", "from above")
    what = f"Residuals{unit and f' in{unit}'}"
    return [
        Map(f"{what}, along the normal of the plane", partial(display.plot, view=front)),
        Map(f"{what}, {words}", partial(display.plot, view=across)),
    ]


def _bias_map(xyz, reliability, near, unit):
    """The map of minimal detectable biases, if there are any."""
    if reliability is None or not np.isfinite(reliability.minimal_bias).any():
        return []
    cm, colors = color_modules()
    bias = reliability.minimal_bias[near]
    low, high = np.quantile(bias[np.isfinite(bias)], [0.01, 0.99])
    shade = cm.ScalarMappable(colors.Normalize(low, high, clip=True))
    rows = thinned(np.zeros(len(xyz)), MOST_DRAWN)

    def plot(ax):
        rgb = shade.to_rgba(bias[rows])[:, :3]
        plot_cloud(xyz[rows], color=rgb, view=along_normal(xyz), scale_bar=True, ax=ax)
        add_color_bar(ax, shade, f"minimal detectable bias{unit and ',' + unit}")

    title = f"Errors of this size are found with a probability of {reliability.power:g}"
    return [Map(title, plot)]


def _notes(detector, n, n_all, unit, rows):
    is_exact = detector._fitted.is_rounding
    notes = note_if(
        n > MANY * n_all,
        "Many outliers.",
        f"{share(n, n_all, 'do')} not belong to the plane. It may be two planes, or a curved one.",
        "Look at the map of residuals, and cut out one plane.",
    )
    notes += note_if(
        is_exact,
        "No noise to test against.",
        f"sigma0 is {detector.sigma0_:.2g}{unit}, the rounding of float64: the points lie exactly "
        "on the plane, or a smaller sigma0 was given.",
        "Give --sigma0, the standard deviation of the scanner.",
    )
    return notes + note_if(
        detector.global_test_pvalue_ < detector.global_test_level_ and not is_exact,
        "The plane and sigma0 do not fit.",
        f"Global test: {rows['global test']}. The points without outliers scatter more than "
        f"sigma0 = {detector.sigma0_:.3g}{unit} says.",
        "Check --sigma0, or whether the surface is a plane.",
    )
