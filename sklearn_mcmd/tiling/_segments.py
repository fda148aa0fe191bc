"""Regions of clouds larger than memory: planes and links by tiles, growth along links on disk."""

from functools import partial

import numpy as np
from sklearn.base import clone

from sklearn_mcmd._errors import ParameterWarning
from sklearn_mcmd.io._point_cloud import with_results
from sklearn_mcmd.normals import RobustNormalEstimator
from sklearn_mcmd.planes._indexed_cloud import COMPILE_FROM
from sklearn_mcmd.planes._progress import progress_part
from sklearn_mcmd.segmentation._graph import grow_regions, seed_order
from sklearn_mcmd.segmentation._region_sums import region_sizes
from sklearn_mcmd.segmentation._steps import finish_regions
from sklearn_mcmd.tiling._columns import Columns
from sklearn_mcmd.tiling._links import GrowthJob, find_links, find_neighbors, find_planes
from sklearn_mcmd.tiling._memory import bytes_to_join
from sklearn_mcmd.tiling._normals import check_normals
from sklearn_mcmd.tiling._outputs import LABELED, write_segmented_outputs
from sklearn_mcmd.tiling._run import Verb, warm_up
from sklearn_mcmd.tiling._sweeps import Sweeps
from sklearn_mcmd.tiling._tile import write_results
from sklearn_mcmd.tiling._together import fit_together
from sklearn_mcmd.tiling._warnings import warn_caller
from sklearn_mcmd.tiling._whole import ALL, StoredIndex, WholeColumns

__all__ = ["Segments"]

WARM_UP = 3_000  # points that load or compile the code
# Rows are numbers of 32 bits.
MOST_PLACES = 2**31 - 1
LARGEST = 20  # regions whose points are counted in the report
# The end of each sweep and step, as a share of the time.
ENDS = {"planes": 0.6, "neighbors": 0.72, "links": 0.77, "growth": 0.82, "steps": 1.0}
# What is joined to one file when a sweep has ended.
JOINED = {
    "planes": ("points", "copies", "floor", "centroids", "normals", "scale", "variation"),
    "neighbors": ("near", "radius", "usable", "limit"),
    "links": ("links",),
}


class Segments(Verb):
    """Regions: links by tiles, and growth of all in this process."""

    options = ("colors",)

    def __init__(self, estimator, colors):
        super().__init__(_checked(estimator), f"colors={colors}")
        self.colors = colors

    def prepare(self):
        warm_up(self.estimator, WARM_UP)
        return "regions", 0

    def find(self, run):
        folder, n_cells = run.folder, len(run.cells)
        self.columns = Columns(folder.results)
        self.n_resumed = sum(self.columns.is_done(cell, "planes") for cell in range(n_cells))
        job = GrowthJob(
            *(folder.cells, folder.results, self.estimator, folder.constants, run.plan.n_threads)
        )
        _segment(job, run.cells, self.columns, run.plan.n_workers, run.memory)

    def write(self, run):
        make = partial(segmented, colors=self.colors)
        write_segmented_outputs(run.catalog, run.targets, run.folder, make, self.content)
        n_proved = int(self.columns.total(len(run.cells), "planes", "n_proved"))
        return {
            "n_proved": n_proved,
            "n_resumed": self.n_resumed,
            "removed_fraction": 0.0,
            **self.columns.report(ALL, "regions"),
        }


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
    check_normals(estimator.normal_estimator, inner=True)
    return estimator.set_params(n_jobs=1, normal_estimator__n_jobs=1)


def segmented(cloud, labels, colors=None):
    """The cloud with its regions, and colors of them if it has none of its own."""
    results = {"region": labels.astype(np.int32)}
    names = ("red", "green", "blue")
    if cloud.attributes.keys().isdisjoint(names) if colors is None else colors:
        from sklearn_mcmd.plotting import region_colors

        bits = np.rint(255 * region_colors(labels)).astype(np.uint8)
        results |= dict(zip(names, bits.T.copy(), strict=True))
    return with_results(cloud, results)


def _segment(job, cells, columns, n_workers, memory):
    """Find the region of all points, and write them for each cell."""
    n_cells, sweeps = len(cells), Sweeps(columns, n_workers, ENDS)
    if columns.is_done(ALL, "regions"):
        return
    sweep = partial(sweeps, cells=cells, job=job)
    sweep("planes", find_planes)
    whole = WholeColumns(columns, n_cells)
    sizes = job.growing.n_neighbors, job.growing.normal_estimator.n_neighbors + 1
    if len(whole) < max(COMPILE_FROM, *sizes):
        return _segment_together(job, cells, columns, len(whole))
    if len(whole) > MOST_PLACES:
        raise ValueError(f"{len(whole):,} different points are more than {MOST_PLACES:,}")
    whole.join(*JOINED["planes"])
    sweep("neighbors", find_neighbors, collect=False)
    whole.join(*(name for name in JOINED["neighbors"] if whole.has(name)))
    if not columns.is_done(ALL, "grown"):
        sweep("links", find_links, collect=False)
        whole.join(*JOINED["links"])
        with progress_part(sweeps.begin, ENDS["growth"], "growing regions"):
            columns.write(ALL, grown=_grow(whole))
        columns.finish(ALL, "grown")
    whole.remove("links", "limit", "usable", "variation")
    labels = columns.read(ALL, "grown")
    _warn_if_much(labels, job.growing.n_neighbors, memory)
    with progress_part(ENDS["growth"], ENDS["steps"]):
        labels = finish_regions(
            labels, StoredIndex(whole), whole.planes(changing=True), whole.open("floor"),
            whole.open("copies"), job.growing, n_workers * job.n_threads,
        )  # fmt: skip
    for cell in range(n_cells):
        own, rows = labels[whole.rows(cell)], cells.read(cell)["row"]
        write_results(columns.folder, cell, rows, own[columns.read(cell, "place_of")], LABELED)
    sizes = region_sizes(labels, int(labels.max(initial=-1)) + 1, whole.open("copies"))
    _finish(columns, sizes)


def _grow(whole):
    """Regions of all places, by links on disk."""
    seeds = seed_order(whole.open("variation"), whole.open("points"), whole.planes())
    labels = grow_regions(whole.open("links"), seeds)
    whole.close()
    return labels


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


def _segment_together(job, cells, columns, n_places):
    """Regions of a cloud of few places, which other code finds than that of tiles."""
    words = f" at {n_places:,} places"
    fitted, parts = fit_together(job.growing, cells, job.constants.dtype, words)
    for cell, (rows, places) in enumerate(parts):
        write_results(columns.folder, cell, rows, fitted.labels_[places], LABELED)
    _finish(columns, fitted.region_sizes_)


def _finish(columns, sizes):
    """Remember that the regions of all points are written, and what they are."""
    sizes = [int(size) for size in sizes]
    columns.finish(
        ALL, "regions", n_regions=len(sizes), n_inside=sum(sizes), largest=sizes[:LARGEST]
    )
