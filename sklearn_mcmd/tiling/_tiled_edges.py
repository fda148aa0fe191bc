"""Edges of clouds larger than memory: in sweeps over cells, with the scores of memory."""

import shutil
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from sklearn_mcmd._validation import check_n_kept
from sklearn_mcmd.edges import SharpFeatureDetector
from sklearn_mcmd.edges._crease_distance import (
    CreaseLimits,
    Creases,
    Faces,
    are_faces,
    average_around,
    cosine_of,
    flatness,
    spacing_of,
)
from sklearn_mcmd.edges._detector import (
    column_of_criterion,
    crease_width,
    least_of_edge,
    steps_of,
)
from sklearn_mcmd.outliers import MCMDOutlierDetector
from sklearn_mcmd.planes._around import quantile_of
from sklearn_mcmd.planes._record import Planes
from sklearn_mcmd.runtime._chunks import slices
from sklearn_mcmd.tiling._cells import Cells, Constants, WholeCloud
from sklearn_mcmd.tiling._memory import most_neighbors, work_of
from sklearn_mcmd.tiling._result_files import N_TRANSFORMED, fit_together, scores_of
from sklearn_mcmd.tiling._run import TiledVerb, check_estimator, warm_up
from sklearn_mcmd.tiling._sensor_origins import recognized
from sklearn_mcmd.tiling._stored_columns import CellColumns, StoredColumns
from sklearn_mcmd.tiling._stored_index import CHUNK, StoredIndex
from sklearn_mcmd.tiling._stored_offers import settle
from sklearn_mcmd.tiling._tiled_normals import (
    PlaneJob,
    find_planes,
    fitted_to_new,
    plane_steps,
    stored_planes,
    without_sides,
)
from sklearn_mcmd.tiling._tiled_outliers import OutlierJob, cutoff_of, judge_cells, outlier_steps

FACE_COLUMNS = {"owners": np.int32, "on_face": bool, "doubtful": bool}


def even_steps():
    """The steps that even out the spacing, each with a column of its name."""
    return [f"even{n}" for n in range(CreaseLimits().evening_steps)]


def crease_steps():
    """The steps of creases in their order, as of `Sweeps`."""
    return "spacing", *even_steps(), "flat", "faces", "creases", "edges"


def crease_columns():
    """The columns that these steps fill."""
    planes = [f"crease_{name}" for name in ("scale", "radius", "kept")]
    numbers = "spacing", *even_steps(), *planes, "crease", "off", "evidence"
    faces = {f"face_{name}": kind for name, kind in FACE_COLUMNS.items()}
    return dict.fromkeys(numbers, float) | dict.fromkeys(("flat", "usable"), bool) | faces


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
        steps = crease_steps() if self.by_distance else ("edges",)
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
        k = self.estimator.n_neighbors if self.by_distance else 0
        whole = find_planes(sweeps, job, k, self.estimator.n_neighbors)
        if whole is None:
            self.limit = fit_together(job, self.estimator, run.cells, lambda f: f.scores_).offset_
        elif self.by_distance:
            sweeps("faces-settled", settle, kept, job=job)
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
        with sweeps.part("outliers", "outliers"):
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

    @cached_property
    def cells(self):
        return KeptCells(self.points, self.columns) if self.is_cleaned else Cells(self.points)

    def index_of_creases(self):
        """The neighborhoods in which creases are sought."""
        return StoredIndex(self.whole(), self.cells, self.edges.n_neighbors, n_jobs=self.n_threads)

    def own_places(self, cell):
        """The places of a cell, and a function that takes slices of these: their neighborhoods."""
        index, own = self.index_of_creases(), self.whole().rows(cell)

        def around(part):
            if isinstance(part, slice):
                return index.query_own(slice(own.start + part.start, own.start + part.stop))
            return index.query_own(own.start + part)

        return index.points[own], around

    def creases(self):
        """The `Creases` of all places, as far as they are known."""
        whole = self.whole()
        names = ("scale", "radius", "kept")
        planes = {name: whole.open(f"crease_{name}") for name in names}
        planes.update((name, whole.open(name)) for name in ("centroids", "normals"))
        return Creases(
            index=self.index_of_creases(),
            planes=Planes.empty(0, 3)._replace(**planes, spacing=whole.open(even_steps()[-1])),
            flat=whole.open("flat"),
            usable=whole.open("usable"),
            cosine=cosine_of(self.edges.min_angle),
            n_jobs=self.n_threads,
            faces=Faces(*(whole.open(f"face_{name}") for name in FACE_COLUMNS)),
            evidence=whole.open("evidence"),
        )

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
    """Change the columns `FACES` of the kept places of a cell."""
    job.whole().change(cell, **stored_planes(cell, job, fitted)[2])


