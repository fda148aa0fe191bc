"""``mcmd normals``."""

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
import typer

import sklearn_mcmd
from sklearn_mcmd._choices import RuleMethod
from sklearn_mcmd.cli import _files, _options, _sensor
from sklearn_mcmd.cli._cloud_verb import CloudVerb, command_of, counts, tiles_row
from sklearn_mcmd.io._point_cloud import with_results

__all__ = ["normals"]

# Share of normals of upright faces that is worth a line.
SOME_UPRIGHT = 0.05
DIRECTIONS = {"none": None, "up": [0.0, 0.0, 1.0]}


@dataclass
class Normals(CloudVerb):
    """Add normals, surface variation and eigenvalues, robust to outliers and edges.

    All points are kept. New attributes, float32, are normal_x, normal_y, normal_z,
    surface_variation (0 on a plane, at most 1/3), eigenvalue_0 to eigenvalue_2
    (ascending), removed_fraction (the share of the neighborhood that was removed), the
    --features, and n_neighbors with --n-neighbors auto.
    """

    n_neighbors: _options.NNeighborsOrAuto = 50
    method: Annotated[
        RuleMethod,
        typer.Option(
            help="How outliers of a neighborhood are found before its plane is fitted. mcmd_z: by "
            "their distance to the plane. mcmd_md: by their distance within it as well. pca: not "
            "at all."
        ),
    ] = "mcmd_z"
    radius: Annotated[
        float | None,
        _options.length_option("Largest distance of a neighbor, in units of the file."),
    ] = None
    orientation: Annotated[
        Literal["none", "up", "sensor", "mst"],
        typer.Option(
            help="Which of two opposite normals to take. none, up: the one with positive z, which "
            "for upright faces noise decides from point to point. sensor: the one toward --sensor "
            "or --trajectory. mst: the one that agrees with the neighbors."
        ),
    ] = "none"
    sensor: _sensor.SensorOrigin = None
    trajectory: _sensor.TrajectoryFile = None
    features: Annotated[
        str | None,
        typer.Option(
            metavar="NAME,...",
            help="Further attributes, or all of them: linearity, planarity, sphericity, "
            "omnivariance, anisotropy, eigenentropy, verticality, roughness, normal_error (in "
            "degrees; the true normal is within 1.73 errors with 95 % confidence); "
            "mean_curvature, gaussian_curvature, max_curvature, min_curvature, shape_index, "
            "mean_curvature_error, max_curvature_error, min_curvature_error, "
            "max_curvature_direction, min_curvature_direction (three attributes each). "
            "Curvatures are in one over units of the file, and positive where the surface bends "
            "to the side of its normal.",
        ),
    ] = None
    cutoff: Annotated[
        float | None,
        _options.number_option(
            "Distance from which on a neighbor is an outlier, in robust standard deviations.",
            "2.5, for mcmd_md 3.06",
        ),
    ] = None
    max_outlier_rate: _options.MaxOutlierRate = 0.5
    random_state: _options.RandomState = 0
    n_jobs: _options.NJobs = -1

    def __post_init__(self):
        given = self.sensor is not None or self.trajectory is not None
        if given != (self.orientation == "sensor"):
            raise typer.BadParameter(
                "--orientation sensor needs --sensor X,Y,Z|auto or --trajectory FILE, and these "
                "need --orientation sensor: give both or neither."
            )
        _sensor.check_one_position(self.sensor, self.trajectory)
        self.features = _parse_features(self.features)
        self.n_features = len(_feature_columns(self.features))
        work = "tree" if self.orientation == "mst" else "normals"
        work = f"{work}, auto" if self.n_neighbors == "auto" else work
        self.work = _sensor.work_of_options(work, self.sensor, self.trajectory, rays=False)

    def estimator(self):
        return self.made(
            sklearn_mcmd.RobustNormalEstimator,
            orientation=DIRECTIONS.get(self.orientation, self.orientation),
            sensor_origin=self.sensor if isinstance(self.sensor, tuple) else None,
        )

    def dry_estimator(self):
        estimator = self.estimator()
        if self.orientation == "sensor":
            estimator.set_params(orientation=None, sensor_origin=None)
        return estimator

    def in_memory(self):
        from sklearn_mcmd.planes._orientation import count_upright

        cloud = self.read("normals")
        sizes = ["n_neighbors"] if self.n_neighbors == "auto" else []
        blanks = dict.fromkeys([*self._columns(), *sizes], _files.blank(cloud))
        _files.rehearse(self.target, with_results(cloud, blanks))
        origins, sensed = _sensor.sensor_of_normals(
            self.source, cloud, self.sensor, self.trajectory
        )
        with _files.working(self.source):
            fitted = self.estimator().fit(_files.coordinates(cloud), sensor_origin=origins)
            results = _results(fitted)
        told = counts(
            len(cloud),
            removed_fraction=results["removed_fraction"].mean(dtype=np.float64),
            n_upright=count_upright(fitted.normals_),
            variation=np.median(results["surface_variation"]),
            sensor=sensed,
        )
        _files.write(self.target, with_results(cloud, results))
        return told, lambda: _contents(cloud, fitted, results, sensed)

    def tile_options(self):
        return {"sensor_origin": _sensor.path_of_options(self.sensor, self.trajectory)}

    def rows(self, told):
        rows = tiles_row(told)
        rows["removed"] = f"{100 * told.removed_fraction:.2f} % of an average neighborhood"
        if told.n_tiles == 0:  # tiles do not tell it
            rows["surface variation"] = f"{told.variation:.2g} (median)"
            rows |= told.sensor
        if self.orientation == "none" and told.n_upright > SOME_UPRIGHT * told.n_points:
            share = f"{100 * told.n_upright / told.n_points:.0f} % are of upright faces"
            rows["sides"] = f"{share}, to either side by chance; see --orientation sensor and mst"
        return rows

    def tile_contents(self, catalog, told):
        from sklearn_mcmd.report._normals_page import normals_contents

        names = self._columns()
        shown = self.shown(catalog, told, *names)
        return normals_contents(shown, names, told.removed_fraction)

    def _columns(self):
        from sklearn_mcmd.tiling._result_files import NORMAL_COLUMNS

        return (*NORMAL_COLUMNS, *_feature_columns(self.features))


normals = command_of(Normals)


def _results(fitted):
    """The columns of results by their names."""
    from sklearn_mcmd.tiling._result_files import normal_columns

    names, columns = normal_columns(fitted)
    return dict(zip(names, columns.T.copy(), strict=True))


def _contents(cloud, fitted, results, sensed):
    from sklearn_mcmd.report._normals_page import normals_contents
    from sklearn_mcmd.report._shown import Shown

    told = results | {"normal_error": fitted.normal_error_.astype(np.float32)}
    n_neighbors = int(np.median(fitted.n_neighbors_))
    shown = Shown.of_memory(cloud, n_neighbors, fitted.plane_scale_, **told)
    shown = shown._replace(rows=[*shown.rows, *sensed.items()])
    return normals_contents(shown, results, float(fitted.removed_fraction_.mean()))


def _feature_columns(features):
    from sklearn_mcmd.normals._features import feature_columns

    return feature_columns(features, "xyz")


def _parse_features(text):
    """Names of features; all errors are wrong usage."""
    from sklearn_mcmd.normals._features import check_features

    names = [part.strip() for part in (text or "").split(",") if part.strip()]
    try:
        return list(check_features("all" if names == ["all"] else names))
    except ValueError as err:
        raise typer.BadParameter(str(err), param_hint="--features") from err
