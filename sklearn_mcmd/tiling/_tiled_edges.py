"""Edges of clouds larger than memory: in sweeps over cells, with the scores of memory."""

import shutil
import warnings
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from sklearn_mcmd._validation import check_n_kept
from sklearn_mcmd.edges import SharpFeatureDetector
from sklearn_mcmd.edges._crease_distance import (
    Creases,
    cosine_of,
    crease_steps,
    flatness,
    spacing_steps,
)
from sklearn_mcmd.edges._detector import (
    TOO_MANY,
    crease_width,
    least_of_edge,
    steps_of,
    values_of,
)
from sklearn_mcmd.outliers import MCMDOutlierDetector
from sklearn_mcmd.planes._around import quantile_of
from sklearn_mcmd.tiling._cells import Cells, Constants, WholeCloud
from sklearn_mcmd.tiling._memory import most_neighbors, work_of
from sklearn_mcmd.tiling._result_files import fit_together, scores_of
from sklearn_mcmd.tiling._run import TiledVerb, check_estimator, warm_up
from sklearn_mcmd.tiling._sensor_origins import recognized
from sklearn_mcmd.tiling._stored_columns import CellColumns, StoredColumns
from sklearn_mcmd.tiling._stored_index import StoredIndex
from sklearn_mcmd.tiling._tiled_normals import (
    PlaneJob,
    find_planes,
    fitted_to_new,
    plane_steps,
    stored_planes,
    without_sides,
)
from sklearn_mcmd.tiling._tiled_outliers import OutlierJob, cutoff_of, judge_cells, outlier_steps


class TiledEdges(TiledVerb):
    """Edges of what a detector leaves."""

    options = ("colors",)

    def __init__(self, estimator, colors):
        super().__init__(estimator, f"colors={colors}")
        check_estimator(estimator, SharpFeatureDetector)
        self.detector, normals = steps_of(estimator)  # no detector if nothing is removed
        if self.detector is not None:
            check_estimator(self.detector, MCMDOutlierDetector)
        self.normals, self.colors = without_sides(normals), colors
        self.by_distance = estimator.criterion == "crease"

    def prepare(self, catalog):
        most = most_neighbors(catalog.n_points, self.estimator, self.detector, self.normals)
        warm_up(self.estimator)
        if self.detector is not None:
            self.detector, _ = recognized(self.detector, catalog)
        return work_of("edges", self.normals, self.detector), 0, most

    def find(self, run):
        columns = run.folder.columns
        cleaning = () if self.detector is None else ("outliers", "kept")
        steps = (*spacing_steps(), *crease_steps()) if self.by_distance else ("edges",)
        sweeps = run.sweeps([*cleaning, *plane_steps(self.normals), *steps])
        keep = _keep_faces if self.by_distance else _keep_values
        later = self.estimator.n_neighbors if self.by_distance else None
        job = EdgeJob.of(run, self.normals, later=later, keep=keep, edges=self.estimator)
        if self.detector is not None:
            constants = Constants(**columns.once("cleaned", partial(self._clean, run, sweeps)))
            shutil.rmtree(_scored(run).folder, ignore_errors=True)
            job = replace(job, is_cleaned=True, constants=constants)
        kept = job.cells
        self.n_kept = int(kept.counts.sum())
        whole = find_planes(sweeps, job, self.estimator.n_neighbors)
        if whole is None:
            self.limit = fit_together(job, self.estimator, run.cells, lambda f: f.scores_).offset_
        elif self.by_distance:
            _find_distances(sweeps, job, whole, run.cells)
            self.limit = crease_width(self.estimator)
        else:
            sweeps("edges", _find_values, run.cells, job=job)
            parts = partial(_values_in_parts, columns, np.flatnonzero(kept.counts))
            self.limit = -least_of_edge(parts, self.estimator.threshold, self.estimator.n_std)

    def make(self, cloud, values, xyz):
        from sklearn_mcmd.plotting._still import with_edges

        scores = values[:, 0]
        shown = scores if self.by_distance else -scores
        return with_edges(cloud, scores < self.limit, shown, self.colors), None

    def measure(self, values):
        return np.count_nonzero(values < self.limit)

    def report(self, run, total):
        n_removed = run.catalog.n_points - self.n_kept
        share = n_removed / run.catalog.n_points
        return {"n_edges": int(total), "n_outliers": n_removed, "removed_fraction": share}

    def _clean(self, run, sweeps):
        """Find which points the detector leaves; returns the `Constants` of these."""
        scored, job = _scored(run), OutlierJob.of(run, self.detector)
        scored.folder.mkdir(exist_ok=True)
        with sweeps.part("outliers", "outliers"), warnings.catch_warnings():
            if self.estimator.outlier_detector is None:  # as in memory: nobody gave its number
                warnings.filterwarnings("ignore", TOO_MANY)
            inner, cutoff = run.sweeps(outlier_steps(self.detector)), cutoff_of(self.detector)
            cutoff = judge_cells(replace(job, found=scored.folder), inner, cutoff, run.memory)
        parts = scores_of(scored, run.cells)
        n_kept = sum(np.count_nonzero(scores <= cutoff) for scores in parts)
        check_n_kept("outlier_detector", self.detector, n_kept, run.catalog.n_points, least=4)
        sweeps("kept", _find_kept, run.cells, job=job, scored=scored, cutoff=cutoff)
        kept = KeptCells(run.folder.cells, run.folder.columns)
        return _constants_of(kept, run.folder.constants.dtype)._asdict()


def _scored(run):
    """The scores by which points are kept."""
    return CellColumns(run.folder.results / "outliers")


