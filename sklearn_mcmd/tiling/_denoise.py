"""Outliers of clouds larger than memory: in sweeps over cells, with the scores of memory."""

from functools import partial

import numpy as np
from sklearn.base import clone

from sklearn_mcmd._choices import Mode, choices_of
from sklearn_mcmd._errors import warn_caller
from sklearn_mcmd._validation import check_sensor_origin, is_auto
from sklearn_mcmd.io._classes import LOW_NOISE, Choice, classes_of_noise, ground_in
from sklearn_mcmd.io._ground import HeightRange
from sklearn_mcmd.io._las import is_denoised, read_header
from sklearn_mcmd.io._las_parts import read_parts
from sklearn_mcmd.io._point_cloud import denoised_before, with_results, without_outliers
from sklearn_mcmd.io._sensor import place_words, rows_of_sensor
from sklearn_mcmd.outliers import MCMDOutlierDetector
from sklearn_mcmd.outliers._calibration import calibrated_cutoff, sample_step
from sklearn_mcmd.outliers._detector import EXACT_PLANE_SCORE, judged_cloud, share_to_flag
from sklearn_mcmd.outliers._lowest_points import LowestPoints
from sklearn_mcmd.outliers._model import n_by_rays
from sklearn_mcmd.planes._nearest import COMPILE_FROM
from sklearn_mcmd.report._volumes import losses_of
from sklearn_mcmd.runtime._progress import listen_to_progress, progress_part
from sklearn_mcmd.tiling._cell_columns import CellColumns
from sklearn_mcmd.tiling._heights import Heights
from sklearn_mcmd.tiling._memory import PART, most_neighbors, sensed
from sklearn_mcmd.tiling._outlier_job import Job, find_planes
from sklearn_mcmd.tiling._outputs import write_outputs
from sklearn_mcmd.tiling._result_files import (
    SCORED,
    Results,
    fit_together,
    has_scores,
    scores_in_parts,
    tile_file,
    write_results,
)
from sklearn_mcmd.tiling._run import Verb, check_seed, warm_up
from sklearn_mcmd.tiling._sensor_origins import (
    check_one_origin,
    recognized,
    sensor_path,
    stored_origins,
)
from sklearn_mcmd.tiling._stored_columns import ALL, whole_of
from sklearn_mcmd.tiling._stored_index import StoredIndex, find_neighbors, find_places
from sklearn_mcmd.tiling._sweeps import Sweeps, warn_if_coarse

__all__ = ["Denoise", "check_detector", "cutoff_of", "evenly_along_x", "judge_cells"]

WARM_UP = 3_000  # points that load or compile the code
# The ends of the work on heights and on scores, as a share of the time, and then of each sweep.
HEIGHTS, VERDICTS = 0.15, 0.99
RAYS = "by_rays"  # the name of what they tell of a cloud
SOURCES = {"angles": "scan angles", "trajectory": "trajectory", "positions": "given", None: "given"}
ENDS = {"places": 0.02, "neighbors": 0.2, "planes": 0.75}


