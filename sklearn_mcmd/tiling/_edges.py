"""Edges of clouds larger than memory: in sweeps over cells, with the scores of memory."""

import shutil
from functools import partial

import numpy as np
from sklearn.base import clone

from sklearn_mcmd._validation import check_n_kept
from sklearn_mcmd.edges._detector import crease_width, steps_of
from sklearn_mcmd.edges._limits import least_of_edge
from sklearn_mcmd.io._files import one_clear_line
from sklearn_mcmd.io._point_cloud import has_colors, with_results
from sklearn_mcmd.runtime._progress import progress_part
from sklearn_mcmd.tiling._cell_columns import CellColumns, in_place_of
from sklearn_mcmd.tiling._cells import BOXES, Cells, _no_extent, _path, write_boxes
from sklearn_mcmd.tiling._cloud_constants import WholeCloud
from sklearn_mcmd.tiling._denoise import check_detector, cutoff_of, judge_cells
from sklearn_mcmd.tiling._edge_scores import (
    find_distances,
    find_values,
    tell_faces,
    tell_values,
    values_in_parts,
)
from sklearn_mcmd.tiling._memory import most_neighbors, sensed, sized
from sklearn_mcmd.tiling._normals import without_sides
from sklearn_mcmd.tiling._outlier_job import Job
from sklearn_mcmd.tiling._outputs import write_outputs
from sklearn_mcmd.tiling._planes import FACES, OWN, PlaneJob, ends_of, find_planes
from sklearn_mcmd.tiling._result_files import (
    SCORED,
    Results,
    fit_together,
    has_scores,
    scores_in_parts,
    tile_file,
)
from sklearn_mcmd.tiling._run import Verb, check_seed, warm_up
from sklearn_mcmd.tiling._sensor_origins import recognized
from sklearn_mcmd.tiling._sweeps import Sweeps

__all__ = ["Edges"]

PLACES = 0.47  # the end of the search for places, as a share of the time
# The same of each other step.
ENDS = {"outliers": 0.45, "kept": 0.46, "normals": 0.8, "edges": 1.0}


