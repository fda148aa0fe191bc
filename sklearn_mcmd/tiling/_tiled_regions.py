"""Regions of clouds larger than memory: planes and links by tiles, growth along links on disk."""

from pathlib import Path

import numpy as np

from sklearn_mcmd._errors import warn
from sklearn_mcmd.io._point_cloud import has_colors, with_results
from sklearn_mcmd.io._region_files import SUFFIXES, write_regions
from sklearn_mcmd.normals import RobustNormalEstimator
from sklearn_mcmd.planes._resolution import least_scales
from sklearn_mcmd.segmentation._estimator import finish_regions, rules_of
from sklearn_mcmd.segmentation._graph import grow_regions, link_neighbors, seed_order
from sklearn_mcmd.segmentation._merge_coplanar import region_planes
from sklearn_mcmd.segmentation._region_sums import region_sizes
from sklearn_mcmd.segmentation._region_table import region_table
from sklearn_mcmd.tiling._memory import bytes_to_join, most_neighbors, work_of
from sklearn_mcmd.tiling._result_files import fit_together, write_results_of_places
from sklearn_mcmd.tiling._run import TiledVerb, warm_up
from sklearn_mcmd.tiling._stored_columns import ALL
from sklearn_mcmd.tiling._stored_index import StoredIndex, count_copies
from sklearn_mcmd.tiling._stored_offers import FACES, NUMBER
from sklearn_mcmd.tiling._tiled_normals import (
    PlaneJob,
    find_planes,
    plane_steps,
    stored_planes,
    without_sides,
)

LARGEST = 20  # regions whose points are counted in the report


class TiledRegions(TiledVerb):
    """Regions: links by tiles, and growth of all in this process."""

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
        return work_of("regions", normals), 0, most

    def find(self, run):
        if not run.folder.columns.is_done(ALL, "regions"):
            sizes, table = _segment(self.estimator, run)
            if self.table:
                write_regions(self._place(run.folder), table())
            sizes = [int(size) for size in sizes]
            found = {"n_regions": len(sizes), "n_inside": sum(sizes), "largest": sizes[:LARGEST]}
            run.folder.columns.finish(ALL, "regions", **found)

    def make(self, cloud, values, xyz):
        from sklearn_mcmd.plotting._still import region_columns

        paints = not has_colors(cloud) if self.colors is None else self.colors
        return with_results(cloud, region_columns(values[:, 0], paints)), None

    def others(self, folder):
        return [(self._place(folder), self.table)] if self.table else []

    def _place(self, folder):
        """Where the table of regions is until it is moved."""
        return folder.results / f"regions{self.asked}"

    def report(self, run, total):
        return {"removed_fraction": 0.0, **run.folder.columns.report(ALL, "regions")}


def _segment(growing, run):
    """Write the region of all points of a run for each cell.

    Returns the sizes of regions, and a function that makes their table.
    """
    k = growing.n_neighbors
    job = PlaneJob.of(run, growing.normal_estimator, keep=_keep_planes, later=k)
    sweeps = run.sweeps([*plane_steps(job.estimator), "growth", "joining"])
    variation = job.constants.dtype, ()
    whole = find_planes(sweeps, job, k, k, variation=variation)
    if whole is None:
        fitted = fit_together(job, growing, run.cells, lambda fitted: fitted.labels_)
        return fitted.region_sizes_, lambda: fitted.regions_
    whole.settle("faces", FACES)
    whole.make(counts=(np.int32, ()), floor=NUMBER)
    for cell in np.flatnonzero(np.diff(whole.starts)):
        whole.put(cell, floor=_floor(job, whole.rows_of("points", whole.rows(cell))))
    count_copies(whole)
    with whole.releasing():
        labels, planes = _find_regions(growing, run, whole, sweeps)
    write_results_of_places(job, labels)
    counts, n = whole.open("counts"), int(labels.max(initial=-1)) + 1

    def table():
        points, weights = whole.open("points"), counts if counts.max() > 1 else None
        with whole.releasing():
            moments = region_planes(points, labels, n, weights, run.n_threads)
            return region_table(points, labels, planes, moments)

    return region_sizes(labels, n, counts), table


def _keep_planes(cell, job, fitted):
    """Fill variation, and change the columns `FACES`."""
    points, columns, faces = stored_planes(cell, job, fitted)
    faces["scale"] = np.maximum(faces["scale"], _floor(job, points))
    job.whole().put(cell, variation=columns.surface_variation)
    job.whole().change(cell, **faces)


def _floor(job, points):
    """The least scales of points, by their rounding."""
    return least_scales(points, np.finfo(job.constants.dtype).eps, job.constants.step)


def _find_regions(growing, run, whole, sweeps):
    """Regions of all places, once their planes and neighbors are known; and the planes then."""
    index, n_threads = StoredIndex(whole, run.cells, growing.n_neighbors), run.n_threads
    planes, points, floor = whole.planes(changing=True), index.points, whole.open("floor")
    with sweeps.part("growth", "growing regions"):
        links, radius = link_neighbors(index, planes, floor, rules_of(growing), n_threads)
        planes = planes._replace(radius=radius)
        labels = grow_regions(links, seed_order(whole.open("variation"), points, planes))
        del links
    _warn_if_much(labels, growing.n_neighbors, run.memory)
    with sweeps.part("joining"):
        counts = whole.open("counts")
        return finish_regions(labels, index, planes, floor, counts, growing, n_threads), planes


def _warn_if_much(labels, n_neighbors, memory):
    """Warn if so many points are on no surface that the next steps take more than the memory."""
    sizes = region_sizes(labels, int(labels.max(initial=-1)) + 1)
    n_rest = len(labels) - int(sizes[sizes > n_neighbors].sum())
    needed = bytes_to_join(len(labels), n_rest)
    if needed > memory:
        warn(
            f"{n_rest:,} of {len(labels):,} different points lie on no surface; joining regions "
            f"may take {needed / 1e6:.0f}MB, more than $memory={memory / 1e6:.0f}MB"
        )
