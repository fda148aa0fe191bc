"""``mcmd denoise``."""

import warnings
from typing import Annotated, Literal

import numpy as np
import typer

from sklearn_mcmd._choices import Mode, OutlierMethod, Strictness
from sklearn_mcmd.cli import _files, _messages, _options, _point_selection, _sensor
from sklearn_mcmd.cli._config import Config
from sklearn_mcmd.cli._large import DryRun, Memory, Restart, large_catalog, print_plan
from sklearn_mcmd.cli._progress_bar import progress
from sklearn_mcmd.cli._reporting import ReportFolder, write_report_of
from sklearn_mcmd.cli._scheduler import Scheduler, engine
from sklearn_mcmd.io._classes import LOW_NOISE, Choice, noise_classes
from sklearn_mcmd.io._point_cloud import denoised_before, with_results, without_outliers
from sklearn_mcmd.io._sensor import rows_of_sensor

__all__ = ["denoise"]

# Rates of false positives: the least that the simulation resolves in 3D, and the detector's limit.
LEAST_RATE, LARGEST_RATE = 1e-4, 0.5
PAPER = "paper"  # the level that is None in Python


def denoise(
    source: _options.InFiles,
    target: _options.OutFiles,
    mode: Annotated[
        Mode,
        typer.Option(
            help="drop: remove outliers. mark: keep all points, add an 'outlier_score' and mark "
            "outliers: in LAS and LAZ as class 7 (low noise) if they lie lower than all ground "
            "(class 2) around, or without ground than all kept points around, else as class 18 "
            "(high noise), or 7 where the point format has no 18; elsewhere by an attribute "
            "'outlier'."
        ),
    ] = "drop",
    n_neighbors: _options.NNeighbors = 50,
    method: Annotated[
        OutlierMethod,
        typer.Option(
            help="How outliers of a plane are removed before it is fitted. mcmd_z: by their "
            "distance to it. mcmd_md: by their distance within it as well; with --strictness paper "
            "it also decides which points are outliers.",
            hidden=True,
        ),
    ] = "mcmd_z",
    strictness: Annotated[
        Literal[Strictness, "paper"],
        typer.Option(
            help="Which points are outliers. isolated: single points and pairs far from everything "
            "else. groups: also small groups that stand apart, such as ghosts, birds and dust; "
            "foliage, wires and small things that touch others are kept, unless they are more than "
            "three times as sparse as the surfaces around. surfaces: all points that lie on no "
            "surface; foliage, wires and thin posts are removed. paper: points off the plane of "
            "their own neighborhood, as in the paper; weak on whole clouds."
        ),
    ] = "groups",
    noise_scale: Annotated[
        float | None,
        _options.length_option(
            "The scanner's standard deviation, in units of the file. Distances to surfaces "
            "are divided by it.",
            "the noise around each point",
        ),
    ] = None,
    cutoff: Annotated[
        float | None,
        _options.number_option(
            "Score above which a point is an outlier. 3: the point is three standard "
            "deviations of the noise off the surfaces, and three usual spacings, or sizes of its "
            "group, away from everything real. 10: ten of each, for clear errors only. 100: for "
            "gross errors only.",
            "3; with --strictness paper 2.5, for mcmd_md 3.06",
        ),
    ] = None,
    false_positive_rate: Annotated[
        float | None,
        _options.number_option(
            "Share of the points on surfaces that noise may flag, such as 0.01. A simulation "
            "then tells the cutoff; do not give --cutoff. From 0.0001 to below 0.5.",
            metavar="RATE",
            hidden=True,
            expected=f"a number from {LEAST_RATE:g} to below {LARGEST_RATE:g}",
            fits=lambda rate: LEAST_RATE <= rate < LARGEST_RATE,
        ),
    ] = None,
    contamination: Annotated[
        float | None,
        _options.number_option(
            "Share of all points that are outliers: those of the highest scores. Do not give "
            "--cutoff. Above 0, up to 0.5.",
            metavar="SHARE",
            expected=f"a number above 0 and up to {LARGEST_RATE:g}",
            fits=lambda share: 0 < share <= LARGEST_RATE,
        ),
    ] = None,
    ignore_class: _point_selection.IgnoreClass = None,
    only_class: _point_selection.OnlyClass = None,
    above: _point_selection.Above = None,
    below: _point_selection.Below = None,
    low_groups: _point_selection.LowGroups = False,
    sensor: _sensor.SensorOrView = None,
    trajectory: _sensor.TrajectoryFile = None,
    intensity: _sensor.Intensity = False,
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
    """Remove or mark the points that lie on no surface and stand apart from all else.

    The default keeps everything real, and is for any cloud: curved, with foliage and wires, of any
    spacing and noise. To keep only faces, give --strictness surfaces. A score up to 3 means that
    the point is on a surface or near other points, 10 means a clear error, and 100 a gross error.

    Points that are marked withheld are neither judged nor used to judge others. With
    --ignore-class, --only-class, --above and --below, others are not judged either. All of these
    stay in the file, as they are.

    LAS and LAZ that need more than --memory, and folders of them, are divided into tiles, and with
    --scheduler all are. The results are the same. Temporary files lie beside OUT, in OUT.tiles. If
    a run ends early, they are kept, and the same command goes on from there, or begins anew with
    --restart. --dry-run tells tiles, memory and time. If IN is a folder or an index .vpc, a folder
    OUT gets one file for each; an OUT that ends in .las or .laz gets all.
    """
    _at_most_one(
        {
            "--cutoff": cutoff,
            "--false-positive-rate": false_positive_rate,
            "--contamination": contamination,
        }
    )
    _sensor.check_one_position(sensor, trajectory)
    recognize = sensor is None and trajectory is None and strictness != PAPER
    sensor = None if sensor == _sensor.NONE else sensor
    params: dict = {
        "n_neighbors": n_neighbors,
        "method": method,
        "strictness": None if strictness == PAPER else strictness,
        "noise_scale": noise_scale,
        "cutoff": cutoff,
        "false_positive_rate": false_positive_rate,
        "contamination": contamination,
        "max_outlier_rate": max_outlier_rate,
        "random_state": random_state,
        "n_jobs": n_jobs,
    }
    with _messages.clear_exits(allow_coarse=allow_coarse), engine(scheduler):
        seconds = _messages.stopwatch()
        choice = Choice(ignore_class or (), only_class or ())
        heights = {"above": above, "below": below, "low_groups": low_groups}
        work = "heights" if low_groups or above is not None or below is not None else "outliers"
        work = _sensor.work_of_options(work, sensor, trajectory, rays=True)
        work = _sensor.work_if_seen(work, source) if recognize else work
        catalog = large_catalog(source, memory, 0, scheduler is not None, columns, work=work)
        if intensity and catalog is not None:
            raise ValueError(f"{source}: tiles take no --intensity; a file within --memory does")
        if dry_run:
            rays = "rays" in work  # positions are not read here
            estimator = _detector(params | {"sensor_origin": "origin" if rays else None})
            print_plan(source, target, catalog, estimator, memory, work=work)
            return
        _files.refuse_existing(no_clobber, target, report=report, catalog=catalog)
        if catalog is not None:
            return _by_tiles(
                *(source, target, catalog, params, choice, heights, mode, memory, restart),
                *(report, quiet, seconds, sensor, trajectory, recognize),
            )
        from sklearn_mcmd.outliers._volumes import losses_of

        with progress("denoise", quiet):
            mark = mode == "mark"
            cloud = _files.read(
                source, target, "marks of outliers" if mark else None, columns=columns
            )
            if cloud.metadata.get("denoised"):
                warnings.warn(denoised_before(source), stacklevel=2)
            points = _point_selection.judged_points(source, cloud, choice, above, below, low_groups)
            nothing = _files.blank(cloud)
            _files.rehearse(
                target, *_denoised(cloud, nothing.astype(np.uint8), nothing, mark), whole=mark
            )
            some = cloud if points.used.all() else cloud.subset(points.used)
            light = _sensor.intensity_of(source, cloud)[points.used] if intensity else None
            with _files.working(source):
                origins, where, refused = _sensor.sensor_of_rays(
                    source, cloud, points.used, sensor, trajectory, recognize
                )
                if origins is not None and (recognize or sensor == _sensor.AUTO):
                    params["sensor_origin"] = _sensor.AUTO  # which doubts what it is given
                detector = _find_outliers(_files.coordinates(some), origins, light, **params)
            sensed = _sensed(detector, where, refused)
            classes, score, under = _verdict(cloud, points, detector, low_groups)
            is_outlier = classes != 0
            _warn_if_without_scale(_n_without_scale(score[is_outlier]), len(cloud))
            removed = (is_outlier & ~under)[points.used]
            together = losses_of(detector, lambda: [(some.xyz, removed)], len(some))
            if together:
                warnings.warn(together, stacklevel=2)
            _files.write(target, *_denoised(cloud, classes, score, mark))
            write_report_of(
                report, source, target, seconds,
                lambda: _contents(
                    some, detector, mark, is_outlier[points.used], len(cloud), together, sensed
                ),
            )  # fmt: skip
        if not quiet:
            judged = (
                {} if points.judged.all() else {"judged": _messages.count_and_share(points.judged)}
            )
            found = {"marked" if mark else "removed": _messages.count_and_share(is_outlier)}
            judged |= sensed
            _messages.print_summary(source, target, len(cloud), seconds(), **judged, **found)


def _by_tiles(
    source, target, catalog, params, choice, heights, mode, memory, restart, report, quiet, seconds,
    sensor, trajectory, recognize,
):  # fmt: skip
    from sklearn_mcmd.tiling import process_files

    position = sensor if isinstance(sensor, tuple) else _sensor.AUTO if recognize else None
    with progress("denoise", quiet):
        told = process_files(
            catalog, target, _detector(params | {"sensor_origin": position}), mode=mode,
            memory=memory, sensor_origin=_sensor.path_of_options(sensor, trajectory),
            n_jobs=params["n_jobs"], restart=restart, ignore_classes=choice.ignored,
            only_classes=choice.only, **heights,
        )  # fmt: skip
        write_report_of(
            report, source, target, seconds,
            lambda: _tile_contents(catalog, target, params, told, mode == "mark"),
        )  # fmt: skip
    _warn_if_without_scale(told.n_exact, told.n_points)
    if not quiet:
        found = _messages.number_and_share(told.n_outliers, told.n_points)
        judged = {"judged": _messages.number_and_share(told.n_judged, told.n_points)}
        _messages.print_summary(
            *(source, target, told.n_points, seconds()),
            **(judged if told.n_judged < told.n_points else {}),
            tiles=f"{told.n_tiles:,}, of which {told.n_resumed:,} were done before",
            **told.sensor,
            **{"marked" if mode == "mark" else "removed": found},
        )


def _tile_contents(catalog, target, params, told, mark):
    from sklearn_mcmd.outliers._detector import CUTOFF
    from sklearn_mcmd.report._denoise import Verdict, denoise_contents, shown_of_tiles
    from sklearn_mcmd.tiling._outputs import targets_of

    shown = shown_of_tiles(catalog, targets_of(catalog, target), told, mark)
    found_by_run = (params["contamination"], params["false_positive_rate"]) != (None, None)
    cutoff = params["cutoff"]
    if cutoff is None and not found_by_run and params["strictness"] is not None:
        cutoff = CUTOFF
    n_others = told.n_points - told.n_used
    verdict = Verdict(told.n_outliers, told.n_used, n_others, cutoff, told.sensor)
    return denoise_contents(shown, verdict, marked=mark, together=told.together)


def _at_most_one(options):
    """Wrong usage where more than one of some options, by their names, has a value."""
    given = [f"{name} {value:g}" for name, value in options.items() if value is not None]
    if len(given) > 1:
        raise typer.BadParameter(
            f"{' and '.join(given)} exclude each other: leave all but one out."
        )


def _detector(params):
    from sklearn_mcmd import MCMDOutlierDetector

    return MCMDOutlierDetector(**params)


def _sensed(detector, where, refused):
    """The rows on the sensor, which `rows_of_sensor` makes; "" is what is not used."""
    from sklearn_mcmd.outliers._kinds import judged_cloud

    judged = judged_cloud(detector)
    where = "" if judged.rays is None else where
    return rows_of_sensor(where, refused or judged.ray_doubt, detector.n_by_rays_)


def _find_outliers(xyz, origins=None, intensity=None, **params):
    """The fitted detector."""
    return _detector(params).fit(xyz, sensor_origin=origins, intensity=intensity)


def _verdict(cloud, points, detector, low_groups):
    """The class of each outlier as noise, 0 of others; scores, NaN where none is judged; and which
    points are in groups below the ground."""
    score, cutoff = np.full(len(cloud), np.nan), -detector.offset_
    score[points.used] = -detector.scores_
    under = np.zeros(len(cloud), bool)
    if low_groups:
        from sklearn_mcmd.io._ground import depths_of_groups

        depths = depths_of_groups(cloud.xyz, points.ground, points.judged)
        under = depths > cutoff
        score = np.maximum(score, depths)
    flagged = score > cutoff
    score[~points.judged] = np.nan
    classes = noise_classes(
        cloud, flagged & points.judged, flagged, points.used,
        detector.n_neighbors or len(cloud),
    )  # fmt: skip
    classes[under] = LOW_NOISE
    return classes, score, under


def _contents(cloud, detector, mark, found, n_all, together, sensed):
    from sklearn_mcmd.outliers._kinds import plane_scales
    from sklearn_mcmd.report._denoise import Verdict, denoise_contents
    from sklearn_mcmd.report._shown import Shown

    shown = Shown.of_memory(
        cloud, detector.n_neighbors_, plane_scales(detector), outlier=found.astype(np.uint8),
        outlier_score=(-detector.scores_).astype(np.float32),
    )  # fmt: skip
    n_others = n_all - len(cloud)
    if n_others:
        rows = [("points", f"{n_all:,}"), ("used", f"{len(cloud):,}, as follows"), *shown.rows[1:]]
        shown = shown._replace(rows=rows)
    n_found, cutoff = np.count_nonzero(found), -float(detector.offset_)
    verdict = Verdict(n_found, len(cloud), n_others, cutoff, sensed)
    return denoise_contents(shown, verdict, marked=mark, together=together, judged=[detector])


def _n_without_scale(scores):
    from sklearn_mcmd.outliers._detector import EXACT_PLANE_SCORE

    return np.count_nonzero(scores > EXACT_PLANE_SCORE)


def _warn_if_without_scale(n_without, n_points):
    """Warn if many points are outliers only because an exact plane has no noise."""
    share = n_without / n_points
    if share >= 0.01:
        warnings.warn(
            f"{100 * share:.1f} % of the points are outliers only because most of their neighbors "
            "lie exactly in one plane, as where coordinates are rounded more coarsely than the "
            "noise; check these before they are dropped (--mode mark)",
            stacklevel=2,
        )


def _denoised(cloud, classes, score, mark):
    """The cloud to write, and the classes of noise to mark in it."""
    if not mark:
        return without_outliers(cloud, classes == 0), None
    return with_results(cloud, {"outlier_score": score.astype(np.float32)}), classes
