"""What a report says about the test of one plane."""

from functools import partial

import numpy as np

from sklearn_mcmd.planes._form import cells_of
from sklearn_mcmd.plotting import PlaneResidualDisplay
from sklearn_mcmd.plotting._displays import along_normal, those_of_plane
from sklearn_mcmd.report._contents import Contents, Map, Table, share
from sklearn_mcmd.report._shown import Shown


def plane_contents(cloud, detector, figures, unit):
    """The contents of a report of `mcmd plane`, whose detector is fitted to the cloud."""
    is_outlier, n_all = detector.labels_ == -1, len(cloud)
    n = int(np.count_nonzero(is_outlier))
    unit, rows = f" {unit}" if unit else "", figures.rows()
    parts = dict(figures.parts)
    residuals, first = detector.residuals(cloud.xyz), parts.pop("") + parts.pop("Plane")
    rms = float(np.sqrt(np.mean(residuals[those_of_plane(is_outlier)] ** 2)))
    columns = {"residual": residuals, "test_statistic": detector.test_statistic_}
    columns = {name: values.astype(np.float32) for name, values in columns.items()}
    columns["outlier"] = is_outlier.astype(np.uint8)
    shown = Shown.of_memory(cloud, 0, np.array([detector.sigma0_]), **columns)
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
        results=[(row.name, row) for row in first],
        maps=_residual_maps(detector, cloud.xyz, shown.near, unit),
        tables=[
            *(Table(title, [(row.name, row) for row in part]) for title, part in parts.items()),
            *(
                Table(title, cells, header, numbers=range(len(header)))
                for title, (header, cells) in figures.tables.items()
            ),
        ],
        notes=[],
        checks="many outliers, a rejected plane",
        output=f"{n_all:,} points, with residual, test_statistic and marks of outliers",
    )


def _residual_maps(detector, xyz, near, unit):
    """The residuals, along the normal of the plane and along it: floors are seen from their edge,
    walls too. Then the form that is left: means of cells of the points that pass."""
    residuals, passed = detector.residuals(xyz), those_of_plane(detector.labels_ == -1)
    plane = detector._fitted.plane
    cells = cells_of((xyz[passed] - plane.center) @ plane.directions, residuals[passed])
    means = np.zeros(len(xyz))  # outliers have none, and the color of 0
    means[passed] = cells.residuals[cells.of_point]
    labels = detector.labels_[near]
    display = PlaneResidualDisplay(xyz[near], residuals[near], labels)
    form = PlaneResidualDisplay(xyz[near], means[near], labels)
    front = along_normal(xyz[passed])
    across, words = ("front", "from the front") if front[1] > 45 else ("top", "from above")
    what, where = f"Residuals{unit and f' in{unit}'}", "along the normal of the plane"
    return [
        Map(f"{what}, {where}", partial(display.plot, view=front)),
        Map(f"{what}, {words}", partial(display.plot, view=across)),
        Map(f"Form: means of {len(cells.residuals)} cells", partial(form.plot, view=front)),
    ]
