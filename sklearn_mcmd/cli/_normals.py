"""``mcmd normals``."""

from typing import Annotated, Literal

import numpy as np
import typer

from sklearn_mcmd._choices import RuleMethod
from sklearn_mcmd.cli import _files, _messages, _options, _sensor
from sklearn_mcmd.cli._config import Config
from sklearn_mcmd.cli._large import DryRun, Memory, Restart, large_catalog, print_plan
from sklearn_mcmd.cli._progress_bar import progress
from sklearn_mcmd.cli._reporting import ReportFolder, write_report_of
from sklearn_mcmd.cli._scheduler import Scheduler, engine
from sklearn_mcmd.io._point_cloud import with_results

__all__ = ["normals"]

# Share of normals of upright faces that is worth a line.
SOME_UPRIGHT = 0.05
DIRECTIONS = {"none": None, "up": [0.0, 0.0, 1.0]}


def normals(
    source: _options.InFiles,
    target: _options.OutFiles,
    n_neighbors: _options.NNeighborsOrAuto = 50,
    method: Annotated[
        RuleMethod,
        typer.Option(
            help="How outliers of a neighborhood are found before its plane is fitted. mcmd_z: by "
            "their distance to the plane. mcmd_md: by their distance within it as well. pca: not "
            "at all."
        ),
    ] = "mcmd_z",
    radius: Annotated[
        float | None,
        _options.length_option("Largest distance of a neighbor, in units of the file."),
    ] = None,
    orientation: Annotated[
        Literal["none", "up", "sensor", "mst"],
        typer.Option(
            help="Which of two opposite normals to take. none, up: the one with positive z, which "
            "for upright faces noise decides from point to point. sensor: the one toward --sensor "
            "or --trajectory. mst: the one that agrees with the neighbors."
        ),
    ] = "none",
    sensor: _sensor.SensorOrigin = None,
    trajectory: _sensor.TrajectoryFile = None,
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
    ] = None,
    cutoff: Annotated[
        float | None,
        _options.number_option(
            "Distance from which on a neighbor is an outlier, in robust standard deviations.",
            "2.5, for mcmd_md 3.06",
        ),
    ] = None,
    max_outlier_rate: _options.MaxOutlierRate = 0.5,
    random_state: _options.RandomState = 0,
    n_jobs: _options.NJobs = -1,
    memory: Memory = None,
    scheduler: Scheduler = None,
    dry_run: DryRun = False,
    restart: Restart = False,
    report: ReportFolder = None,
    columns: _options.Columns = None,
    unit: _options.HiddenUnit = "",
    no_clobber: _options.NoClobber = False,
    allow_coarse: _options.AllowCoarse = False,
    config: Config = None,
    quiet: _options.Quiet = False,
) -> None:
    """Add normals, surface variation and eigenvalues, robust to outliers and edges.

    LAS and LAZ that need more than --memory, and folders of them, are divided into tiles, and with
    --scheduler all are. The results are the same. Temporary files lie beside OUT, in OUT.tiles. If
    a run ends early, they are kept, and the same command goes on from there, or begins anew with
    --restart. --dry-run tells tiles, memory and time. If IN is a folder or an index .vpc, a folder
    OUT gets one file for each; an OUT that ends in .las or .laz gets all.

    All points are kept. New attributes, float32, are normal_x, normal_y, normal_z,
    surface_variation (0 on a plane, at most 1/3), eigenvalue_0 to eigenvalue_2
    (ascending), removed_fraction (the share of the neighborhood that was removed), the
    --features, and n_neighbors with --n-neighbors auto.
    """
    _check_sensor(orientation, sensor, trajectory)
    features = _parse_features(features)
    params = {
        "n_neighbors": n_neighbors,
        "method": method,
        "radius": radius,
        "orientation": DIRECTIONS.get(orientation, orientation),
        "sensor_origin": sensor if isinstance(sensor, tuple) else None,
        "features": features,
        "cutoff": cutoff,
        "max_outlier_rate": max_outlier_rate,
        "random_state": random_state,
        "n_jobs": n_jobs,
    }
    with _messages.clear_exits(allow_coarse=allow_coarse), engine(scheduler):
        seconds = _messages.stopwatch()
        n_features = len(_feature_columns(features))
        work = "tree" if orientation == "mst" else "normals"
        work = f"{work}, auto" if n_neighbors == "auto" else work
        work = _sensor.work_of_options(work, sensor, trajectory, rays=False)
        catalog = large_catalog(
            source, memory, n_features, scheduler is not None, columns, work=work
        )
        if dry_run:
            known = params
            if orientation == "sensor":  # positions are not read here
                known = params | {"orientation": None, "sensor_origin": None}
            estimator = _estimator(known)
            print_plan(source, target, catalog, estimator, memory, n_features=n_features, work=work)
            return
        _files.refuse_existing(no_clobber, target, report=report, catalog=catalog)
        if catalog is not None:
            return _by_tiles(
                *(source, target, catalog, params, orientation, sensor, trajectory),
                *(memory, restart, report, quiet, seconds),
            )
        with progress("normals", quiet):
            cloud = _files.read(source, target, "normals", columns=columns)
            names = (*_columns(), *_feature_columns(features), *_size_column(n_neighbors))
            _files.rehearse(target, with_results(cloud, dict.fromkeys(names, _files.blank(cloud))))
            origins = _sensor.sensor_of_options(source, cloud, sensor, trajectory)
            with _files.working(source):
                fitted, results = _find_normals(_files.coordinates(cloud), params, origins)
            _files.write(target, with_results(cloud, results))
            write_report_of(
                report, source, target, seconds, lambda: _contents(cloud, fitted, results)
            )
        if not quiet:
            from sklearn_mcmd.planes._orientation import count_upright

            removed = float(results["removed_fraction"].mean(dtype=np.float64))
            _messages.print_summary(
                *(source, target, len(cloud), seconds()),
                removed=_removed(removed),
                **{"surface variation": f"{np.median(results['surface_variation']):.2g} (median)"}
                | _sides(orientation, count_upright(fitted.normals_), len(cloud)),
            )


