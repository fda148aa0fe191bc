"""Outliers of clouds larger than memory."""

from functools import partial

import numpy as np
from sklearn.base import clone

from sklearn_mcmd._choices import Mode, choices_of
from sklearn_mcmd._errors import warn_caller
from sklearn_mcmd._validation import check_sensor_origin, is_auto
from sklearn_mcmd.io import PointFileError
from sklearn_mcmd.io._classes import LOW_NOISE, Choice, classes_of_noise, ground_in
from sklearn_mcmd.io._ground import NONE_JUDGED, HeightRange
from sklearn_mcmd.io._las import is_denoised, read_header
from sklearn_mcmd.io._point_cloud import denoised_before, with_results, without_outliers
from sklearn_mcmd.io._sensor import place_words, rows_of_sensor
from sklearn_mcmd.outliers import MCMDOutlierDetector
from sklearn_mcmd.outliers._calibration import calibrated_cutoff, check_rate, roughness_of
from sklearn_mcmd.outliers._detector import EXACT_PLANE_SCORE, judged_cloud, share_to_flag
from sklearn_mcmd.outliers._lowest_points import LowestPoints
from sklearn_mcmd.outliers._model import n_by_rays, telling_of, warn_of_doubt
from sklearn_mcmd.outliers._ray_evidence import doubt_of
from sklearn_mcmd.planes._around import quantile_of
from sklearn_mcmd.report._volumes import losses_of
from sklearn_mcmd.runtime._chunks import ahead
from sklearn_mcmd.runtime._progress import progress_part
from sklearn_mcmd.tiling._beams import find_beams, with_beams
from sklearn_mcmd.tiling._catalog import parts_of
from sklearn_mcmd.tiling._halo import HOPS, HOPS_MORE, WIDTH
from sklearn_mcmd.tiling._heights import GroundWriter, find_heights, judge_groups
from sklearn_mcmd.tiling._light import LightWriter, stored_light
from sklearn_mcmd.tiling._outputs import Results
from sklearn_mcmd.tiling._run import TiledVerb, check_estimator, most_neighbors, warm_up
from sklearn_mcmd.tiling._sensor_origins import recognized, sensor_path, stored_origins
from sklearn_mcmd.tiling._tasks import run_tasks

SOURCES = {"angles": "scan angles", "trajectory": "trajectory", "positions": "given", None: "given"}
RINGS = HOPS + HOPS_MORE
AGAIN = "again"  # the task that finds scores without the rays that the first has followed