class KeptCells(Cells):
    """The points of cells that a detector has kept; some cells may have none."""

    def __init__(self, folder, columns):
        super().__init__(folder)
        self.columns = columns
        reports = [columns.report(cell, "kept") for cell in range(len(self))]
        self.counts = np.array([report["count"] for report in reports])

    def points(self, cell):
        return super().points(cell)[self.columns.read(cell, "kept")]

    def free(self, cell):
        """Keep the coordinates of removed points, too, in the column removed."""
        if not self.columns.path(cell, "removed").exists():
            removed = ~self.columns.read(cell, "kept")
            self.columns.write(cell, removed=super().points(cell)[removed])
        super().free(cell)


@dataclass(frozen=True)
class EdgeJob(PlaneJob):
    """A job on the points that were kept."""

    edges: SharpFeatureDetector | None = None
    is_cleaned: bool = False
    usual: float | None = None  # as of `Creases`

    @cached_property
    def cells(self):
        return KeptCells(self.points, self.columns) if self.is_cleaned else Cells(self.points)

    def creases(self):
        """The `Creases` of all places, as far as they are known."""
        whole, k = self.whole(), self.edges.n_neighbors
        index = StoredIndex(whole, self.cells, k, n_jobs=self.n_threads)
        known = CreaseColumns(whole), cosine_of(self.edges.min_angle), self.n_threads
        return Creases(index, *known, self.usual)

    def filled(self, cell, step):
        """What is known of the places of a cell when a step has found more, by these."""
        creases, own = self.creases(), self.whole().rows(cell)
        index, rows = creases.index, np.arange(own.start, own.stop)
        known = CreaseColumns(self.whole(), own)
        creases.fill(step, index.points[own], lambda part: index.query_own(rows[part]), known)
        return known

    def scores(self, cell, of_kept, of_removed):
        """The scores of all points of a cell: of those that were kept, and of coordinates."""
        columns = self.columns
        if not self.is_cleaned:
            return {"results": of_kept()[:, None]}
        kept = columns.read(cell, "kept")
        scores = np.empty(len(kept))
        if kept.any():
            scores[kept] = of_kept()
        if not kept.all():
            scores[~kept] = of_removed(columns.read(cell, "removed"))
        return {"results": scores[:, None]}


def _find_kept(cell, job, scored, cutoff):
    """Find which points of a cell have scores of at most the cutoff, and restore its points."""
    kept, cells = scored.read(cell, "results")[:, 0] <= cutoff, job.cells
    cells.restore(cell, StoredColumns(scored, len(cells)).xyz(cells, cell))
    return {"kept": kept, "count": int(np.count_nonzero(kept))}


def _constants_of(kept, dtype):
    """The `Constants` of the kept points, in the precision of the whole cloud."""
    whole = WholeCloud()
    for cell in np.flatnonzero(kept.counts):
        whole.add(kept.points(cell))
    return whole.constants(dtype)


def _keep_faces(cell, job, fitted):
    """The offsets of the planes of the kept places of a cell, which are changed."""
    _, columns, faces = stored_planes(cell, job, fitted)
    job.whole().change(cell, **faces)
    return {"offset": columns.offset}


class CreaseColumns(dict):
    """The columns of all places, or of some rows, that `Creases` know, each read when asked for."""

    def __init__(self, whole, rows=None):
        super().__init__()
        self._whole, self._rows = whole, rows

    def __missing__(self, name):
        whole, rows = self._whole, self._rows
        found = whole.open(name) if rows is None else whole.rows_of(name, rows)
        return self.setdefault(name, found)  # of threads that ask at once all fill the same array


def _find_distances(sweeps, job, whole, all_cells):
    """Write the scores of all points, by the planes of the kept places: `whole`."""

    def take(name, step, job):
        whole.make(**step.fills)
        sweeps(name, partial(_fill, step=step), job.cells, job=job)
        whole.remove(*step.ends)

    for known in spacing_steps().items():
        take(*known, job)
    rows = [whole.rows(cell) for cell in np.flatnonzero(job.cells.counts)]

    def parts():
        return (flatness(CreaseColumns(whole, some)) for some in rows)

    job = replace(job, **whole.columns.once("usual", lambda: {"usual": quantile_of(parts, 0.5)}))
    steps = crease_steps()
    last = steps.pop("edges")
    for known in steps.items():
        take(*known, job)
    sweeps("edges", partial(_find_scores, step=last), all_cells, job=job)


def _fill(cell, job, step):
    """Find the columns of a step for the places of a cell."""
    own = job.filled(cell, step)
    return {name: own[name] for name in step.fills}


def _find_scores(cell, job, step):
    """Find the scores of all points of a cell: their distances from a crease, by the last step."""

    def of_kept():
        return job.filled(cell, step)["crease"][job.columns.read(cell, "place_of")]

    def of_removed(queries):
        creases = job.creases()
        return creases.distance(queries, creases.index.query(queries))

    return job.scores(cell, of_kept, of_removed)


def _keep_values(cell, job, fitted):
    """The values of the criterion, of the places of a cell."""
    return {"values": values_of(job.edges.criterion, fitted, job.constants.dtype)}


def _values_in_parts(columns, cells):
    """The values of all kept points, cell by cell: float64."""
    for cell in cells:
        yield columns.read(cell, "values")[columns.read(cell, "place_of")]


def _find_values(cell, job):
    """Find the scores of all points of a cell, once the values of the kept places are known."""

    def of_removed(queries):
        fitted = fitted_to_new(job, queries)
        return -values_of(job.edges.criterion, fitted, job.constants.dtype)

    return job.scores(cell, lambda: -next(_values_in_parts(job.columns, [cell])), of_removed)
