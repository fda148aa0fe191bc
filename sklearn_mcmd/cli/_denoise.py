"""``mcmd denoise``."""

import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

import sklearn_mcmd
from sklearn_mcmd._choices import Mode, OutlierMethod, Strictness
from sklearn_mcmd.cli import _options, _sensor
from sklearn_mcmd.cli._cloud_verb import BY_TILES, CloudVerb, tiles_row
from sklearn_mcmd.cli._files import Output
from sklearn_mcmd.cli._messages import number_and_share
from sklearn_mcmd.cli._options import command_of, length, made, option, parsed
from sklearn_mcmd.io._classes import Choice, class_numbers, noise_classes
from sklearn_mcmd.io._files import one_clear_line
from sklearn_mcmd.io._point_cloud import (
    PointFileError,
    denoised_before,
    with_results,
    without_outliers,
)
from sklearn_mcmd.io._sensor import rows_of_sensor
from sklearn_mcmd.planes._resolution import in_own_precision

PAPER = "paper"  # the level that is None in Python


def _classes(text):
    """Classes, separated by commas."""
    return class_numbers([int(part) for part in text.split(",")])


CLASSES = {"parser": parsed(_classes, "a list of classes, such as 6,9"), "metavar": "CLASSES"}


@dataclass
class Denoise(CloudVerb):
    """The default keeps everything real, of any cloud. A score up to 3 is on a surface or near
    others, 10 is a clear error, 100 a gross one. Points that are not judged stay as they are.
    """

    mode: Mode = option(
        "drop",
        "drop: remove outliers. mark: add outlier_score, and class 7 (low noise) or 18, or an "
        "attribute outlier.",
    )
    n_neighbors: _options.NNeighbors = 50
    method: OutlierMethod = option(
        "mcmd_z",
        "How outliers of a plane are removed before it is fitted. mcmd_z: by their distance to it. "
        "mcmd_md: by their distance within it as well; with --strictness paper it also decides "
        "which points are outliers.",
        hidden=True,
    )
    strictness: Literal[Strictness, "paper"] = option(
        "groups",
        "isolated: single points and pairs. groups: small groups, too; foliage and wires stay. "
        "surfaces: all that is on no surface. paper: all off their own plane.",
    )
    noise_scale: float | None = length(
        None, "Noise of the scanner.", show_default="that around each point"
    )
    cutoff: float | None = option(
        None, "Least score of an outlier; 10 for clear errors.", show_default="3; paper: 2.5, 3.06"
    )
    false_positive_rate: float | None = option(
        None,
        "Share of the points on surfaces that noise may flag, such as 0.01. A simulation then "
        "tells the cutoff; do not give --cutoff. From 0.0001 to below 0.5.",
        metavar="RATE",
        hidden=True,
    )
    contamination: float | None = option(
        None, "Share of outliers, up to 0.5, in place of --cutoff.", metavar="SHARE"
    )
    ignore_class: tuple | None = option(
        None, "Leave points of these classes alone, such as 6,9.", **CLASSES
    )
    only_class: tuple | None = option(
        None, "Judge points of these classes alone.", show_default="all", **CLASSES
    )
    sensor: tuple | None = _sensor.position_option(
        "Where the sensor stood. auto: as stated. none: unknown.",
        _sensor.AUTO,
        _sensor.NONE,
        show_default="if stated or seen",
    )
    trajectory: Path | None = _sensor.trajectory_option()
    intensity: bool = option(
        False, "Take the file's intensity as evidence, too.", "--intensity", hidden=True
    )
    max_outlier_rate: _options.MaxOutlierRate = 0.5

    one_of = ("cutoff", "false_positive_rate", "contamination"), ("sensor", "trajectory")

    def __post_init__(self):
        unknown = self.sensor is None and self.trajectory is None
        sensor = None if self.sensor == _sensor.NONE else self.sensor
        recognize = unknown and self.strictness != PAPER
        self.asked = _sensor.Asked(self.source, sensor, self.trajectory, recognize)
        self.marks = self.writes_all = self.mode == "mark"
        self.results = "marks of outliers" if self.marks else ""
        self.choice = Choice(self.ignore_class or (), self.only_class or ())

    def dry_parameters(self, catalog):
        return {"sensor_origin": "origin" if self.asked.may_be_known(catalog) else None}

    def check_options(self, catalog):
        if self.false_positive_rate is not None:
            from sklearn_mcmd.outliers._calibration import check_rate

            check_rate(self.false_positive_rate)  # before a file is read

    def estimator(self):
        typed = self.sensor if isinstance(self.sensor, tuple) else None
        auto = _sensor.AUTO if self.asked.recognize else None
        return made(
            self,
            sklearn_mcmd.MCMDOutlierDetector,
            strictness=None if self.strictness == PAPER else self.strictness,
            sensor_origin=typed or auto,
        )

    def find(self, cloud, detector):
        from sklearn_mcmd.outliers._detector import EXACT_PLANE_SCORE
        from sklearn_mcmd.report._volumes import losses_of

        if cloud.metadata.get("denoised"):
            warnings.warn(denoised_before(self.source), stacklevel=2)
        used = used_points(self.source, cloud, self.choice)
        used_cloud = cloud if used.all() else cloud.subset(used)
        sensed = self._detect(detector, cloud, used_cloud, used)
        classes, score = _verdict(cloud, used, detector)
        is_outlier = classes != 0
        _warn_if_without_scale(np.sum(score[is_outlier] > EXACT_PLANE_SCORE), len(cloud))
        removed = is_outlier[used]
        together = losses_of(detector, lambda: [(used_cloud.xyz, removed)], len(used_cloud))
        if together:
            warnings.warn(together, stacklevel=2)
        return {
            "used_cloud": used_cloud,
            "used": used,
            "detector": detector,
            "classes": classes,
            "score": score,
            "n_used": len(used_cloud),
            "n_outliers": np.count_nonzero(is_outlier),
            "together": together,
            "sensor": sensed,
        }

    def _detect(self, detector, cloud, used_cloud, used):
        """Let the detector judge the used points; rows on the sensor."""
        from sklearn_mcmd.outliers._detector import judged_cloud
        from sklearn_mcmd.sensors._recognition import surround_origin

        light = _sensor.intensity_of(self.source, cloud)[used] if self.intensity else None
        origins, where, refused = self.asked.of_rays(cloud, used)
        doubted = self.asked.recognize or self.asked.sensor == _sensor.AUTO
        doubted = doubted and origins is not None
        detector.set_params(sensor_origin=_sensor.AUTO if doubted else None)
        detector.fit(in_own_precision(used_cloud.xyz), sensor_origin=origins, intensity=light)
        judged = judged_cloud(detector)
        where = "" if judged.rays is None else where  # it is not used
        surrounded = origins is None and self.asked.recognize and surround_origin(used_cloud.xyz)
        doubt, n_by_rays = refused or judged.ray_doubt, detector.n_by_rays_
        return rows_of_sensor(where, doubt, n_by_rays, surrounded)

    def written(self, cloud, outcome=None):
        n = len(cloud)
        classes = np.zeros(n, np.uint8) if outcome is None else outcome.classes
        score = np.zeros(n, np.float32) if outcome is None else outcome.score.astype(np.float32)
        if self.marks:
            return Output(with_results(cloud, {"outlier_score": score}), classes)
        return Output(without_outliers(cloud, classes == 0))

    def rows(self, outcome):
        rows = {}
        if outcome.n_used < outcome.n_points:
            rows["judged"] = number_and_share(outcome.n_used, outcome.n_points)
        done = "marked" if self.marks else "removed"
        outliers = number_and_share(outcome.n_outliers, outcome.n_points)
        return rows | tiles_row(outcome) | outcome.sensor | {done: outliers}

    def tile_options(self):
        return {
            "mode": self.mode,
            "ignore_classes": self.choice.ignored,
            "only_classes": self.choice.only,
            "sensor_origin": self.asked.path(),
            "intensity": self.intensity,
        }

    def by_tiles(self, catalog, estimator):
        run, contents = super().by_tiles(catalog, estimator)
        _warn_if_without_scale(run.n_exact, run.n_points)
        return run, contents

    def contents(self, cloud, outcome):
        from sklearn_mcmd.report._outliers_page import denoise_contents, plane_scales
        from sklearn_mcmd.report._shown import Shown

        detector, is_outlier = outcome.detector, (outcome.classes != 0)[outcome.used]
        results = {
            "outlier": is_outlier.astype(np.uint8),
            "outlier_score": (-detector.scores_).astype(np.float32),
        }
        scales = plane_scales(detector)
        shown = Shown.of_memory(outcome.used_cloud, detector.n_neighbors_, scales, **results)
        if outcome.n_used < outcome.n_points:
            used = ("used", f"{outcome.n_used:,}, as follows")
            shown = shown._replace(
                rows=[("points", f"{outcome.n_points:,}"), used, *shown.rows[1:]]
            )
        n, cutoff = np.count_nonzero(is_outlier), -float(detector.offset_)
        return denoise_contents(shown, outcome, n, cutoff, marked=self.marks, detector=detector)

    def tile_contents(self, catalog, run):
        from sklearn_mcmd.planes._explaining import ExplainLimits
        from sklearn_mcmd.report._outliers_page import denoise_contents, shown_of_tiles
        from sklearn_mcmd.tiling._outputs import targets_of

        shown = shown_of_tiles(catalog, targets_of(catalog, self.target), run, self.marks)
        found_by_run = (self.contamination, self.false_positive_rate) != (None, None)
        cutoff = self.cutoff
        if cutoff is None and not found_by_run and self.strictness != PAPER:
            cutoff = ExplainLimits().explained
        return denoise_contents(shown, run, run.n_outliers, cutoff, marked=self.marks)