class TiledOutliers(TiledVerb):
    """Outliers; points without scores are kept."""

    options = (
        *("mode", "ignore_classes", "only_classes", "above", "below", "low_groups"),
        *("sensor_origin", "intensity"),
    )

    def __init__(
        self, estimator, mode, ignore_classes, only_classes, sensor_origin, intensity, **heights
    ):
        if mode not in choices_of(Mode):
            raise ValueError(f"mode={mode!r} must be 'drop' or 'mark'.")
        check_estimator(estimator, MCMDOutlierDetector)
        estimator._check_choices(None, True if intensity else None)
        choice = Choice(ignore_classes, only_classes)
        self.mode, self.limits, self.intensity = mode, HeightRange.of(**heights), intensity
        content = f"{mode} {choice} {self.limits} {intensity}"
        super().__init__(estimator, content, choice)
        self.sensor = sensor_path(estimator, sensor_origin)

    @property
    def n_neighbors(self):
        return int(self.estimator.n_neighbors)

    def prepare(self, catalog):
        for path in catalog.paths:
            if is_denoised(read_header(path)):
                warn_caller(denoised_before(path))
        most_neighbors(catalog.n_points, self.estimator)
        self.detector, self.seen_as = recognized(self.estimator, catalog, self.choice)
        if self.sensor is not None:  # any position will do; those of angles are doubted
            origin = "auto" if self.sensor.kind == "angles" else "origin"
            self.detector = clone(self.detector).set_params(sensor_origin=origin)
        elif self.detector.sensor_origin is not None:
            known = "origin" if self.seen_as else self.detector.sensor_origin
            self.center = check_sensor_origin(known, np.full((1, 3), np.nan))[0]
        check_rate(self.detector.false_positive_rate)
        # Cells find scores alone: which are outliers is decided for all of them.
        cutoffs = dict.fromkeys(("cutoff", "false_positive_rate", "contamination"))
        self.scoring = clone(self.detector).set_params(**cutoffs)
        origin = None if self.detector.sensor_origin is None else "origin"
        self.cutoff = -warm_up(clone(self.scoring).set_params(sensor_origin=origin)).offset_
        if self.detector.cutoff is not None:
            self.cutoff = float(self.detector.cutoff)

    def beside(self, folder, catalog):
        found = [] if self.sensor is None else [self.sensor.beside(folder.cells)]
        if self.intensity:
            found.append(LightWriter(folder.cells, catalog.n_points))
        if self.limits is not None:
            found.append(GroundWriter(folder.cells))
        return found

    def measure_fit(self, xyz):
        given = {}
        if self.detector.sensor_origin is not None:
            given["sensor_origin"] = xyz.max(axis=0) + 1.0
        if self.intensity:
            given["intensity"] = np.arange(len(xyz))
        clone(self.scoring).set_params(sensor_origin=None).fit(xyz, **given)

    def find(self, run):
        self.n_used = self.n_judged = run.cells.n_points
        by_height = self.limits is not None
        ends = (0.0, 0.1 * by_height, 1.0)
        if by_height:
            with progress_part(*ends[:2], "heights"):
                self._find_heights(run)
        with progress_part(*ends[1:], "outliers"):
            self._find_scores(run)
        self.cutoff = run.results.once("cutoff", partial(self._cutoff, run))["cutoff"]

    def _find_heights(self, run):
        job = run.job(None, None, 0)
        work = partial(find_heights, limits=self.limits)
        run_tasks("heights", work, job, run.plan.n_workers)
        cells = range(len(run.cells))
        self.n_judged = sum(run.results.report(cell, "heights")["n_judged"] for cell in cells)
        if not self.n_judged:
            raise PointFileError(f"{run.catalog.paths[0]}: {NONE_JUDGED}")
        if self.limits.low_groups:
            run.results.once("groups", partial(judge_groups, run.results, cells, run.memory))

    def _find_scores(self, run):
        moves, cells = self.sensor is not None, range(len(run.cells))
        given = partial(with_all, run.folder.cells, moves=moves, shines=self.intensity)
        known = {"seen": bool(self.seen_as)}
        if moves and len(cells) > 1:
            run_tasks("beams", find_beams, run.job(None, None, 0), run.plan.n_workers)
        with progress_part(0.0, 0.5 * self.intensity):
            known["telling"] = self._telling(run, "light", self.scoring, given, **known)
        with progress_part(0.5 * self.intensity, 1.0):
            run.fit(self.task, run.job(self.scoring, keep_scores, RINGS, WIDTH, given, **known))
        self.doubt, self.by_rays = self._doubt(run), self.detector.sensor_origin is not None
        warn_of_doubt(self.doubt, not is_auto(self.detector.sensor_origin))
        if self.doubt and is_auto(self.detector.sensor_origin):
            self.by_rays = False
            scoring = clone(self.scoring).set_params(sensor_origin=None)
            given = partial(with_light, run.folder.cells) if self.intensity else None
            telling = self._telling(run, f"light {AGAIN}", scoring, given)
            run.fit(AGAIN, run.job(scoring, keep_scores, RINGS, WIDTH, given, telling=telling))

    def _telling(self, run, task, scoring, given, **known):
        """How far intensity tells in the whole cloud, by the points that a fit finds isolated."""
        if not self.intensity:
            return 0.0
        run.fit(task, run.job(scoring, keep_light, RINGS, WIDTH, given, **known))
        cells = range(len(run.cells))

        def find():
            return {"telling": telling_of([run.results.read(cell, "isolated") for cell in cells])}

        return run.results.once(f"telling of {task}", find)["telling"]

    def _doubt(self, run):
        """What speaks against the position of the sensor, in words; "" if nothing does."""
        reports = [run.results.report(cell, self.task) for cell in range(len(run.cells))]
        totals = np.sum([report["sheets"] for report in reports], axis=0)
        return doubt_of(*totals.tolist())

    def _cutoff(self, run):
        """The score beyond which points are outliers."""
        cells, share = range(len(run.cells)), share_to_flag(self.detector)
        if self.detector.false_positive_rate is not None:
            n_needed = max(3_000, self.n_neighbors + 1)
            points = np.random.default_rng(0).uniform(size=(n_needed, 3)) * [1, 1, 0.01]
            fitted = clone(self.scoring).set_params(sensor_origin=None).fit(points)
            rough = [run.results.report(cell, self.task)["roughness"] for cell in cells]
            order, counts = np.argsort(rough), run.cells.counts
            middle = np.searchsorted(np.cumsum(counts[order]), counts.sum() / 2)
            known = fitted._model, fitted._settings(), self.detector.false_positive_rate
            return {"cutoff": calibrated_cutoff(*known, roughness=rough[order[middle]])}
        if share is not None:
            scores = partial(_all_scores, run.results, cells)
            return {"cutoff": -float(quantile_of(lambda: map(np.negative, scores()), share))}
        return {"cutoff": self.cutoff}

    def results(self, run):
        if self.mode == "mark":
            self.lowest = self._lowest(run)
        return self._results(run)

    def _results(self, run):
        names = ["results"]
        if self.limits is not None:
            names += ["judged", *["depths"] * self.limits.low_groups]
        return Results(run.results, run.cells, *names)

    def make(self, cloud, values, xyz):
        scores, depths = _judged(values)
        is_outlier = scores > self.cutoff
        if self.mode == "drop":
            return without_outliers(cloud, ~is_outlier), None
        classes = np.zeros(len(cloud), np.uint8)
        classes[is_outlier] = classes_of_noise(self.lowest, xyz[is_outlier])
        classes[depths > self.cutoff] = LOW_NOISE
        return with_results(cloud, {"outlier_score": scores.astype(np.float32)}), classes

    def measure(self, values):
        """Outliers, and those of them that have no scale, see `EXACT_PLANE_SCORE`."""
        scores, _ = _judged(values)
        limits = self.cutoff, max(self.cutoff, EXACT_PLANE_SCORE)
        return np.array([np.count_nonzero(scores > limit) for limit in limits])

    def report(self, run, total):
        n_outliers, n_exact = map(int, total)
        return {
            "together": losses_of(self.estimator, lambda: ahead(self._removed(run)), self.n_used),
            "n_outliers": n_outliers,
            "n_exact": n_exact,
            "removed_fraction": n_outliers / run.catalog.n_points,
            "n_judged": self.n_judged,
            "n_used": self.n_used,
            "sensor": self._sensor_rows(run),
        }

    def _sensor_rows(self, run):
        """The rows of a report on the sensor."""
        if self.detector.sensor_origin is None:
            return {}
        words = self.seen_as or SOURCES[self.sensor and self.sensor.kind]
        positions = stored_origins(run.folder.cells) if self.center is None else self.center[None]
        n, cells = 0, range(len(run.cells))
        if self.by_rays:
            n = sum(n_by_rays(run.results.read(cell, "raised"), self.cutoff) for cell in cells)
        where = place_words(positions, words) if self.by_rays else ""
        return rows_of_sensor(where, self.doubt, n)

    def _lowest(self, run):
        """The `LowestPoints` of the ground without outliers; of all kept points if it is little."""
        results, k, first = self._results(run), self.n_neighbors, 0
        lowest = LowestPoints(run.catalog.n_points, k)
        for _, cloud, _ in parts_of(run.catalog.paths):
            scores = _judged(results.take(first, len(cloud)))[0]
            first += len(cloud)
            lowest.add(cloud.xyz[ground_in(cloud) & ~(scores > self.cutoff)])
        if lowest.n_points < k:
            lowest = LowestPoints(self.n_used, k)
            for cell, values in enumerate(self._results(run).of_cells()):
                lowest.add(run.cells.points(cell)[_judged(values)[0] <= self.cutoff])
        return lowest

    def _removed(self, run):
        """Points, and which are outliers, but for groups below the ground, tile by tile."""
        for cell, values in enumerate(self._results(run).of_cells()):
            scores, depths = _judged(values)
            yield run.cells.points(cell), (scores > self.cutoff) & ~(depths > self.cutoff)


