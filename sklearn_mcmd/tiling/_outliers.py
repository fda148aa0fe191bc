"""Outliers of clouds larger than memory."""

from collections.abc import Sequence

import numpy as np
from sklearn.base import clone

from sklearn_mcmd._choices import Mode, choices_of
from sklearn_mcmd._errors import warn_caller
from sklearn_mcmd._validation import check_sensor_origin, is_auto
from sklearn_mcmd.io._classes import Choice, classes_of_noise, ground_in
from sklearn_mcmd.io._las import is_denoised, read_header
from sklearn_mcmd.io._point_cloud import denoised_before, with_results, without_outliers
from sklearn_mcmd.io._sensor import place_words, rows_of_sensor
from sklearn_mcmd.outliers import MCMDOutlierDetector
from sklearn_mcmd.outliers._calibration import calibrated_cutoff, check_rate, roughness_of
from sklearn_mcmd.outliers._detector import EXACT_PLANE_SCORE, judged_cloud, share_to_flag
from sklearn_mcmd.outliers._intensity import telling_of
from sklearn_mcmd.outliers._lowest_points import LowestPoints
from sklearn_mcmd.outliers._model import n_by_rays, warn_of_doubt
from sklearn_mcmd.outliers._ray_evidence import doubt_of
from sklearn_mcmd.planes._around import quantile_of
from sklearn_mcmd.report._volumes import losses_of
from sklearn_mcmd.runtime._progress import progress_part
from sklearn_mcmd.tiling._base import TiledVerb, check_estimator, warm_up
from sklearn_mcmd.tiling._beside import (
    LightWriter,
    find_beams,
    recognized,
    sensor_path,
    stored_origins,
)
from sklearn_mcmd.tiling._catalog import parts_of
from sklearn_mcmd.tiling._halo import HOPS, HOPS_MORE, WIDTH

RINGS = HOPS + HOPS_MORE
AGAIN = "again"  # the task that finds scores without the rays that the first has followed