def _by_tiles(
    source, target, catalog, params, orientation, sensor, trajectory, memory, restart, report,
    quiet, seconds,
):  # fmt: skip
    from sklearn_mcmd.tiling import process_files

    with progress("normals", quiet):
        told = process_files(
            catalog, target, _estimator(params), memory=memory, n_jobs=params["n_jobs"],
            restart=restart, sensor_origin=_sensor.path_of_options(sensor, trajectory),
        )  # fmt: skip
        write_report_of(
            report, source, target, seconds, lambda: _tile_contents(catalog, target, params, told)
        )
    if not quiet:
        _messages.print_summary(
            *(source, target, told.n_points, seconds()),
            tiles=f"{told.n_tiles:,}, of which {told.n_resumed:,} were done before",
            removed=_removed(told.removed_fraction),
            **_sides(orientation, told.n_upright, told.n_points),
        )


def _tile_contents(catalog, target, params, told):
    from sklearn_mcmd.report._normals import normals_contents
    from sklearn_mcmd.report._shown import Shown
    from sklearn_mcmd.tiling._outputs import targets_of

    names = (*_columns(), *_feature_columns(params["features"]))
    shown = Shown.of_tiles(catalog, targets_of(catalog, target), told, names)
    return normals_contents(shown, names, told.removed_fraction)


def _sides(orientation, n_upright, n_points):
    """The row of the summary that names the option where noise decides the side of many."""
    if orientation != "none" or n_upright <= SOME_UPRIGHT * n_points:
        return {}
    share = f"{100 * n_upright / n_points:.0f} % are of upright faces"
    return {"sides": f"{share}, to either side by chance; see --orientation sensor and mst"}


def _removed(share):
    return f"{100 * share:.2f} % of an average neighborhood"


def _estimator(params):
    from sklearn_mcmd import RobustNormalEstimator

    return RobustNormalEstimator(**params)


def _columns():
    from sklearn_mcmd.tiling._result_files import NORMAL_COLUMNS

    return NORMAL_COLUMNS


def _find_normals(xyz, params, sensor_origin=None):
    """The fitted estimator, and the columns of results by their names."""
    from sklearn_mcmd.tiling._result_files import normal_columns

    fitted = _estimator(params).fit(xyz, sensor_origin=sensor_origin)
    names, columns = normal_columns(fitted)
    return fitted, dict(zip(names, columns.T.copy(), strict=True))


def _contents(cloud, fitted, results):
    from sklearn_mcmd.report._normals import normals_contents
    from sklearn_mcmd.report._shown import Shown

    told = results | {"normal_error": fitted.normal_error_.astype(np.float32)}
    n_neighbors = int(np.median(fitted.n_neighbors_))
    shown = Shown.of_memory(cloud, n_neighbors, fitted.plane_scale_, **told)
    return normals_contents(shown, results, float(fitted.removed_fraction_.mean()))


def _size_column(n_neighbors):
    return ("n_neighbors",) if n_neighbors == "auto" else ()


def _feature_columns(features):
    from sklearn_mcmd.normals._features import feature_columns

    return feature_columns(features, "xyz")


def _check_sensor(orientation, sensor, trajectory):
    """Wrong usage where a position is asked for or given, but not both."""
    given = sensor is not None or trajectory is not None
    if given != (orientation == "sensor"):
        raise typer.BadParameter(
            "--orientation sensor needs --sensor X,Y,Z|auto or --trajectory FILE, and these need "
            "--orientation sensor: give both or neither."
        )
    _sensor.check_one_position(sensor, trajectory)


def _parse_features(text):
    """Names of features; all errors are wrong usage."""
    from sklearn_mcmd.normals._features import settle_features

    names = [part.strip() for part in (text or "").split(",") if part.strip()]
    try:
        return list(settle_features("all" if names == ["all"] else names))
    except ValueError as err:
        raise typer.BadParameter(str(err), param_hint="--features") from err