denoise = command_of(Denoise, more=BY_TILES)


def used_points(source, cloud, choice):
    """A mask of the points of a cloud that are judged; errors name its source."""
    with one_clear_line(source, "read"):
        used = choice.of(cloud)
        if used is None:
            used = np.ones(len(cloud), bool)
        if not used.any():
            raise PointFileError("no points are judged: all are withheld or of other classes")
    return used


def _verdict(cloud, used, detector):
    """The class of each outlier as noise, 0 of others; and scores, NaN where none is judged."""
    from sklearn_mcmd.outliers._lowest_points import LowestPoints

    score = np.full(len(cloud), np.nan)
    score[used] = -detector.scores_
    flagged = score > -detector.offset_
    lowest = LowestPoints(len(cloud), detector.n_neighbors or len(cloud))
    return noise_classes(cloud, flagged, used, lowest), score


def _warn_if_without_scale(n_without, n_points):
    """Warn if many points are outliers only because an exact plane has no noise."""
    from sklearn_mcmd.outliers._detector import EXACTLY, MANY_EXACT

    share = n_without / n_points
    if share >= MANY_EXACT:
        warnings.warn(
            f"{100 * share:.1f} % of the points {EXACTLY}, as where coordinates are rounded more "
            "coarsely than the noise; check these before they are dropped (--mode mark)",
            stacklevel=2,
        )
