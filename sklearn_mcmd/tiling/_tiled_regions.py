"""Regions of clouds larger than memory: they grow and are divided by tiles, one process joins."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from sklearn_mcmd._errors import warn
from sklearn_mcmd.io._region_files import SUFFIXES, write_regions
from sklearn_mcmd.normals import RobustNormalEstimator
from sklearn_mcmd.planes._record import Planes
from sklearn_mcmd.planes._resolution import least_scales
from sklearn_mcmd.segmentation._estimator import RegionGrowing, finish_regions
from sklearn_mcmd.segmentation._merge_coplanar import region_planes
from sklearn_mcmd.segmentation._region_sums import n_regions_of, region_sizes
from sklearn_mcmd.segmentation._region_table import region_table
from sklearn_mcmd.tiling._cell_parts import CellParts
from sklearn_mcmd.tiling._memory import bytes_to_join, most_neighbors, work_of
from sklearn_mcmd.tiling._result_files import fit_together, write_results_of_places
from sklearn_mcmd.tiling._run import TiledVerb, warm_up
from sklearn_mcmd.tiling._stored_columns import RevisedColumn, StoredColumns
from sklearn_mcmd.tiling._stored_index import StoredIndex
from sklearn_mcmd.tiling._stored_offers import FACES
from sklearn_mcmd.tiling._tiled_division import divide_in_tiles
from sklearn_mcmd.tiling._tiled_growing import STEPS, grow_in_cells
from sklearn_mcmd.tiling._tiled_normals import (
    PlaneJob,
    find_planes,
    plane_steps,
    stored_planes,
    without_sides,
)

LARGEST = 20  # regions whose points are counted in the report


class TiledRegions(TiledVerb):
    """Regions, which grow and are divided by tiles; this process joins what tiles find."""

    options = ("colors", "regions")

    def __init__(self, estimator, colors, regions):
        estimator._validate_params()
        if estimator.normal_estimator is None:
            normals = RobustNormalEstimator(random_state=estimator.random_state, n_jobs=1)
            estimator.set_params(normal_estimator=normals)
        without_sides(estimator.normal_estimator)
        super().__init__(estimator, f"colors={colors} {regions}")
        self.colors, self.table = colors, regions and Path(regions)
        self.asked = self.table.suffix.lower() if self.table else ""
        if self.table and self.asked not in SUFFIXES:
            raise ValueError(f"regions={str(regions)!r} must end in {', '.join(SUFFIXES)}.")

    def prepare(self, catalog):
        normals = self.estimator.normal_estimator
        most = most_neighbors(catalog.n_points, self.estimator, normals)
        warm_up(self.estimator)
        return work_of("regions", normals, table=bool(self.table)), 0, most

    def find(self, run):
        self.found = run.folder.columns.once("regions", partial(self._find, run))

    def _find(self, run):
        sizes, table = _segment(self.estimator, run)
        if self.table:
            write_regions(self._place(run.folder), table())
        sizes = [int(size) for size in sizes]
        return {"n_regions": len(sizes), "n_inside": sum(sizes), "largest": sizes[:LARGEST]}

    def make(self, cloud, values, xyz):
        from sklearn_mcmd.plotting._still import with_regions

        return with_regions(cloud, values[:, 0], self.colors), None

    def others(self, folder):
        return [(self._place(folder), self.table)] if self.table else []

    def _place(self, folder):
        """Where the table of regions is until it is moved."""
        return folder.results / f"regions{self.asked}"

    def report(self, run, total):
        return {"removed_fraction": 0.0, **self.found}


@dataclass(frozen=True)
class RegionJob(PlaneJob):
    """A job on the normals that a `RegionGrowing` asks for."""

    growing: RegionGrowing | None = None

    def floor(self, points):
        """The least scales of points, by their rounding."""
        return least_scales(points, np.finfo(self.constants.dtype).eps, self.constants.step)


def _segment(growing, run):
    """Write the region of all points of a run for each cell.

    Returns the sizes of regions, and a function that makes their table.
    """
    k, normals = growing.n_neighbors, growing.normal_estimator
    job = RegionJob.of(run, normals, keep=_keep_planes, later=k, growing=growing)
    sweeps = run.sweeps([*plane_steps(job.estimator), *STEPS, "joining"])
    whole = find_planes(sweeps, job, k, variation=job.constants.dtype)
    if whole is None:
        fitted = fit_together(job, growing, run.cells, lambda fitted: fitted.labels_)
        return fitted.region_sizes_, lambda: fitted.regions_
    sweep = partial(sweeps, cells=run.cells, job=job)
    grow_in_cells(sweep, job, run.memory)
    parts = CellParts(job, run.plan.n_workers)
    with sweeps.part("joining"):
        labels, planes = _finish(run, job, parts)
    write_results_of_places(job, labels)
    points, counts, n = whole.column("points"), whole.column("counts"), n_regions_of(labels)

    def table():
        weights = counts if len(whole) < run.cells.counts.sum() else None
        moments = region_planes(points, labels, n, weights, parts)
        return region_table(points, labels, planes, moments, parts)

    return region_sizes(labels, n, counts), table


def _keep_planes(cell, job, fitted):
    """The variation of a cell's places, and the offsets of their planes, which are changed."""
    points, columns, faces = stored_planes(cell, job, fitted)
    faces["scale"] = np.maximum(faces["scale"], job.floor(points))
    job.whole().change(cell, **faces)
    return {"variation": columns.surface_variation, "offset": columns.offset}


def _finish(run, job, parts):
    """Regions of all places, once they have grown; and the planes then."""
    growing, whole = job.growing, job.whole()
    faces = [RevisedColumn(whole.column(name).path) for name in FACES]
    for column in faces:  # an earlier run may have ended amid these steps, which begin anew
        column.restore()
    whole.copy(True, labels="region_of")
    labels, floor, counts, reach = map(whole.column, ("region_of", "floor", "counts", "reach"))
    _warn_if_much(labels, growing.n_neighbors, run.memory)
    index = StoredIndex(whole, n_neighbors=growing.n_neighbors, column=StoredColumns.column)
    planes = Planes.empty(0, 3)._replace(**dict(zip(FACES, faces, strict=True)), radius=reach)
    divide = partial(divide_in_tiles, job=job, n_workers=run.plan.n_workers, memory=run.memory)
    known = labels, index, planes, floor, counts, growing, parts, run.n_threads
    return finish_regions(*known, divide), planes


def _warn_if_much(labels, n_neighbors, memory):
    """Warn if so many points are on no surface that the next steps take more than the memory."""
    sizes = region_sizes(labels, n_regions_of(labels))
    n_rest = len(labels) - int(sizes[sizes > n_neighbors].sum())
    needed = bytes_to_join(len(labels), n_rest)
    if needed > memory:
        warn(
            f"{n_rest:,} of {len(labels):,} different points lie on no surface; joining regions "
            f"may take {needed / 1e6:.0f}MB, more than $memory={memory / 1e6:.0f}MB"
        )
