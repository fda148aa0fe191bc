"""``mcmd denoise``."""

import warnings
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
import typer

import sklearn_mcmd
from sklearn_mcmd._choices import Mode, OutlierMethod, Strictness
from sklearn_mcmd.cli import _files, _options, _point_selection, _sensor
from sklearn_mcmd.cli._cloud_verb import CloudVerb, command_of, counts, tiles_row
from sklearn_mcmd.cli._large import outputs_of
from sklearn_mcmd.cli._messages import number_and_share
from sklearn_mcmd.io._classes import LOW_NOISE, Choice, noise_classes
from sklearn_mcmd.io._point_cloud import denoised_before, with_results, without_outliers
from sklearn_mcmd.io._sensor import rows_of_sensor

__all__ = ["denoise"]

# Rates of false positives: the least that the simulation resolves in 3D, and the detector's limit.
LEAST_RATE, LARGEST_RATE = 1e-4, 0.5
PAPER = "paper"  # the level that is None in Python


@dataclass
class Denoise(CloudVerb):
    """Remove or mark the points that lie on no surface and stand apart from all else.

    The default keeps everything real, and is for any cloud: curved, with foliage and wires, of any
    spacing and noise. To keep only faces, give --strictness surfaces. A score up to 3 means that
    the point is on a surface or near other points, 10 means a clear error, and 100 a gross error.

    Points that are marked withheld are neither judged nor used to judge others. With
    --ignore-class, --only-class, --above and --below, others are not judged either. All of these
    stay in the file, as they are.
    """

    mode: Annotated[
        Mode,
        typer.Option(
            help="drop: remove outliers. mark: keep all points, add an 'outlier_score' and mark "
            "outliers: in LAS and LAZ as class 7 (low noise) if they lie lower than all ground "
            "(class 2) around, or without ground than all kept points around, else as class 18 "
            "(high noise), or 7 where the point format has no 18; elsewhere by an attribute "
            "'outlier'."
        ),
    ] = "drop"
    n_neighbors: _options.NNeighbors = 50
    method: Annotated[
        OutlierMethod,
        typer.Option(
            help="How outliers of a plane are removed before it is fitted. mcmd_z: by their "
            "distance to it. mcmd_md: by their distance within it as well; with --strictness paper "
            "it also decides which points are outliers.",
            hidden=True,
        ),
    ] = "mcmd_z"
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
    ] = "groups"
    noise_scale: Annotated[
        float | None,
        _options.length_option(
            "The scanner's standard deviation, in units of the file. Distances to surfaces "
            "are divided by it.",
            "the noise around each point",
        ),
    ] = None
    cutoff: Annotated[
        float | None,
        _options.number_option(
            "Score above which a point is an outlier. 3: the point is three standard "
            "deviations of the noise off the surfaces, and three usual spacings, or sizes of its "
            "group, away from everything real. 10: ten of each, for clear errors only. 100: for "
            "gross errors only.",
            "3; with --strictness paper 2.5, for mcmd_md 3.06",
        ),
    ] = None
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
    ] = None
    contamination: Annotated[
        float | None,
        _options.number_option(
            "Share of all points that are outliers: those of the highest scores. Do not give "
            "--cutoff. Above 0, up to 0.5.",
            metavar="SHARE",
            expected=f"a number above 0 and up to {LARGEST_RATE:g}",
            fits=lambda share: 0 < share <= LARGEST_RATE,
        ),
    ] = None
    ignore_class: _point_selection.IgnoreClass = None
    only_class: _point_selection.OnlyClass = None
    above: _point_selection.Above = None
    below: _point_selection.Below = None
    low_groups: _point_selection.LowGroups = False
    sensor: _sensor.SensorOrView = None
    trajectory: _sensor.TrajectoryFile = None
    intensity: _sensor.Intensity = False
    max_outlier_rate: _options.MaxOutlierRate = 0.5
    random_state: _options.RandomState = 0
    n_jobs: _options.NJobs = -1

    def __post_init__(self):
        _at_most_one(self, "cutoff", "false_positive_rate", "contamination")
        _sensor.check_one_position(self.sensor, self.trajectory)
        unknown = self.sensor is None and self.trajectory is None
        self.recognize = unknown and self.strictness != PAPER
        self.sensor = None if self.sensor == _sensor.NONE else self.sensor
        self.mark = self.mode == "mark"
        self.choice = Choice(self.ignore_class or (), self.only_class or ())
        limits = {"above": self.above, "below": self.below}
        self.heights = limits | {"low_groups": self.low_groups}
        by_height = self.low_groups or any(limit is not None for limit in limits.values())
        work = "heights" if by_height else "outliers"
        work = _sensor.work_of_options(work, self.sensor, self.trajectory, rays=True)
        self.work = _sensor.work_if_seen(work, self.source) if self.recognize else work

    def check(self, catalog):
        if self.intensity and catalog is not None:
            raise ValueError(
                f"{self.source}: tiles take no --intensity; a file within --memory does"
            )

    def estimator(self):
        auto = _sensor.AUTO if self.recognize else None
        return self.made(
            sklearn_mcmd.MCMDOutlierDetector,
            strictness=None if self.strictness == PAPER else self.strictness,
            sensor_origin=self.sensor if isinstance(self.sensor, tuple) else auto,
        )

    def dry_estimator(self):
        origin = "origin" if "rays" in self.work else None
        return self.estimator().set_params(sensor_origin=origin)

    def in_memory(self):
        from sklearn_mcmd.outliers._detector import EXACT_PLANE_SCORE
        from sklearn_mcmd.report._volumes import losses_of

        cloud = self.read("marks of outliers" if self.mark else None)
        if cloud.metadata.get("denoised"):
            warnings.warn(denoised_before(self.source), stacklevel=2)
        points = _point_selection.judged_points(self.source, cloud, self.choice, **self.heights)
        nothing = _files.blank(cloud)
        blank = _denoised(cloud, nothing.astype(np.uint8), nothing, self.mark)
        _files.rehearse(self.target, *blank, whole=self.mark)
        some = cloud if points.used.all() else cloud.subset(points.used)
        detector, sensed = self._find(cloud, some, points.used)
        classes, score, under = _verdict(cloud, points, detector, self.low_groups)
        is_outlier = classes != 0
        _warn_if_without_scale(np.sum(score[is_outlier] > EXACT_PLANE_SCORE), len(cloud))
        removed = (is_outlier & ~under)[points.used]
        together = losses_of(detector, lambda: [(some.xyz, removed)], len(some))
        if together:
            warnings.warn(together, stacklevel=2)
        told = counts(
            len(cloud), n_judged=np.count_nonzero(points.judged),
            n_outliers=np.count_nonzero(is_outlier), together=together, sensor=sensed,
        )  # fmt: skip
        found = is_outlier[points.used]
        _files.write(self.target, *_denoised(cloud, classes, score, self.mark))
        return told, lambda: _contents(some, detector, self.mark, found, told)

    def _find(self, cloud, some, used):
        """The detector that judged some of the points, and rows on the sensor."""
        from sklearn_mcmd.outliers._detector import judged_cloud

        light = _sensor.intensity_of(self.source, cloud)[used] if self.intensity else None
        with _files.working(self.source):
            origins, where, refused = _sensor.sensor_of_rays(
                self.source, cloud, used, self.sensor, self.trajectory, self.recognize
            )
            doubted = origins is not None and (self.recognize or self.sensor == _sensor.AUTO)
            detector = self.estimator().set_params(sensor_origin=_sensor.AUTO if doubted else None)
            detector.fit(_files.coordinates(some), sensor_origin=origins, intensity=light)
        judged = judged_cloud(detector)
        where = "" if judged.rays is None else where  # it is not used
        return detector, rows_of_sensor(where, refused or judged.ray_doubt, detector.n_by_rays_)

    def rows(self, told):
        rows = {}
        if told.n_judged < told.n_points:
            rows["judged"] = number_and_share(told.n_judged, told.n_points)
        found = number_and_share(told.n_outliers, told.n_points)
        return rows | tiles_row(told) | told.sensor | {"marked" if self.mark else "removed": found}

    def tile_options(self):
        return self.heights | {
            "mode": self.mode,
            "ignore_classes": self.choice.ignored,
            "only_classes": self.choice.only,
            "sensor_origin": _sensor.path_of_options(self.sensor, self.trajectory),
        }

    def by_tiles(self, catalog):
        told, contents = super().by_tiles(catalog)
        _warn_if_without_scale(told.n_exact, told.n_points)
        return told, contents

    def tile_contents(self, catalog, told):
        from sklearn_mcmd.planes._explaining import ExplainLimits
        from sklearn_mcmd.report._outliers_page import Verdict, denoise_contents, shown_of_tiles

        shown = shown_of_tiles(catalog, outputs_of(catalog, self.target), told, self.mark)
        found_by_run = (self.contamination, self.false_positive_rate) != (None, None)
        cutoff = self.cutoff
        if cutoff is None and not found_by_run and self.strictness != PAPER:
            cutoff = ExplainLimits().explained
        n_others = told.n_points - told.n_used
        verdict = Verdict(told.n_outliers, told.n_used, n_others, cutoff, told.sensor)
        return denoise_contents(shown, verdict, marked=self.mark, together=told.together)