class Denoise(Verb):
    """Outliers, in sweeps; points without scores are kept."""

    options = (
        *("mode", "ignore_classes", "only_classes", "above", "below", "low_groups"),
        "sensor_origin",
    )

    def __init__(
        self, estimator, mode, ignore_classes, only_classes, above, below, low_groups, sensor_origin
    ):
        if mode not in choices_of(Mode):
            raise ValueError(f"mode={mode!r} must be 'drop' or 'mark'.")
        check_detector(estimator)
        choice = Choice(ignore_classes, only_classes)
        self.mode, self.limits = mode, HeightRange.of(above, below, low_groups)
        content = f"{mode} {choice} {self.limits}"
        super().__init__(clone(estimator).set_params(n_jobs=1), content, choice)
        self.needs_ground = self.limits is not None
        self.sensor = sensor_path(estimator, sensor_origin)

    def prepare(self, catalog):
        for path in catalog.paths:
            if is_denoised(read_header(path)):
                warn_caller(denoised_before(path))
        most = most_neighbors(catalog.n_points, self.estimator)
        self.detector, self.seen_as = recognized(self.estimator, catalog, self.choice)
        if self.sensor is not None:  # any position will do; those of angles nobody told
            told = "auto" if self.sensor.kind == "angles" else "origin"
            self.detector = clone(self.detector).set_params(sensor_origin=told)
        self.cutoff = cutoff_of(self.detector)
        work = "outliers" if self.limits is None else "heights"
        return sensed(work, self.detector, self.sensor), 0, most

    def find(self, run):
        self.n_used = self.n_judged = int(run.cells.counts.sum())
        self.scored = run.folder.results, len(run.cells), SCORED
        if self.limits is None:
            return self._find_scores(run)
        heights = Heights(run, self.limits)
        with progress_part(0.0, HEIGHTS):
            self.n_judged = heights.find()
        with progress_part(HEIGHTS, VERDICTS):
            self._find_scores(run)
        with progress_part(VERDICTS, 1.0):
            self.scored = heights.scored()

    def _find_scores(self, run):
        columns = CellColumns(run.folder.results)
        self.n_resumed = columns.n_done(len(run.cells), "planes")
        job = Job(
            *(run.folder.cells, run.folder.results, self.detector, run.folder.constants),
            self.n_used, run.plan.n_threads,
        )  # fmt: skip
        self.cutoff = judge_cells(job, run.cells, columns, run.plan.n_workers, self.cutoff)

    def write(self, run):
        if self.mode == "mark":
            self.lowest = self._lowest(run)
        n_outliers, n_exact = map(int, write_outputs(run, self, Results(*self.scored)))
        return {
            "together": losses_of(self.estimator, partial(self._removed, run.cells), self.n_used),
            "n_outliers": n_outliers,
            "n_exact": n_exact,
            "removed_fraction": n_outliers / run.catalog.n_points,
            "n_judged": self.n_judged,
            "n_used": self.n_used,
            "sensor": self._sensed(run),
        }

    def _sensed(self, run):
        """The rows of a report on the sensor."""
        columns, positions = CellColumns(run.folder.results), stored_origins(run.folder.cells)
        if not columns.is_done(ALL, RAYS):
            return {}
        words = self.seen_as or SOURCES[self.sensor and self.sensor.kind]
        if positions is None:
            positions = _one_position(self.detector, np.full((1, 3), np.nan))
        told, n = columns.report(ALL, RAYS), n_by_rays(columns.read(ALL, RAYS), self.cutoff)
        return rows_of_sensor(
            place_words(positions, words) if told["used"] else "", told["doubt"], n
        )

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

    def _lowest(self, run):
        """What tells low noise from high: the `LowestPoints` of the ground, but outliers.

        Where these are less than a neighborhood, of all points that are kept.
        """
        results, k, first = Results(*self.scored), self.estimator.n_neighbors, 0
        lowest = LowestPoints(run.catalog.n_points, k)
        for path in run.catalog.paths:
            for cloud in read_parts(path, PART):
                scores = results.take(first, len(cloud), False)[:, 0]
                first += len(cloud)
                lowest.add(cloud.xyz[ground_in(cloud) & ~(scores > self.cutoff)])
        if lowest.n_points < k:
            lowest = LowestPoints(self.n_used, k)
            for cell, scores in enumerate(scores_in_parts(*self.scored)):
                lowest.add(run.cells.read(cell)["xyz"][scores <= self.cutoff])
        return lowest

    def _removed(self, cells):
        """Points, and which are outliers, but for groups below the ground, tile by tile."""
        folder, n_cells, dtype = self.scored
        for cell in range(n_cells):
            scores, depths = _judged(np.fromfile(tile_file(folder, cell), dtype)["values"])
            yield cells.read(cell)["xyz"], (scores > self.cutoff) & ~(depths > self.cutoff)


def _judged(values):
    """Scores, NaN of points that are not judged, and the depths of groups below the ground."""
    scores = values[:, 0]
    if values.shape[1] == 1:
        return scores, np.zeros(len(scores))
    depths = values[:, 1]
    return np.where(np.isnan(depths), np.nan, scores), depths


def check_detector(estimator):
    """Raise if a detector cannot work by tiles."""
    if not isinstance(estimator, MCMDOutlierDetector):
        raise ValueError(
            f"{type(estimator).__name__} cannot work by tiles: outliers are found by "
            "MCMDOutlierDetector."
        )
    if estimator.n_neighbors is None:
        raise ValueError(
            "n_neighbors=None cannot work by tiles: the whole cloud is one neighborhood."
        )
    check_one_origin(estimator)
    check_seed(estimator)


def cutoff_of(estimator):
    """The cutoff, where the cloud has no part in it; compiled code is then on disk for all."""
    detector = clone(estimator)
    if is_auto(detector.sensor_origin):  # which would see nothing in other points
        detector.set_params(sensor_origin="origin")
    if detector.cutoff is None and share_to_flag(detector) is None:
        detector.set_params(false_positive_rate=None)  # it takes long, and is found later
    return -warm_up(detector, WARM_UP).offset_


