"""Edges of clouds larger than memory: in sweeps over cells, with the scores of memory."""

import shutil
from functools import partial

import numpy as np
from sklearn.base import clone

from sklearn_mcmd.edges._creases import middle
from sklearn_mcmd.edges._limits import least_of_edge
from sklearn_mcmd.planes._indexed_cloud import COMPILE_FROM
from sklearn_mcmd.planes._progress import progress_part
from sklearn_mcmd.tiling._cells import BOXES, Cells
from sklearn_mcmd.tiling._columns import Columns
from sklearn_mcmd.tiling._creases import (
    EdgeJob,
    face_columns,
    find_creases,
    find_distances,
    find_faces,
    find_ordered_places,
    find_spacing,
)
from sklearn_mcmd.tiling._criteria import ValueJob, find_values, value_column, values_in_parts
from sklearn_mcmd.tiling._denoise import check_detector, cutoff_of, judge_cells
from sklearn_mcmd.tiling._kept import close_kept, find_kept, kept_constants
from sklearn_mcmd.tiling._normals import check_normals
from sklearn_mcmd.tiling._outputs import SCORED, scores_in_parts, write_edge_outputs
from sklearn_mcmd.tiling._ranks import median_of
from sklearn_mcmd.tiling._run import Verb, check_seed, warm_up
from sklearn_mcmd.tiling._surfaces import Job
from sklearn_mcmd.tiling._sweeps import Sweeps
from sklearn_mcmd.tiling._tile import normals_of_tile, tile_files, total_proved, write_whole
from sklearn_mcmd.tiling._together import fit_together

__all__ = ["Edges"]

WARM_UP = 3_000  # points that load or compile the code
# The end of each step, as a share of the time.
ENDS = {
    "outliers": 0.45,
    "kept": 0.46,
    "places": 0.47,
    "normals": 0.7,
    "spacing": 0.75,
    "faces": 0.8,
    "creases": 0.95,
    "edges": 1.0,
}
# What no sweep asks for when all are done that did.
DONE_WITH = {"spacing": ("first_rows",)}


class Edges(Verb):
    """Edges of what a detector leaves."""

    options = ("colors",)

    def __init__(self, estimator, colors):
        super().__init__(clone(estimator).set_params(n_jobs=1), f"colors={colors}")
        self.steps, self.colors = _checked_steps(estimator), colors

    def prepare(self):
        warm_up(self.estimator, WARM_UP)
        return "edges", 0

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
            "n_proved": self.found.n_proved + n_removed,
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
    detector, normals = estimator._make_steps()
    if detector is not None:
        check_detector(detector)
    check_normals(normals, inner=True)
    return detector, normals


class _Steps:
    """The steps of a run, of which those are left out that an earlier run has done.

    Attributes
    ----------
    n_kept : int
        Points that are no outliers.
    n_proved : int
        Of these, those whose normals the first halo proved.
    n_resumed : int
        Tiles whose normals an earlier run had.
    """

    def __init__(self, run, estimator, steps):
        self.catalog, self.folder, self.estimator = run.catalog, run.folder, estimator
        self.detector, self.normals = steps
        for step in steps:
            if step is not None:
                step.set_params(n_jobs=1)
        self.cells, self.columns = run.cells, Columns(run.folder.results)
        self.sweep = Sweeps(self.columns, run.plan.n_workers, ENDS, DONE_WITH)
        self.scores, self.faces = run.folder.results / "outliers", run.folder.results / "faces"
        self.n_kept, self.n_proved, self.n_resumed = run.catalog.n_points, 0, 0

    def find_scores(self):
        """Find the scores of all points; returns the one below which they are edges'."""
        kept = self._clean()
        self.n_kept = int(kept.counts.sum())
        job = EdgeJob(
            self.folder.cells, kept.folder, self.folder.results, self.faces, self.estimator,
            self.folder.constants.dtype,
        )  # fmt: skip
        self.sweep("places", find_ordered_places, kept, job=job)
        some = np.flatnonzero(kept.counts)
        n_places = sum(self.columns.report(cell, "places")["n_places"] for cell in some)
        k = max(self.estimator.n_neighbors, self.normals.n_neighbors)
        if n_places < max(COMPILE_FROM, k + 1):
            return self._judge_together(n_places)
        crease = self.estimator.criterion == "crease"
        columns_of = face_columns
        if not crease:
            columns_of = partial(value_column, criterion=self.estimator.criterion)
        constants = self._find_normals(kept, columns_of)
        if crease:
            return self._find_creases(kept, some, job)
        values = ValueJob(job, self.normals, constants)
        self.sweep("edges", find_values, self.cells, self.folder.is_done, job=values)
        parts = partial(values_in_parts, self.faces, some, constants.dtype)
        return -least_of_edge(parts, self.estimator.threshold, self.estimator.n_std, median_of)

    def _find_creases(self, kept, some, job):
        """Distances to creases; returns the one within which points are edges'."""
        low, high = kept.extent(some)
        job = job._replace(origin=tuple(middle(low.min(axis=0), high.max(axis=0)).tolist()))
        self.sweep("spacing", find_spacing, kept, job=job)
        self.sweep("faces", find_faces, kept, job=job)
        self.sweep("creases", find_creases, kept, job=job)
        self.sweep("edges", find_distances, self.cells, self.folder.is_done, job=job)
        return self.estimator._crease_width()

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
            job = Job(self.folder.cells, self.scores, self.detector, constants, n_points)
            with progress_part(0.0, ENDS["outliers"], "outliers"):
                columns, cutoff = Columns(self.scores), cutoff_of(self.detector)
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

    def _find_normals(self, kept, columns_of):
        """What is stored of the normals of the kept points; returns the constants of these."""
        self.faces.mkdir(exist_ok=True)
        constants = self.folder.constants
        if self.detector is not None:
            constants = self._kept_constants(kept)
        some = np.flatnonzero(kept.counts)

        def is_done(cell):
            return tile_files(self.faces, cell)[0].exists()

        self.n_resumed = sum(map(is_done, some))
        self.sweep(
            "normals", partial(normals_of_tile, kept.folder), kept, is_done,
            estimator=self.normals, constants=constants, target=self.faces,
            columns_of=partial(columns_of, dtype=constants.dtype),
        )  # fmt: skip
        self.n_proved = total_proved(self.faces, some)
        return constants

    def _kept_constants(self, kept):
        constants = self.folder.constants
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
            results = np.empty(len(rows), SCORED)
            results["row"] = rows
            results["values"][:, 0] = detector.scores_[places]
            write_whole(tile_files(self.folder.results, cell)[0], results)
        self.n_proved = self.n_kept
        return detector.offset_