denoise = command_of(Denoise)


def _at_most_one(verb, *names):
    """Wrong usage where more than one of some options has a value."""
    values = {f"--{name.replace('_', '-')}": getattr(verb, name) for name in names}
    given = [f"{name} {value:g}" for name, value in values.items() if value is not None]
    if len(given) > 1:
        raise typer.BadParameter(
            f"{' and '.join(given)} exclude each other: leave all but one out."
        )


def _verdict(cloud, points, detector, low_groups):
    """The class of each outlier as noise, 0 of others; scores, NaN where none is judged; and which
    points are in groups below the ground."""
    from sklearn_mcmd.outliers._lowest_points import LowestPoints

    score, cutoff = np.full(len(cloud), np.nan), -detector.offset_
    score[points.used] = -detector.scores_
    under = np.zeros(len(cloud), bool)
    if low_groups:
        from sklearn_mcmd.io._ground import Ground
        from sklearn_mcmd.outliers._low_groups import depths_of_groups

        ground = Ground(cloud.xyz[points.ground])
        depths = depths_of_groups(cloud.xyz, ground, points.judged)
        under = depths > cutoff
        score = np.maximum(score, depths)
    flagged = score > cutoff
    score[~points.judged] = np.nan
    lowest = LowestPoints(len(cloud), detector.n_neighbors or len(cloud))
    classes = noise_classes(cloud, flagged & points.judged, flagged, points.used, lowest)
    classes[under] = LOW_NOISE
    return classes, score, under


def _contents(cloud, detector, mark, found, told):
    from sklearn_mcmd.report._kinds import plane_scales
    from sklearn_mcmd.report._outliers_page import Verdict, denoise_contents
    from sklearn_mcmd.report._shown import Shown

    shown = Shown.of_memory(
        cloud, detector.n_neighbors_, plane_scales(detector), outlier=found.astype(np.uint8),
        outlier_score=(-detector.scores_).astype(np.float32),
    )  # fmt: skip
    n_others = told.n_points - len(cloud)
    if n_others:
        rows = [
            ("points", f"{told.n_points:,}"),
            ("used", f"{len(cloud):,}, as follows"),
            *shown.rows[1:],
        ]
        shown = shown._replace(rows=rows)
    n_found, cutoff = np.count_nonzero(found), -float(detector.offset_)
    verdict = Verdict(n_found, len(cloud), n_others, cutoff, told.sensor)
    return denoise_contents(shown, verdict, marked=mark, together=told.together, judged=[detector])


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
