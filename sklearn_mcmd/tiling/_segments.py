"""Regions of clouds larger than memory: planes and links by tiles, growth along links on disk."""

from functools import partial

from sklearn.base import clone

from sklearn_mcmd._errors import ParameterWarning
from sklearn_mcmd.io._point_cloud import has_colors, with_results
from sklearn_mcmd.normals import RobustNormalEstimator
from sklearn_mcmd.runtime._progress import progress_part
from sklearn_mcmd.segmentation._graph import grow_regions, link_neighbors, seed_order
from sklearn_mcmd.segmentation._region_sums import region_sizes
from sklearn_mcmd.segmentation._steps import finish_regions, rules_of
from sklearn_mcmd.tiling._cell_columns import CellColumns
from sklearn_mcmd.tiling._memory import bytes_to_join, most_neighbors, sized
from sklearn_mcmd.tiling._normals import without_sides
from sklearn_mcmd.tiling._outputs import LABELED, write_segmented_outputs
from sklearn_mcmd.tiling._planes import OWN, PlaneJob, are_few, ends_of, find_planes
from sklearn_mcmd.tiling._region_planes import STORED, tell_planes
from sklearn_mcmd.tiling._result_files import write_results
from sklearn_mcmd.tiling._run import Verb, warm_up
from sklearn_mcmd.tiling._small_clouds import fit_together
from sklearn_mcmd.tiling._stored_columns import ALL, whole_of
from sklearn_mcmd.tiling._stored_index import StoredIndex, find_places
from sklearn_mcmd.tiling._sweeps import Sweeps
from sklearn_mcmd.tiling._warnings import warn_caller

__all__ = ["Segments"]

WARM_UP = 3_000  # points that load or compile the code
LARGEST = 20  # regions whose points are counted in the report
# The end of each sweep and step, as a share of the time.
ENDS = {"places": 0.02, "normals": 0.72, "growth": 0.82, "steps": 1.0}


class Segments(Verb):
    """Regions: links by tiles, and growth of all in this process."""

    options = ("colors",)

    def __init__(self, estimator, colors):
        super().__init__(_checked(estimator), f"colors={colors}")
        self.colors = colors

    def prepare(self):
        warm_up(self.estimator, WARM_UP)
        normals = self.estimator.normal_estimator
        return sized("regions", normals), 0, most_neighbors(self.estimator, normals)

    def find(self, run):
        folder, n_cells = run.folder, len(run.cells)
        self.columns = CellColumns(folder.results)
        self.n_resumed = sum(self.columns.is_done(cell, "normals") for cell in range(n_cells))
        job = PlaneJob(
            folder.cells, folder.results, self.estimator.normal_estimator, folder.constants,
            tell_planes, run.plan.n_threads,
        )  # fmt: skip
        _segment(self.estimator, job, run.cells, run.plan.n_workers, run.memory)

    def write(self, run):
        make = partial(segmented, colors=self.colors)
        write_segmented_outputs(run.catalog, run.targets, run.folder, make, self.content)
        return {
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
    without_sides(estimator.normal_estimator)
    return estimator.set_params(n_jobs=1, normal_estimator__n_jobs=1)


def segmented(cloud, labels, colors=None):
    """The cloud with its regions, and colors of them if it has none of its own."""
    from sklearn_mcmd.plotting._still import region_columns

    paints = not has_colors(cloud) if colors is None else colors
    return with_results(cloud, region_columns(labels, paints))


def _segment(growing, job, cells, n_workers, memory):
    """Find the region of all points, and write them for each cell."""
    columns = job.open()[1]
    ends = {**ENDS, **ends_of(ENDS["places"], ENDS["normals"], job.estimator)}
    sweeps = Sweeps(columns, n_workers, ends)
    if columns.is_done(ALL, "regions"):
        return
    sweeps("places", find_places, cells, job=job)
    whole, k = whole_of(job), growing.n_neighbors
    if are_few(whole, job.estimator, k):
        return _segment_together(growing, job, cells, len(whole))
    whole.join("counts")
    whole.make(variation=(job.constants.dtype, ()), **STORED)
    find_planes(sweeps, cells, job, k)
    whole.remove(*OWN)
    with whole.releasing():
        labels = _find_regions(growing, cells, whole, n_workers * job.n_threads, memory)
    for cell in range(len(cells)):
        own, rows = labels[whole.rows(cell)], cells.read(cell)["row"]
        write_results(columns.folder, cell, rows, own[columns.read(cell, "place_of")], LABELED)
    sizes = region_sizes(labels, int(labels.max(initial=-1)) + 1, whole.open("counts"))
    _finish(columns, sizes)


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


def _segment_together(growing, job, cells, n_places):
    """Regions of a cloud of few places, which other code finds than that of tiles."""
    words = f" at {n_places:,} places"
    fitted, parts = fit_together(growing, cells, job.constants.dtype, words)
    for cell, (rows, places) in enumerate(parts):
        write_results(job.columns, cell, rows, fitted.labels_[places], LABELED)
    _finish(job.open()[1], fitted.region_sizes_)


def _finish(columns, sizes):
    """Remember that the regions of all points are written, and what they are."""
    sizes = [int(size) for size in sizes]
    columns.finish(
        ALL,
        "regions",
        n_regions=len(sizes),
        n_inside=sum(sizes),
        largest=sizes[:LARGEST],
    )