def judge_cells(job, cells, columns, n_workers, cutoff):
    """Find the scores of all points, which are written as results beside the columns.

    `cutoff` is that of `cutoff_of`. Returns the score beyond which points are outliers.
    """
    n_cells, sweep = len(cells), partial(Sweeps(columns, n_workers, ENDS), cells=cells, job=job)
    sweep("places", find_places)
    whole = whole_of(job)
    if len(whole) < max(COMPILE_FROM, job.detector.n_neighbors + 1):
        return _judge_together(job, cells)
    if not all(has_scores(job.columns, cell) for cell in range(n_cells)):
        whole.join("points", "counts")
        whole.make(**job.stored_columns())
        sweep("neighbors", find_neighbors)
        sweep("planes", find_planes)
        with progress_part(ENDS["planes"], 1.0), whole.releasing():
            _judge(job, cells, whole, n_workers * job.n_threads)
    if job.detector.false_positive_rate is not None:
        return columns.report(ALL, "cutoff")["cutoff"]
    share = share_to_flag(job.detector)
    if share is not None:  # all scores are in memory: 16 bytes for each
        scores = np.concatenate(list(scores_in_parts(job.columns, n_cells)))
        np.negative(scores, out=scores)
        return -np.percentile(scores, 100 * share, overwrite_input=True)
    return cutoff


def _judge(job, cells, whole, n_threads):
    """Write the scores of all cells, once the planes of all places are known."""
    columns, index = whole.columns, StoredIndex(whole, cells)
    judged = job.judged(index, n_threads, _origins(job, cells, whole, index))
    warn_if_coarse(job.constants, index)
    if job.detector.false_positive_rate is not None and not columns.is_done(ALL, "cutoff"):
        columns.finish(ALL, "cutoff", cutoff=_simulated_cutoff(job, judged.model, whole))
    if job.paper:
        scores = whole.open("distances")
    else:
        spacings = whole.open("spacing"), whole.open("other_spacing")
        judged.judge(whole.open("counts"), job.n_points, lambda: (whole.planes(), *spacings))
        scores = judged.point_scores
        _tell_rays(columns, judged)
    for cell in range(len(cells)):
        own, rows = scores[whole.rows(cell)], cells.read(cell)["row"]
        write_results(job.columns, cell, rows, own[columns.read(cell, "place_of")], SCORED)


def _tell_rays(columns, judged):
    """Keep what a `JudgedCloud` found by rays, where it knew of any."""
    if judged.rays is not None or judged.ray_doubt:
        columns.write(ALL, **{RAYS: judged.raised})
        columns.finish(ALL, RAYS, used=judged.rays is not None, doubt=judged.ray_doubt)


def _origins(job, cells, whole, index):
    """Where the sensor was for each place, by the first point there; None if it is not known."""
    stored = stored_origins(job.cells)
    if stored is None:
        return _one_position(job.detector, index.points)
    origins = index.empty(index.points.shape)
    for cell in range(len(cells)):
        own, rows = whole.rows(cell), cells.read(cell)["row"]
        first = np.empty(own.stop - own.start, rows.dtype)
        first[whole.columns.read(cell, "place_of")[::-1]] = rows[::-1]
        origins[own] = stored[first]
    return check_sensor_origin(origins, index.points)


def _one_position(detector, points):
    """That of a detector, whose "auto" `recognized` has left where it is the origin."""
    origin = detector.sensor_origin
    return check_sensor_origin("origin" if is_auto(origin) else origin, points)


def _judge_together(job, cells):
    """Scores of a cloud of few places, which other code judges than tiles."""
    detector, put = fit_together(job, job.detector, cells)
    put(-detector.scores_, SCORED)
    _tell_rays(CellColumns(job.columns), judged_cloud(detector))
    return -detector.offset_


def _simulated_cutoff(job, model, whole):
    """The cutoff of a false-positive rate, for planes as rough as those of the cloud."""
    rows = evenly_along_x(whole.open("points"), sample_step(len(whole)))
    with listen_to_progress(None):
        settings = {**job.settings, "n_jobs": 1}
        return calibrated_cutoff(model, settings, job.detector.false_positive_rate, rows)


def evenly_along_x(points, step):
    """Rows of every step-th of distinct points (n, 3) in the order of their coordinates."""
    x, ranks = np.array(points[:, 0]), np.arange(0, len(points), step)
    ordered = np.sort(x)
    wanted = ordered[ranks]
    before = np.searchsorted(ordered, wanted)
    del ordered
    # Only points with such an x are sorted by all coordinates.
    rows = np.flatnonzero(wanted[np.searchsorted(wanted[:-1], x)] == x)
    rows = rows[np.lexsort(points[rows].T[::-1])]
    return rows[np.searchsorted(x[rows], wanted) + ranks - before]
