"""Outliers of clouds larger than memory: in sweeps over cells, with the scores of memory."""

from functools import partial

import numpy as np
from sklearn.base import clone

from sklearn_mcmd._validation import check_sensor_origin
from sklearn_mcmd.io._classes import Choice
from sklearn_mcmd.io._las import is_denoised, read_header
from sklearn_mcmd.io._point_cloud import denoised_before
from sklearn_mcmd.outliers import MCMDOutlierDetector
from sklearn_mcmd.outliers._calibration import calibrated_cutoff, sample_step
from sklearn_mcmd.outliers._volumes import lost_volumes, words_of
from sklearn_mcmd.planes._indexed_cloud import COMPILE_FROM
from sklearn_mcmd.runtime._progress import listen_to_progress, progress_part
from sklearn_mcmd.tiling._cell_columns import CellColumns
from sklearn_mcmd.tiling._heights import HeightLimits, Heights
from sklearn_mcmd.tiling._low_noise import lowest_points
from sklearn_mcmd.tiling._memory import most_neighbors, sensed
from sklearn_mcmd.tiling._outlier_job import Job, find_planes
from sklearn_mcmd.tiling._outputs import (
    SCORED,
    Scored,
    content_of,
    has_scores,
    scores_in_parts,
    write_denoised_outputs,
)
from sklearn_mcmd.tiling._quantiles import evenly_along_x, exceeded_by
from sklearn_mcmd.tiling._result_files import write_results
from sklearn_mcmd.tiling._run import Verb, check_seed, warm_up
from sklearn_mcmd.tiling._sensor_origins import check_one_origin, sensor_path, stored_origins
from sklearn_mcmd.tiling._small_clouds import fit_together
from sklearn_mcmd.tiling._stored_columns import ALL, whole_of
from sklearn_mcmd.tiling._stored_index import StoredIndex, find_neighbors, find_places
from sklearn_mcmd.tiling._sweeps import Sweeps
from sklearn_mcmd.tiling._warnings import warn_caller, warn_if_coarse

__all__ = ["Denoise", "check_detector", "cutoff_of", "judge_cells"]

WARM_UP = 3_000  # points that load or compile the code
# The ends of the work on heights and on scores, as a share of the time, and then of each sweep.
HEIGHTS, VERDICTS = 0.15, 0.99
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
        if mode not in ("drop", "mark"):
            raise ValueError(f"mode={mode!r} must be 'drop' or 'mark'.")
        check_detector(estimator)
        sensor = sensor_path(estimator, sensor_origin)
        choice = Choice(ignore_classes, only_classes)
        self.mode, self.limits = mode, HeightLimits.of(above, below, low_groups)
        super().__init__(
            clone(estimator).set_params(n_jobs=1), content_of(mode, choice, self.limits), choice,
            needs_ground=self.limits is not None, sensor=sensor,
        )  # fmt: skip

    def look(self, catalog):
        for path in catalog.paths:
            if is_denoised(read_header(path)):
                warn_caller(denoised_before(path))

    def prepare(self):
        self.cutoff = cutoff_of(self.estimator)
        work = "outliers" if self.limits is None else "heights"
        return sensed(work, self.estimator, self.sensor), 0, most_neighbors(self.estimator)

    def find(self, run):
        self.n_used = self.n_judged = int(run.cells.counts.sum())
        self.scored = Scored(run.folder.results, len(run.cells))
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
        columns, n_cells = CellColumns(run.folder.results), len(run.cells)
        self.n_resumed = sum(columns.is_done(cell, "planes") for cell in range(n_cells))
        job = Job(
            *(run.folder.cells, run.folder.results, self.estimator, run.folder.constants),
            self.n_used, run.plan.n_threads,
        )  # fmt: skip
        self.cutoff = judge_cells(job, run.cells, columns, run.plan.n_workers, self.cutoff)

    def write(self, run):
        lowest = None
        if self.mode == "mark":
            lowest = lowest_points(
                run.catalog, self.scored, run.cells, self.estimator.n_neighbors, self.cutoff
            )
        n_outliers, n_exact = write_denoised_outputs(
            run.catalog, run.targets, run.folder, self.mode, self.cutoff, self.choice,
            self.content, self.scored, lowest,
        )  # fmt: skip
        together = ""
        if self.estimator.strictness != "surfaces":  # which takes things that are no surfaces
            together = words_of(lost_volumes(partial(self._removed, run.cells), self.n_used))
        return {
            "together": together,
            "n_outliers": n_outliers,
            "n_exact": n_exact,
            "removed_fraction": n_outliers / run.catalog.n_points,
            "n_judged": self.n_judged,
            "n_used": self.n_used,
            "n_resumed": self.n_resumed,
        }

    def _removed(self, cells):
        """Points, and which are outliers, tile by tile."""
        for cell in range(len(cells)):
            yield cells.read(cell)["xyz"], self.scored.flagged(cell, self.cutoff)


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
    if detector.cutoff is None and detector._share() is None:
        detector.set_params(false_positive_rate=None)  # it takes long, and is found later
    return -warm_up(detector, WARM_UP).offset_


