"""What a report says about the test of one plane."""

import numpy as np

from sklearn_mcmd.plotting import PlaneResidualDisplay
from sklearn_mcmd.plotting._displays import Picture, along_normal, those_of_plane
from sklearn_mcmd.report._contents import note_if, share
from sklearn_mcmd.report._histogram import histogram
from sklearn_mcmd.report._maps import maps
from sklearn_mcmd.report._rendering import join, paragraph, part, table
from sklearn_mcmd.report._shown import Shown

MANY = 0.25  # share of outliers that makes "one plane" doubtful: the robust start takes a half
LEAST, LARGEST = "#440154", "#fde725"  # the ends of the palette of numbers
RED, BLUE = "#b2182b", "#2166ac"  # the ends of the palette of residuals


def plane_contents(cloud, detector, figures, unit):
    """The contents of a report of `mcmd plane`, whose detector is fitted to the cloud."""
    found, n_all = detector.labels_ == -1, len(cloud)
    n = int(np.count_nonzero(found))
    unit, rows = f" {unit}" if unit else "", figures.rows()
    residuals, dip, sigma0 = detector.residuals(cloud.xyz), rows["dip"], rows["sigma0"]
    rms = float(np.sqrt(np.mean(residuals[those_of_plane(found)] ** 2)))
    results = {"residual": residuals, "test_statistic": detector.test_statistic_}
    results = {name: values.astype(np.float32) for name, values in results.items()}
    results["outlier"] = found.astype(np.uint8)
    shown = Shown.of_memory(cloud, 0, np.array([detector.sigma0_]), **results)
    statistics = histogram(
        np.abs(detector.test_statistic_),
        cutoff=float(detector.critical_value_),
        cutoff_name="critical value",
        name="test statistic",
        least=0.01,
    )
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
    return shown.contents(
        headline=headline,
        cards=[
            (f"{dip.value}°", f"dip, from the horizontal, ± {dip.error}°"),
            (f"{sigma0.value}{unit}", f"sigma0, {sigma0.note}"),
        ],
        notes=_notes(detector, n, n_all, unit, rows),
        checks="many outliers, a rejected plane",
        sections=[
            ("Residuals", _maps(cloud.xyz, residuals, found, shown.near, rms, unit)),
            ("How far off", statistics),
            *_found_biases(cloud.xyz, figures.reliability, shown.near, unit),
            _figure_sections(figures),
        ],
        output=f"{n_all:,} points, with residual, test_statistic and marks of outliers",
    )


def _maps(xyz, residuals, found, near, rms, unit):
    front = along_normal(xyz[those_of_plane(found)])
    across = "front" if front[1] > 45 else "top"  # floors are seen from their edge, walls too
    views = [(front, "Along the normal of the plane"), across]
    ends = [
        (RED, f"{3 * rms:.2g}{unit} or more to the side of the normal"),
        (BLUE, f"{3 * rms:.2g}{unit} or more to the other side"),
    ]
    display = PlaneResidualDisplay(xyz, residuals, np.where(found, -1, 1))
    return maps(display, xyz, near, ends, views, unit)


def _found_biases(xyz, reliability, near, unit):
    """The map of minimal detectable biases, if there are any."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    if reliability is None or not np.isfinite(reliability.minimal_bias).any():
        return []
    bias = reliability.minimal_bias
    low, high = np.quantile(bias[np.isfinite(bias)], [0.01, 0.99])
    colors = ScalarMappable(Normalize(low, high, clip=True)).to_rgba(bias)[:, :3]
    picture = Picture(colors, np.zeros(len(xyz)), "")
    ratio = np.sqrt(reliability.noncentrality)
    ends = [(LEAST, f"{low:.5g}{unit}"), (LARGEST, f"{high:.5g}{unit} or more")]
    words = (
        f"Minimal detectable bias (MDB): an error of this size is found with a probability of "
        f"{reliability.power:g}. It is {ratio:.2f} standard deviations over the root of the "
        "redundancy number, so the map shows the redundancy as well."
    )
    views = [(along_normal(xyz[near]), "Along the normal")]
    figures = maps(picture, xyz, near, ends, views, unit)
    return [("Which errors are found", paragraph(words) + figures)]


def _figure_sections(figures):
    """All rows and tables of the plane."""
    rows = []
    for title, part_rows in figures.parts.items():
        rows += [part("heading", title)] if title else []
        named = [(row.name, row) for row in part_rows]
        rows.append(table(("name", "value"), named, kind="pairs"))
    for title, (header, cells) in figures.tables.items():
        rows += [part("heading", title), table(header, cells, numbers=range(len(header)))]
    return ("All figures", join(*rows))


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
