"""Edges of clouds larger than memory: in sweeps over cells, with the scores of memory."""

import shutil
from functools import partial

import numpy as np
from sklearn.base import clone

from sklearn_mcmd.edges._detector import crease_width, steps_of
from sklearn_mcmd.edges._limits import least_of_edge
from sklearn_mcmd.runtime._progress import progress_part
from sklearn_mcmd.tiling._cell_columns import CellColumns
from sklearn_mcmd.tiling._cells import BOXES, Cells
from sklearn_mcmd.tiling._creases import STORED, EdgeJob, find_distances, tell_faces
from sklearn_mcmd.tiling._criteria import find_values, tell_values, values_in_parts
from sklearn_mcmd.tiling._denoise import check_detector, cutoff_of, judge_cells
from sklearn_mcmd.tiling._kept_points import close_kept, find_kept, kept_constants
from sklearn_mcmd.tiling._memory import most_neighbors, sized
from sklearn_mcmd.tiling._normals import without_sides
from sklearn_mcmd.tiling._outlier_job import Job
from sklearn_mcmd.tiling._outputs import SCORED, scores_in_parts, write_edge_outputs
from sklearn_mcmd.tiling._planes import OWN, PlaneJob, are_few, ends_of, find_planes
from sklearn_mcmd.tiling._quantiles import median_of
from sklearn_mcmd.tiling._result_files import write_results
from sklearn_mcmd.tiling._run import Verb, check_seed, warm_up
from sklearn_mcmd.tiling._small_clouds import fit_together
from sklearn_mcmd.tiling._stored_columns import whole_of
from sklearn_mcmd.tiling._stored_index import find_places
from sklearn_mcmd.tiling._sweeps import Sweeps

__all__ = ["Edges"]

WARM_UP = 3_000  # points that load or compile the code
# The end of each step, as a share of the time.
ENDS = {
    "outliers": 0.45,
    "kept": 0.46,
    "places": 0.47,
    "normals": 0.8,
    "edges": 1.0,
}


class Edges(Verb):
    """Edges of what a detector leaves."""

    options = ("colors",)

    def __init__(self, estimator, colors):
        super().__init__(clone(estimator).set_params(n_jobs=1), f"colors={colors}")
        self.steps, self.colors = _checked_steps(estimator), colors

    def prepare(self):
        warm_up(self.estimator, WARM_UP)
        return sized("edges", self.steps[1]), 0, most_neighbors(self.estimator, *self.steps)

    def find(self, run):
        self.found = _Steps(run, self.estimator, self.steps)
        self.limit = self.found.find_scores()

    def write(self, run):
        n_edges = write_edge_outputs(
            run.catalog, run.targets, run.folder, self.limit,
            self.estimator.criterion == "crease", self.colors, self.content,
        )  # fmt: skip
        n_removed = run.catalog.n_points - self.found.n_kept
        return {
            "n_edges": n_edges,
            "n_outliers": n_removed,
            "removed_fraction": n_removed / run.catalog.n_points,
            "n_resumed": self.found.n_resumed,
        }


def _checked_steps(estimator):
    """The detector and the normal estimator of a detector of edges that can work by tiles.

    The first is None if nothing is removed. Raises if it cannot.
    """
    check_seed(estimator)
    if estimator.normals != "estimate":
        raise ValueError(
            f"normals={estimator.normals!r} cannot work by tiles, which hold coordinates only: "
            "take normals='estimate'."
        )
    detector, normals = steps_of(estimator)
    if detector is not None:
        check_detector(detector)
    return detector, without_sides(normals)