def _judged(values):
    """Scores, NaN of points that are not judged, and the depths of groups below the ground.

    Values are scores, and, where heights are asked for, whether points are judged, and depths.
    """
    scores, depths = values[:, 0], np.zeros(len(values))
    if values.shape[1] > 2:
        depths = values[:, 2]
        scores = np.maximum(scores, depths)
    if values.shape[1] > 1:
        scores = np.where(values[:, 1] == 1, scores, np.nan)
        depths = np.where(values[:, 1] == 1, depths, np.nan)
    return scores, depths


def _all_scores(results, cells):
    """The scores of all points, cell by cell."""
    for cell in cells:
        yield results.read(cell, "results")[:, 0]


def with_light(folder, job, cell, part):
    """As `Job.given`: the ranks of intensity in the whole cloud."""
    return part, {"intensity": stored_light(folder)[part.rows]}


def with_all(folder, job, cell, part, moves, shines):
    """As `Job.given`: ranks of intensity, and where the sensor was, with the ends of beams that
    cross the cell."""
    given = {}
    if moves:
        part = with_beams(job, cell, part)
        given["sensor_origin"] = stored_origins(folder)[part.rows]
    if shines:
        given["intensity"] = stored_light(folder)[part.rows]
    return part, given


def keep_light(job, cell, part, fitted, cloud):
    """As `Job.keep`: the ranks of the own points that are isolated."""
    judged = judged_cloud(fitted)
    rows = judged.isolated[part.own[cloud.rows[judged.isolated]]]
    return {"isolated": judged.intensity[rows]}


def keep_scores(job, cell, part, fitted, cloud):
    """As `Job.keep`: scores, what rays say of the position, and how rough planes are."""
    judged, own = judged_cloud(fitted), part.own[cloud.rows]
    found = {"results": -fitted.scores_[part.own, None], "sheets": [0, 0]}
    if judged.rays is not None:
        kinds = judged.rays.on_sheet, judged.explaining
        found["sheets"] = [int(judged.counts[own & kind].sum()) for kind in kinds]
    found["raised"] = judged.raised[own[judged.raised_rows]]
    found["roughness"] = roughness_of(fitted._model)
    return found