class TiledOutliers(TiledVerb):
    """Outliers; points without scores are kept."""

    names: Sequence[str] = ("scores",)

    def __init__(
        self,
        estimator,
        mode="drop",
        ignore_classes=(),
        only_classes=(),
        sensor_origin=None,
        intensity=False,
    ):
        if mode not in choices_of(Mode):
            raise ValueError(f"mode={mode!r} must be 'drop' or 'mark'.")
        check_estimator(estimator, MCMDOutlierDetector)
        estimator._check_choices(None, True if intensity else None)
        super().__init__(estimator, choice=Choice(ignore_classes, only_classes))
        self.mode, self.intensity = mode, intensity
        self.sensor = sensor_path(estimator, sensor_origin)

    def prepare(self, catalog):
        for path in catalog.paths:
            if is_denoised(read_header(path)):
                warn_caller(denoised_before(path))
        self.detector, self.seen_as = recognized(self.estimator, catalog, self.choice)
        if self.sensor.moves:  # any position will do
            self.detector = clone(self.detector).set_params(sensor_origin="origin")
        elif self.detector.sensor_origin is not None:
            known = "origin" if self.seen_as else self.detector.sensor_origin
            self.center = check_sensor_origin(known, np.full((1, 3), np.nan))[0]
        check_rate(self.detector.false_positive_rate)
        # Cells find scores alone: which are outliers is decided for all of them.
        cutoffs = dict.fromkeys(("cutoff", "false_positive_rate", "contamination"))
        self.scoring = clone(self.detector).set_params(**cutoffs)
        seen_from = None if self.detector.sensor_origin is None else "origin"
        fitted = warm_up(clone(self.scoring).set_params(sensor_origin=seen_from))
        given = self.detector.cutoff
        self.cutoff = -fitted.offset_ if given is None else float(given)

    def beside(self, folder):
        return super().beside(folder) + ([LightWriter(folder)] if self.intensity else [])

    def measure_fit(self, xyz):
        given = {}
        if self.detector.sensor_origin is not None:
            given["sensor_origin"] = xyz.max(axis=0) + 1.0
        if self.intensity:
            given["intensity"] = np.arange(len(xyz))
        clone(self.scoring).set_params(sensor_origin=None).fit(xyz, **given)

    def find(self, run):
        self.n_used = run.cells.n_points
        with progress_part(0.0, 1.0, "outliers"):
            self._find_scores(run)
        self._find_cutoff(run)
        if self.mode == "mark":
            self.lowest = self._lowest(run)

    def _find_scores(self, run):
        moves, origin = self.sensor.moves, self.detector.sensor_origin
        if moves:
            run.do("beams", find_beams)
        self._judge(run, self.task, self.scoring, moves, seen=bool(self.seen_as))
        sheets = np.sum([report["sheets"] for report in run.reports(self.task)], axis=0)
        self.doubt, self.by_rays = doubt_of(*sheets.tolist()), origin is not None
        warn_of_doubt(self.doubt, not is_auto(origin))
        if self.doubt and is_auto(origin):
            self.by_rays = False
            self._judge(run, AGAIN, clone(self.scoring).set_params(sensor_origin=None), False)

    def _judge(self, run, task, scoring, moves, **told):
        """Find scores; with intensity, points that a first fit finds isolated tell how far it
        tells in the whole cloud."""
        beside = {"moves": moves, "beams": moves, "shines": self.intensity}
        asked = {"estimator": scoring, "hops": RINGS, "width": WIDTH, **beside}
        if self.intensity:
            with progress_part(0.0, 0.5):
                run.do(f"light of {task}", told=told, keep=keep_light, **asked)
            told["telling"] = telling_of(list(run.found("isolated")))
        with progress_part(0.5 * self.intensity, 1.0):
            run.do(task, told=told, keep=keep_scores, **asked)

    def _find_cutoff(self, run):
        """Find the score beyond which points are outliers, where it is not given."""
        share = share_to_flag(self.detector)
        if self.detector.false_positive_rate is not None:
            n_needed = max(3_000, self.n_neighbors + 1)
            points = np.random.default_rng(0).uniform(size=(n_needed, 3)) * [1, 1, 0.01]
            fitted = clone(self.scoring).set_params(sensor_origin=None).fit(points)
            rough = [report["roughness"] for report in run.reports(self.task)]
            order, counts = np.argsort(rough), run.cells.counts
            middle = np.searchsorted(np.cumsum(counts[order]), counts.sum() / 2)
            self.cutoff = calibrated_cutoff(
                fitted._model,
                fitted._settings(),
                rate=self.detector.false_positive_rate,
                roughness=rough[order[middle]],
            )
        elif share is not None:
            negative = quantile_of(lambda: (-scores[:, 0] for scores in run.found("scores")), share)
            self.cutoff = -float(negative)

    def make(self, cloud, values, xyz):
        scores = values[:, 0]
        is_outlier = scores > self.cutoff
        if self.mode == "drop":
            return without_outliers(cloud, ~is_outlier), None
        classes = np.zeros(len(cloud), np.uint8)
        classes[is_outlier] = classes_of_noise(self.lowest, xyz[is_outlier])
        return with_results(cloud, {"outlier_score": scores.astype(np.float32)}), classes

    def measure(self, values):
        """Outliers, and those of them that have no scale, see `EXACT_PLANE_SCORE`."""
        limits = self.cutoff, max(self.cutoff, EXACT_PLANE_SCORE)
        return np.array([np.count_nonzero(values > limit) for limit in limits])

    def report(self, run, total):
        n_outliers, n_exact = map(int, total)
        return {
            "together": losses_of(self.estimator, lambda: self._removed(run), self.n_used),
            "n_outliers": n_outliers,
            "n_exact": n_exact,
            "removed_fraction": n_outliers / run.catalog.n_points,
            "n_used": self.n_used,
            "sensor": self._sensor_rows(run),
        }

    def _sensor_rows(self, run):
        """The rows of a report on the sensor."""
        if self.detector.sensor_origin is None:
            return {}
        words = self.seen_as or ("trajectory" if self.sensor.kind == "trajectory" else "given")
        positions = stored_origins(run.cells.folder) if self.sensor.moves else self.center
        where = place_words(positions, words) if self.by_rays else ""
        n = sum(n_by_rays(raised, self.cutoff) for raised in run.found("raised"))
        return rows_of_sensor(where, self.doubt, n)

    def _lowest(self, run):
        """The `LowestPoints` of the ground without outliers; of all kept points if it is little."""
        results, k, first = self.results(run), self.n_neighbors, 0
        lowest = LowestPoints(run.catalog.n_points, k)
        for _, cloud, _ in parts_of(run.catalog.paths):
            scores = results.take(first, len(cloud))[:, 0]
            first += len(cloud)
            lowest.add(cloud.xyz[ground_in(cloud) & ~(scores > self.cutoff)])
        if lowest.n_points < k:
            lowest = LowestPoints(self.n_used, k)
            for cell, values in enumerate(self.results(run).of_cells()):
                lowest.add(run.cells.points(cell)[values[:, 0] <= self.cutoff])
        return lowest

    def _removed(self, run):
        """Points, and which are outliers, tile by tile."""
        for cell, values in enumerate(self.results(run).of_cells()):
            yield run.cells.points(cell), values[:, 0] > self.cutoff


def keep_light(job, cell, part, fitted, cloud):
    """As `Job.keep`: the ranks of the own points that are isolated."""
    judged = judged_cloud(fitted)
    isolated = judged.darkness.isolated
    isolated = isolated[part.own[cloud.rows[isolated]]]
    return {"isolated": judged.darkness.ranks[isolated]}


def keep_scores(job, cell, part, fitted, cloud):
    """As `Job.keep`: scores, what rays say of the position, and how rough planes are."""
    judged, own = judged_cloud(fitted), part.own[cloud.rows]
    found = {"scores": -fitted.scores_[part.own, None], "sheets": [0, 0]}
    if judged.rays is not None:
        kinds = judged.rays.on_sheet, judged.explaining
        found["sheets"] = [int(judged.counts[own & kind].sum()) for kind in kinds]
    found["raised"] = judged.raised.scores[own[judged.raised.rows]]
    found["roughness"] = roughness_of(fitted._model)
    return found
