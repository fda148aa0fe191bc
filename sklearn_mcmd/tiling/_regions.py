"""Regions of clouds larger than memory: cells find their own, and share points with others."""

from functools import partial
from pathlib import Path

import numpy as np

from sklearn_mcmd.io._region_files import SUFFIXES, write_regions
from sklearn_mcmd.normals import RobustNormalEstimator
from sklearn_mcmd.segmentation._estimator import RegionGrowing, numbers_by_size
from sklearn_mcmd.tiling._borders import in_halo, join_regions
from sklearn_mcmd.tiling._halo import HOPS_MORE, WIDTH
from sklearn_mcmd.tiling._outputs import Results
from sklearn_mcmd.tiling._region_parts import joined_table, parts_of_regions
from sklearn_mcmd.tiling._run import TiledVerb, most_neighbors, warm_up
from sklearn_mcmd.tiling._verbs import hops_of, neighbors_of, without_sides

LARGEST = 20  # regions whose points are counted in the report


class TiledRegions(TiledVerb):
    """Regions of cells, joined where they share points."""

    options = ("colors", "regions")

    def __init__(self, estimator, colors, regions):
        estimator._validate_params()
        if estimator.normal_estimator is None:
            normals = RobustNormalEstimator(random_state=estimator.random_state, n_jobs=1)
            estimator.set_params(normal_estimator=normals)
        self.normals = without_sides(estimator.normal_estimator)
        super().__init__(estimator, f"colors={colors} {regions}")
        self.colors, self.table = colors, regions and Path(regions)
        if self.table and self.table.suffix.lower() not in SUFFIXES:
            raise ValueError(f"regions={str(regions)!r} must end in {', '.join(SUFFIXES)}.")

    @property
    def n_neighbors(self):
        return max(self.estimator.n_neighbors, neighbors_of(self.normals))

    def prepare(self, catalog):
        most_neighbors(catalog.n_points, self.estimator, self.normals)
        warm_up(self.estimator)

    def find(self, run):
        keep = partial(keep_regions, with_table=bool(self.table))
        hops = hops_of(self.normals) + HOPS_MORE
        growing = PartGrowing(**self.estimator.get_params(deep=False))
        run.fit(self.task, run.job(growing, keep, hops, WIDTH))
        self.found = run.results.once("regions", partial(self._join, run))

    def _join(self, run):
        """Write the joined regions of all points; returns what is reported of them."""
        results, cells = run.results, range(len(run.cells))
        starts = np.cumsum([0, *(results.report(cell, self.task)["n_regions"] for cell in cells)])
        n, sizes = int(starts[-1]), np.zeros(int(starts[-1]))
        for cell in cells:
            labels = results.read(cell, "results")[:, 0]
            own = np.bincount(labels[labels >= 0], minlength=starts[cell + 1] - starts[cell])
            sizes[starts[cell] : starts[cell + 1]] = own
        group = join_regions(results, cells, starts, sizes)
        totals = np.bincount(group, sizes, group.max(initial=-1) + 1)
        number = numbers_by_size(totals, self.estimator.min_region_size)[:-1]
        numbers = number[group] if n else np.empty(0, np.int32)
        for cell in cells:
            labels = results.read(cell, "results")[:, 0]
            known = np.append(numbers[starts[cell] : starts[cell + 1]], -1).astype(np.int32)
            results.keep(cell, "final", {"final": known[labels][:, None]})
        if self.table:
            write_regions(self._place(run.folder), joined_table(results, cells, starts, numbers))
        kept = np.sort(totals[number >= 0])[::-1].astype(int).tolist()
        return {"n_regions": len(kept), "n_inside": sum(kept), "largest": kept[:LARGEST]}

    def results(self, run):
        return Results(run.results, run.cells, "final")

    def make(self, cloud, values, xyz):
        from sklearn_mcmd.plotting._still import with_regions

        return with_regions(cloud, values[:, 0], self.colors), None

    def others(self, folder):
        return [(self._place(folder), self.table)] if self.table else []

    def _place(self, folder):
        """Where the table of regions is until it is moved."""
        return folder.outputs / f"regions{self.table.suffix.lower()}"

    def report(self, run, total):
        return {"removed_fraction": 0.0, **self.found}


class PartGrowing(RegionGrowing):
    """Keeps the `Segments` of a part of a cloud, and tells nothing else."""

    def fit(self, X, y=None):
        self.segments_ = self._segment(X)
        return self


def keep_regions(job, cell, part, fitted, cloud, with_table):
    """As `Job.keep`."""
    segments = fitted.segments_
    labels = segments.labels[segments.neighbor_index.places].astype(np.int32)
    found = {"results": labels[part.own, None], "n_regions": int(labels.max(initial=-1)) + 1}
    found |= in_halo(part, labels)
    if with_table:
        found |= parts_of_regions(segments, part.own[segments.neighbor_index.rows])
    return found
