"""``mcmd normals``."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import typer

import sklearn_mcmd
from sklearn_mcmd._choices import RuleMethod
from sklearn_mcmd.cli import _options, _sensor
from sklearn_mcmd.cli._cloud_verb import BY_TILES, CloudVerb, tiles_row
from sklearn_mcmd.cli._files import Output
from sklearn_mcmd.cli._options import command_of, length, made, option, parsed
from sklearn_mcmd.io._formats import SENSORS
from sklearn_mcmd.io._point_cloud import with_results
from sklearn_mcmd.planes._resolution import in_own_precision

SOME_UPRIGHT = 0.05  # share of normals of upright faces that is worth a line
DIRECTIONS = {"none": None, "up": [0.0, 0.0, 1.0]}


def _count_or_auto(text):
    """A whole number from 4 on, or auto."""
    if text != "auto" and int(text) < 4:
        raise ValueError
    return text if text == "auto" else int(text)


def _features(text):
    """Names of features."""
    from sklearn_mcmd.normals._features import check_features

    names = [part.strip() for part in text.split(",") if part.strip()]
    try:
        return check_features("all" if names == ["all"] else names)
    except ValueError as err:
        raise typer.BadParameter(str(err).removeprefix("features=")) from err


@dataclass
class Normals(CloudVerb):
    """All points are kept. New attributes, float32, are normal_x, normal_y, normal_z,
    surface_variation (0 on a plane, at most 1/3), eigenvalue_0 to eigenvalue_2
    (ascending), removed_fraction (the share of the neighborhood that was removed), the
    --features, and n_neighbors with --n-neighbors auto.
    """

    n_neighbors: int = option(
        50,
        "Points in a neighborhood, with the point. auto: as many for each point as its noise asks "
        "for; an attribute n_neighbors tells how many.",
        parser=parsed(_count_or_auto, "auto or a whole number from 4 on"),
        metavar="NUMBER|auto",
    )
    method: RuleMethod = option(
        "mcmd_z",
        "How outliers of a neighborhood are found before its plane is fitted. mcmd_z: by their "
        "distance to the plane. mcmd_md: by their distance within it as well. pca: not at all.",
    )
    radius: float | None = length(None, "Largest distance of a neighbor.")
    orientation: Literal["none", "up", "sensor", "mst"] = option(
        "none",
        "Which of two opposite normals to take. none, up: the one with positive z, which for "
        "upright faces noise decides from point to point. sensor: the one toward --sensor or "
        "--trajectory. mst: the one that agrees with the neighbors.",
    )
    sensor: tuple | None = _sensor.position_option(
        f"Where the sensor stood. auto: as the file states, by {SENSORS}, if the cloud looks as if "
        "measured from there.",
        _sensor.AUTO,
        show_default="not known",
    )
    trajectory: Path | None = _sensor.trajectory_option()
    features: tuple | None = option(
        None,
        "Further attributes, or all of them: linearity, planarity, sphericity, omnivariance, "
        "anisotropy, eigenentropy, verticality, roughness, normal_error (in degrees; the true "
        "normal is within 1.73 errors with 95 % confidence); mean_curvature, gaussian_curvature, "
        "max_curvature, min_curvature, shape_index, mean_curvature_error, max_curvature_error, "
        "min_curvature_error, max_curvature_direction, min_curvature_direction (three attributes "
        "each). Curvatures are in one over units of the file, and positive where the surface bends "
        "to the side of its normal.",
        parser=_features,
        metavar="NAME,...",
    )
    cutoff: float | None = option(
        None,
        "Distance from which on a neighbor is an outlier, in robust standard deviations.",
        show_default="2.5, for mcmd_md 3.06",
    )
    max_outlier_rate: _options.MaxOutlierRate = 0.5

    results = "normals"

    one_of = (("sensor", "trajectory"),)

    def __post_init__(self):
        from sklearn_mcmd.normals._features import feature_columns

        self.asked = _sensor.Asked(self.source, self.sensor, self.trajectory)
        is_sensed = self.sensor is not None or self.trajectory is not None
        if is_sensed != (self.orientation == "sensor"):
            raise typer.BadParameter(
                "--orientation sensor needs --sensor X,Y,Z|auto or --trajectory FILE, and these "
                "need --orientation sensor: give both or neither."
            )
        self.feature_columns = feature_columns(self.features or (), "xyz")

    def dry_parameters(self, catalog):
        is_sensed = self.orientation == "sensor"
        return {"orientation": None, "sensor_origin": None} if is_sensed else {}

    def estimator(self):
        return made(
            self,
            sklearn_mcmd.RobustNormalEstimator,
            orientation=DIRECTIONS.get(self.orientation, self.orientation),
            sensor_origin=self.sensor if isinstance(self.sensor, tuple) else None,
        )

    def find(self, cloud, estimator):
        from sklearn_mcmd.planes._orientation import count_upright
        from sklearn_mcmd.tiling._verbs import normal_columns

        origins, sensed = self.asked.of_normals(cloud)
        estimator.fit(in_own_precision(cloud.xyz), sensor_origin=origins)
        names, columns = normal_columns(estimator)
        results = dict(zip(names, columns.T.copy(), strict=True))
        return {
            "estimator": estimator,
            "results": results,
            "removed_fraction": results["removed_fraction"].mean(dtype=np.float64),
            "n_upright": count_upright(estimator.normals_),
            "variation": np.median(results["surface_variation"]),
            "sensor": sensed,
        }

    def written(self, cloud, outcome=None):
        names = self._columns() + ["n_neighbors"] * (self.n_neighbors == "auto")
        blank = dict.fromkeys(names, np.zeros(len(cloud), np.float32))
        return Output(with_results(cloud, blank if outcome is None else outcome.results))

    def tile_options(self):
        return {"sensor_origin": self.asked.path()}

    def rows(self, outcome):
        rows = tiles_row(outcome)
        rows["removed"] = f"{100 * outcome.removed_fraction:.2f} % of an average neighborhood"
        if outcome.n_tiles == 0:  # tiles do not tell it
            rows["surface variation"] = f"{outcome.variation:.2g} (median)"
            rows |= outcome.sensor
        if self.orientation == "none" and outcome.n_upright > SOME_UPRIGHT * outcome.n_points:
            share = f"{100 * outcome.n_upright / outcome.n_points:.0f} % are of upright faces"
            rows["sides"] = f"{share}, to either side by chance; see --orientation sensor and mst"
        return rows

    def contents(self, cloud, outcome):
        from sklearn_mcmd.report._pages import normals_contents
        from sklearn_mcmd.report._shown import Shown

        fitted, results = outcome.estimator, outcome.results
        both = results | {"normal_error": fitted.normal_error_.astype(np.float32)}
        n_neighbors = int(np.median(fitted.n_neighbors_))
        shown = Shown.of_memory(cloud, n_neighbors, fitted.plane_scale_, **both)
        shown = shown._replace(rows=[*shown.rows, *outcome.sensor.items()])
        return normals_contents(shown, results, float(fitted.removed_fraction_.mean()))

    def tile_contents(self, catalog, run):
        from sklearn_mcmd.report._pages import normals_contents

        names = self._columns()
        shown = self.shown(catalog, run, names)
        return normals_contents(shown, names, run.removed_fraction)

    def _columns(self):
        from sklearn_mcmd.tiling._verbs import NORMAL_COLUMNS

        return [*NORMAL_COLUMNS, *self.feature_columns]


normals = command_of(Normals, more=BY_TILES)
