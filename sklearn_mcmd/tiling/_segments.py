"""Regions of clouds larger than memory: planes and links by tiles, growth along links on disk."""

import numpy as np
from sklearn.base import clone

from sklearn_mcmd._errors import ParameterWarning, warn_caller
from sklearn_mcmd.io._point_cloud import has_colors, with_results
from sklearn_mcmd.normals import RobustNormalEstimator
from sklearn_mcmd.planes._resolution import least_scales
from sklearn_mcmd.runtime._progress import progress_part
from sklearn_mcmd.segmentation._graph import grow_regions, link_neighbors, seed_order
from sklearn_mcmd.segmentation._region_sums import region_sizes
from sklearn_mcmd.segmentation._steps import finish_regions, rules_of
from sklearn_mcmd.tiling._cell_columns import CellColumns
from sklearn_mcmd.tiling._memory import bytes_to_join, most_neighbors, sized
from sklearn_mcmd.tiling._normals import without_sides
from sklearn_mcmd.tiling._outputs import write_outputs
from sklearn_mcmd.tiling._planes import (
    FACES,
    NUMBER,
    OWN,
    PlaneJob,
    ends_of,
    find_planes,
    told_planes,
)
from sklearn_mcmd.tiling._result_files import LABELED, Results, fit_together, write_results
from sklearn_mcmd.tiling._run import Verb, warm_up
from sklearn_mcmd.tiling._stored_columns import ALL, whole_of
from sklearn_mcmd.tiling._stored_index import StoredIndex
from sklearn_mcmd.tiling._sweeps import Sweeps

__all__ = ["Segments"]

STORED = {**FACES, "floor": NUMBER}
LARGEST = 20  # regions whose points are counted in the report
PLACES = 0.02  # the end of the search for places, as a share of the time
# The same of each other step.
ENDS = {"normals": 0.72, "growth": 0.82, "steps": 1.0}


class Segments(Verb):
    """Regions: links by tiles, and growth of all in this process."""

    options = ("colors",)

    def __init__(self, estimator, colors):
        super().__init__(_checked(estimator), f"colors={colors}")
        self.colors = colors

    def prepare(self, catalog):
        normals = self.estimator.normal_estimator
        most = most_neighbors(catalog.n_points, self.estimator, normals)
        warm_up(self.estimator)
        return sized("regions", normals), 0, most

    def find(self, run):
        self.columns = CellColumns(run.folder.results)
        self.n_resumed = self.columns.n_done(len(run.cells), "normals")
        if not self.columns.is_done(ALL, "regions"):
            job = PlaneJob.of(run, self.estimator.normal_estimator, tell_planes)
            sizes = [int(size) for size in _segment(self.estimator, job, run)]
            self.columns.finish(
                *(ALL, "regions"), n_regions=len(sizes), n_inside=sum(sizes),
                largest=sizes[:LARGEST],
            )  # fmt: skip

    def write(self, run):
        write_outputs(run, self, Results(run.folder.results, len(run.cells), LABELED))
        return {"removed_fraction": 0.0, **self.columns.report(ALL, "regions")}

    def make(self, cloud, values, xyz):
        return segmented(cloud, values[:, 0], self.colors), None


def _checked(estimator):
    """The estimator as tiles take it; raise if it cannot work by them."""
    estimator = clone(estimator)
    estimator._validate_params()
    if estimator.normals != "estimate":
        raise ValueError(
            f"normals={estimator.normals!r} cannot work by tiles: files have no columns of planes; "
            'normals="estimate" finds them.'
        )
    if estimator.normal_estimator is None:
        normals = RobustNormalEstimator(random_state=estimator.random_state)
        estimator.set_params(normal_estimator=normals)
    without_sides(estimator.normal_estimator)
    return estimator.set_params(n_jobs=1, normal_estimator__n_jobs=1)


def segmented(cloud, labels, colors=None):
    """The cloud with its regions, and colors of them if it has none of its own."""
    from sklearn_mcmd.plotting._still import region_columns

    paints = not has_colors(cloud) if colors is None else colors
    return with_results(cloud, region_columns(labels, paints))


def _segment(growing, job, run):
    """Write the region of all points of a run for each cell; returns the sizes of regions."""
    (cells, columns), plan = job.open(), run.plan
    ends = {**ENDS, **ends_of(PLACES, ENDS["normals"], job.estimator)}
    sweeps, variation = Sweeps(columns, plan.n_workers, ends), (job.constants.dtype, ())
    k = growing.n_neighbors
    whole = find_planes(sweeps, cells, job, k, k, variation=variation, **STORED)
    if whole is None:
        fitted, put = fit_together(job, growing, cells)
        put(fitted.labels_, LABELED)
        return fitted.region_sizes_
    whole.join("counts")
    whole.remove(*OWN)
    with whole.releasing():
        labels = _find_regions(growing, cells, whole, plan.n_workers * plan.n_threads, run.memory)
    for cell in range(len(cells)):
        own, rows = labels[whole.rows(cell)], cells.read(cell)["row"]
        write_results(columns.folder, cell, rows, own[columns.read(cell, "place_of")], LABELED)
    return region_sizes(labels, int(labels.max(initial=-1)) + 1, whole.open("counts"))


def tell_planes(cell, job, fitted):
    """Fill the columns `STORED`, of which floor is the least scale, and variation."""
    points, told, faces = told_planes(cell, job, fitted)
    floor = least_scales(points, np.finfo(job.constants.dtype).eps, job.constants.step)
    faces["scale"] = np.maximum(faces["scale"], floor)
    whole_of(job).put(cell, floor=floor, variation=told.surface_variation, **faces)


def _find_regions(growing, cells, whole, n_threads, memory):
    """Regions of all places, once their planes and neighbors are known."""
    index, planes = StoredIndex(whole, cells, growing.n_neighbors), whole.planes(changing=True)
    points, floor = index.points, whole.open("floor")
    with progress_part(ENDS["normals"], ENDS["growth"], "growing regions"):
        links, radius = link_neighbors(index, planes, floor, rules_of(growing), n_threads)
        planes = planes._replace(radius=radius)
        labels = grow_regions(links, seed_order(whole.open("variation"), points, planes))
        del links
    _warn_if_much(labels, growing.n_neighbors, memory)
    with progress_part(ENDS["growth"], ENDS["steps"]):
        counts = whole.open("counts")
        return finish_regions(labels, index, planes, floor, counts, growing, n_threads)


def _warn_if_much(labels, n_neighbors, memory):
    """Warn if so many points are on no surface that the next steps take more than the memory."""
    sizes = region_sizes(labels, int(labels.max(initial=-1)) + 1)
    n_rest = len(labels) - int(sizes[sizes > n_neighbors].sum())
    needed = bytes_to_join(len(labels), n_rest)
    if needed > memory:
        warn_caller(
            ParameterWarning(
                f"{n_rest:,} of {len(labels):,} different points lie on no surface; joining "
                f"regions may take {needed / 1e6:.0f}MB, more than $memory={memory / 1e6:.0f}MB"
            )
        )