def _find_distances(sweeps, job, whole, all_cells):
    """Write the scores of all points, by the planes of the kept places: `whole`."""
    sweep = partial(sweeps, cells=job.cells, job=job)
    cells = np.flatnonzero(job.cells.counts)
    whole.make(**crease_columns())
    sweep("spacing", _measure_spacing)
    whole.remove("scale")
    for before, step in zip(["spacing", *even_steps()], even_steps(), strict=False):
        sweep(step, partial(_even, step=step, before=before))
        whole.remove(before)
    parts = partial(_flatness, whole, cells)
    report = whole.columns.once("usual", lambda: {"flatness": float(quantile_of(parts, 0.5))})
    sweep("flat", partial(_find_flat, usual=report["flatness"]))
    sweep("faces", _give_faces)
    sweep("creases", _meet)
    sweeps("edges", _find_scores, all_cells, job=job)


def _flatness(whole, cells):
    for cell in cells:
        yield flatness(_own_planes(whole, cell))


def _own_planes(whole, cell):
    """Noise and radius of the planes of a cell."""
    found = {
        name: whole.rows_of(f"crease_{name}", whole.rows(cell)) for name in ("scale", "radius")
    }
    return Planes.empty(0, 3)._replace(**found)


def _measure_spacing(cell, job):
    """Find what is measured of the planes of a cell."""
    whole, index = job.whole(), job.index_of_creases()
    own, found = whole.rows(cell), []
    for part in slices(own.stop, CHUNK, own.start):
        scale = whole.rows_of("scale", part)
        found.append(spacing_of(index, part, index.query_own(part), scale))
    radius, spacing, scale = map(np.concatenate, zip(*found, strict=True))
    known = {"scale": scale, "radius": radius, "kept": np.ones(len(scale))}
    return {"spacing": spacing, **{f"crease_{name}": of for name, of in known.items()}}


def _even(cell, job, step, before):
    """Find the mean spacing around the places of a cell."""
    whole, index = job.whole(), job.index_of_creases()
    own, spacing = whole.rows(cell), whole.open(before)
    means = np.empty(own.stop - own.start)
    for part in slices(own.stop, CHUNK, own.start):
        rows = slice(part.start - own.start, part.stop - own.start)
        average_around(spacing, index.query_own(part), means[rows])
    return {step: means}


def _find_flat(cell, job, usual):
    """Find which planes of a cell are those of faces."""
    flat = are_faces(_own_planes(job.whole(), cell), usual)
    return {"flat": flat, "usable": np.ones(len(flat), bool)}


def _give_faces(cell, job):
    """Find the planes that are given to the places of a cell, and distances without a crease."""
    points, around = job.own_places(cell)
    faces = Faces(*(np.empty(len(points), kind) for kind in FACE_COLUMNS.values()))
    distance = job.creases().give_planes(points, around, faces)
    found = {f"face_{name}": values for name, values in faces._asdict().items()}
    return {"crease": distance, **found}


def _meet(cell, job):
    """Find how far the places of a cell are from where two planes meet, and the evidence."""
    creases, own, (points, around) = job.creases(), job.whole().rows(cell), job.own_places(cell)
    faces, evidence = Faces(*(part[own] for part in creases.faces)), np.empty(len(points))
    off = creases.meet(points, around, faces, evidence)
    return {"off": off, "evidence": evidence}


def _find_scores(cell, job):
    """Find the scores of all points of a cell: their distances from a crease."""
    creases, whole = job.creases(), job.whole()

    def of_kept():
        own, (_, around) = whole.rows(cell), job.own_places(cell)
        distance = whole.rows_of("crease", own)
        creases.judge(around, whole.rows_of("off", own), distance)
        return distance[job.columns.read(cell, "place_of")]

    def of_removed(queries):
        return creases.distance(queries, creases.index.query(queries))

    return job.scores(cell, of_kept, of_removed)


def _keep_values(cell, job, fitted):
    """The values of the criterion, of the places of a cell."""
    return {"values": _values(job, fitted)}


def _values(job, fitted):
    """The values of the criterion of a fitted estimator, as `transform` has them: float64 (n,)."""
    name = column_of_criterion(job.edges.criterion)
    if name == "eigenvalue_0":
        values = fitted.eigenvalues_[:, 0]
    elif name == "surface_variation":
        values = fitted.surface_variation_
    else:
        place = list(fitted.get_feature_names_out(list("xyz"))).index(name)
        values = fitted.features_[:, place - N_TRANSFORMED]
    return values.astype(job.constants.dtype).astype(np.float64)


def _values_in_parts(columns, cells):
    """The values of all kept points, cell by cell: float64."""
    for cell in cells:
        yield columns.read(cell, "values")[columns.read(cell, "place_of")]


def _find_values(cell, job):
    """Find the scores of all points of a cell, once the values of the kept places are known."""

    def of_removed(queries):
        return -_values(job, fitted_to_new(job, queries))

    return job.scores(cell, lambda: -next(_values_in_parts(job.columns, [cell])), of_removed)