class Edges(Verb):
    """Edges of what a detector leaves."""

    options = ("colors",)

    def __init__(self, estimator, colors):
        super().__init__(clone(estimator).set_params(n_jobs=1), f"colors={colors}")
        check_seed(estimator)
        if estimator.normals != "estimate":
            raise ValueError(
                f"normals={estimator.normals!r} cannot work by tiles, which hold coordinates only: "
                "take normals='estimate'."
            )
        self.detector, normals = steps_of(estimator)  # no detector if nothing is removed
        if self.detector is not None:
            check_detector(self.detector)
            self.detector.set_params(n_jobs=1)
        self.normals, self.colors = without_sides(normals).set_params(n_jobs=1), colors
        self.by_distance = estimator.criterion == "crease"

    def prepare(self, catalog):
        most = most_neighbors(catalog.n_points, self.estimator, self.detector, self.normals)
        warm_up(self.estimator)
        if self.detector is not None:
            self.detector, _ = recognized(self.detector, catalog)
        return sensed(sized("edges", self.normals), self.detector), 0, most

    def find(self, run):
        columns, n_cells = CellColumns(run.folder.results), len(run.cells)
        ends = {**ENDS, **ends_of(PLACES, ENDS["normals"], self.normals)}
        sweep = Sweeps(columns, run.plan.n_workers, ends)
        kept = run.cells if self.detector is None else self._clean(run, sweep)
        sweep.begin, self.n_kept = ENDS["kept"], int(kept.counts.sum())
        job = PlaneJob.of(run, self.normals, tell_faces)
        if not self.by_distance:
            job = job._replace(tell=partial(tell_values, criterion=self.estimator.criterion))
        if self.detector is not None:
            constants = kept_constants(kept, job.constants.dtype)
            job = job._replace(cells=kept.folder, constants=constants)
        self.n_resumed = columns.n_done(n_cells, "normals")
        is_done = partial(has_scores, run.folder.results)
        k, stored = (self.estimator.n_neighbors, FACES) if self.by_distance else (0, {})
        whole = find_planes(sweep, kept, job, k, self.estimator.n_neighbors, **stored)
        if whole is None:
            words = ", of which {:,} places are no outliers,"
            detector, put = fit_together(job, self.estimator, run.cells, words)
            put(detector.scores_, SCORED)
            self.limit = detector.offset_
        elif self.by_distance:
            whole.remove(*OWN)
            if not all(map(is_done, range(n_cells))):
                n_threads = run.plan.n_workers * run.plan.n_threads
                with progress_part(ENDS["normals"], 1.0), whole.releasing():
                    find_distances(whole, job, run.cells, self.estimator, n_threads)
            self.limit = crease_width(self.estimator)
        else:
            known = {"all_cells": run.folder.cells, "criterion": self.estimator.criterion}
            sweep("edges", find_values, run.cells, is_done, job=job, **known)
            parts = partial(values_in_parts, columns, np.flatnonzero(kept.counts))
            self.limit = -least_of_edge(parts, self.estimator.threshold, self.estimator.n_std)

    def write(self, run):
        results = Results(run.folder.results, len(run.cells), SCORED)
        n_edges = int(write_outputs(run, self, results))
        n_removed = run.catalog.n_points - self.n_kept
        removed_fraction = n_removed / run.catalog.n_points
        return {
            "n_edges": n_edges, "n_outliers": n_removed, "removed_fraction": removed_fraction,
        }  # fmt: skip

    def make(self, cloud, values, xyz):
        from sklearn_mcmd.plotting._still import edge_columns

        scores = values[:, 0]
        paints = not has_colors(cloud) if self.colors is None else self.colors
        told = scores if self.by_distance else -scores
        return with_results(cloud, edge_columns(scores < self.limit, told, paints)), None

    def measure(self, values):
        return np.count_nonzero(values < self.limit)

    def _clean(self, run, sweep):
        """The cells of the points that the detector leaves."""
        folder, scores = run.folder, run.folder.results / "outliers"
        target = folder.cells / "kept"
        if not (target / BOXES).exists():
            scores.mkdir(exist_ok=True)
            target.mkdir(exist_ok=True)
            job = Job(
                *(folder.cells, scores, self.detector, folder.constants, run.catalog.n_points),
                n_threads=run.plan.n_threads,
            )
            with progress_part(0.0, ENDS["outliers"], "outliers"):
                columns, cutoff = CellColumns(scores), cutoff_of(self.detector)
                cutoff = judge_cells(job, run.cells, columns, run.plan.n_workers, cutoff)
            sweep.begin = ENDS["outliers"]
            parts = scores_in_parts(scores, len(run.cells))
            n_kept = sum(np.count_nonzero(values <= cutoff) for values in parts)
            check_n_kept("outlier_detector", self.detector, n_kept, run.catalog.n_points, least=4)
            sweep(
                "kept", find_kept, run.cells, folder=folder.cells, target=target,
                columns=folder.results, scores=scores, cutoff=cutoff,
            )  # fmt: skip
            close_kept(run.cells, target, sweep.columns)
        shutil.rmtree(scores, ignore_errors=True)
        return Cells(target)


def find_kept(cell, folder, target, columns, scores, cutoff):
    """Write the points of a cell whose scores are at most the cutoff, from one folder to another.

    Column: kept, of all points of the cell in their order.
    """
    cells, columns, path = Cells(folder), CellColumns(columns), _path(target, cell)
    kept = np.fromfile(tile_file(scores, cell), SCORED)["values"][:, 0] <= cutoff
    records = cells.read(cell)[kept]
    with one_clear_line(path, "written"), in_place_of(path) as temporary:
        temporary.write_bytes(records.data)
    extent = _no_extent()
    if len(records):
        extent = np.stack([records["xyz"].min(axis=0), records["xyz"].max(axis=0)])
    columns.write(cell, kept=kept)
    columns.finish(cell, "kept", count=len(records), extent=extent.tolist())


def close_kept(cells, target, columns):
    """Write what the cells of the kept points are; some may be empty. Returns these `Cells`."""
    reports = [columns.report(cell, "kept") for cell in range(len(cells))]
    extents = np.array([report["extent"] for report in reports])
    return write_boxes(
        target, names=np.arange(len(cells)), low=cells.low, high=cells.high,
        least=extents[:, 0], most=extents[:, 1], counts=[report["count"] for report in reports],
    )  # fmt: skip


def kept_constants(kept, dtype):
    """The `Constants` of the kept points, in the precision of the whole cloud."""
    whole = WholeCloud()
    whole.single = False  # the precision is known
    for cell in np.flatnonzero(kept.counts):
        whole.add(kept.read(cell)["xyz"])
    return whole.constants(dtype)