class _Steps:
    """The steps of a run, of which those are left out that an earlier run has done.

    Attributes
    ----------
    n_kept : int
        Points that are no outliers.
    n_resumed : int
        Tiles whose normals an earlier run had.
    """

    def __init__(self, run, estimator, steps):
        self.catalog, self.folder, self.estimator = run.catalog, run.folder, estimator
        self.detector, self.normals = steps
        for step in steps:
            if step is not None:
                step.set_params(n_jobs=1)
        self.cells, self.columns = run.cells, CellColumns(run.folder.results)
        ends = {**ENDS, **ends_of(ENDS["places"], ENDS["normals"], self.normals)}
        self.sweep = Sweeps(self.columns, run.plan.n_workers, ends)
        self.scores, self.n_threads = run.folder.results / "outliers", run.plan.n_threads
        self.n_kept, self.n_resumed = run.catalog.n_points, 0

    def find_scores(self):
        """Find the scores of all points; returns the one below which they are edges'."""
        kept = self._clean()
        self.n_kept = int(kept.counts.sum())
        constants, results = self._constants(kept), self.folder.results
        job = EdgeJob(self.folder.cells, kept.folder, results, self.estimator, constants)
        creases = self.estimator.criterion == "crease"
        tell = partial(tell_values, criterion=self.estimator.criterion)
        planes = PlaneJob(
            kept.folder,
            results,
            self.normals,
            constants,
            tell_faces if creases else tell,
            self.n_threads,
        )
        self.sweep("places", find_places, kept, job=job)
        self.n_resumed = sum(self.columns.is_done(cell, "normals") for cell in range(len(kept)))
        whole, k = whole_of(job), self.estimator.n_neighbors
        if are_few(whole, self.normals, k):
            return self._judge_together(len(whole))
        if creases:
            whole.make(**STORED)
        find_planes(self.sweep, kept, planes, k if creases else 0)
        if not creases:
            return self._find_values(kept, job, planes)
        whole.remove(*OWN)
        if not all(map(self.folder.is_done, range(len(kept)))):
            with progress_part(ENDS["normals"], 1.0), whole.releasing():
                find_distances(job, self.sweep.n_workers * self.n_threads)
        return crease_width(self.estimator)

    def _find_values(self, kept, job, planes):
        """Values of another criterion; returns the least of an edge, negative."""
        self.sweep("edges", find_values, self.cells, self.folder.is_done, job=job, planes=planes)
        parts = partial(values_in_parts, self.columns, np.flatnonzero(kept.counts))
        return -least_of_edge(parts, self.estimator.threshold, self.estimator.n_std, median_of)

    def _clean(self):
        """The cells of the points that the detector leaves."""
        target = self.folder.cells / "kept"
        if self.detector is None:
            self.sweep.begin = ENDS["kept"]
            return self.cells
        if not (target / BOXES).exists():
            self.scores.mkdir(exist_ok=True)
            target.mkdir(exist_ok=True)
            constants, n_points = self.folder.constants, self.catalog.n_points
            job = Job(
                *(self.folder.cells, self.scores, self.detector, constants, n_points),
                n_threads=self.n_threads,
            )
            with progress_part(0.0, ENDS["outliers"], "outliers"):
                columns, cutoff = CellColumns(self.scores), cutoff_of(self.detector)
                cutoff = judge_cells(job, self.cells, columns, self.sweep.n_workers, cutoff)
            self.sweep.begin = ENDS["outliers"]
            scores = scores_in_parts(self.scores, len(self.cells))
            if sum(np.count_nonzero(values <= cutoff) for values in scores) <= 3:
                cutoff = np.inf  # too few would be left for a plane
            self.sweep(
                "kept", find_kept, self.cells, folder=self.folder.cells, target=target,
                columns=self.folder.results, scores=self.scores, cutoff=cutoff,
            )  # fmt: skip
            close_kept(self.cells, target, self.columns)
        self.sweep.begin = ENDS["kept"]
        shutil.rmtree(self.scores, ignore_errors=True)
        return Cells(target)

    def _constants(self, kept):
        """The `Constants` of the kept points."""
        constants = self.folder.constants
        if self.detector is None:
            return constants
        if not self.columns.is_done("all", "kept constants"):
            found = kept_constants(kept, constants.dtype)
            self.columns.finish("all", "kept constants", step=found.step)
        return constants._replace(step=self.columns.report("all", "kept constants")["step"])

    def _judge_together(self, n_places):
        """Scores of a cloud of which few places are kept, which other code judges than tiles."""
        words = f", of which {n_places:,} places are no outliers,"
        constants = self.folder.constants
        detector, parts = fit_together(self.estimator, self.cells, constants.dtype, words)
        for cell, (rows, places) in enumerate(parts):
            write_results(self.folder.results, cell, rows, detector.scores_[places], SCORED)
        return detector.offset_