def judge_cells(job, cells, columns, n_workers, cutoff):
    """Find the scores of all points, which are written as results beside the columns.

    Parameters
    ----------
    job : Job
    cells : Cells
    columns : CellColumns
    n_workers : int
    cutoff : float
        By `cutoff_of`.

    Returns
    -------
    cutoff : float
        The score beyond which points are outliers.
    """
    n_cells, sweep = len(cells), partial(Sweeps(columns, n_workers, ENDS), cells=cells, job=job)
    sweep("places", find_places)
    whole = whole_of(job)
    if len(whole) < max(COMPILE_FROM, job.detector.n_neighbors + 1):
        return _judge_together(job, cells, len(whole))
    if not all(has_scores(job.columns, cell) for cell in range(n_cells)):
        whole.join("points", "counts")
        whole.make(**job.stored_columns())
        sweep("neighbors", find_neighbors)
        sweep("planes", find_planes)
        with progress_part(ENDS["planes"], 1.0), whole.releasing():
            _judge(job, cells, whole, n_workers * job.n_threads)
    if job.detector.false_positive_rate is not None:
        return columns.report(ALL, "cutoff")["cutoff"]
    if job.detector._share() is not None:
        parts = partial(scores_in_parts, job.columns, n_cells)
        return exceeded_by(parts, job.detector._share())
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
    for cell in range(len(cells)):
        own, rows = scores[whole.rows(cell)], cells.read(cell)["row"]
        write_results(job.columns, cell, rows, own[columns.read(cell, "place_of")], SCORED)


def _origins(job, cells, whole, index):
    """Where the sensor was for each place, by the first point there; None if it is not known."""
    origins, stored = job.detector.sensor_origin, stored_origins(job.cells)
    if stored is not None:
        origins = index.empty(index.points.shape)
        for cell in range(len(cells)):
            place_of, rows = whole.columns.read(cell, "place_of"), cells.read(cell)["row"]
            first = np.empty(whole.rows(cell).stop - whole.rows(cell).start, rows.dtype)
            first[place_of[::-1]] = rows[::-1]
            origins[whole.rows(cell)] = stored[first]
    return check_sensor_origin(origins, index.points)


def _judge_together(job, cells, n_places):
    """Scores of a cloud of few places, which other code judges than tiles."""
    words = f" at {n_places:,} places"
    dtype, step = job.constants.dtype, job.constants.step
    origins = stored_origins(job.cells)
    detector, parts = fit_together(job.detector, cells, dtype, words, step, origins)
    for cell, (rows, places) in enumerate(parts):
        write_results(job.columns, cell, rows, -detector.scores_[places], SCORED)
    return -detector.offset_


def _simulated_cutoff(job, model, whole):
    """The cutoff of a false-positive rate, for planes as rough as those of the cloud."""
    points, n = whole.open("points"), len(whole)
    some = evenly_along_x(lambda cell: points[whole.rows(cell)], whole.n_cells, n, sample_step(n))
    rows = np.concatenate([whole.rows(cell).start + rows for cell, rows in some])
    with listen_to_progress(None):
        settings = {**job.settings, "n_jobs": 1}
        return calibrated_cutoff(model, settings, job.detector.false_positive_rate, rows)
