"""What has moved between two clouds larger than memory: both share the cells."""

from functools import partial
from typing import Any, NamedTuple

import numpy as np
from sklearn.base import clone

from sklearn_mcmd._validation import check_sizes
from sklearn_mcmd.change import CloudChange, moved_bodies
from sklearn_mcmd.change._comparison import (
    FEWEST,
    NO_SURFACE,
    NOTHING,
    REASONS,
    SAMPLE,
    Correction,
    Scale,
    Summary,
    columns_of,
    judged,
    measure,
    radii_in,
)
from sklearn_mcmd.change._distances import (
    AlikeLimits,
    Surfaces,
    alike_of,
    alike_pairs,
    sampled,
    tree_of,
)
from sklearn_mcmd.change._estimator import (
    are_equal,
    check_overlap,
    registration_of,
    warn_of_nothing,
    warn_of_pair,
)
from sklearn_mcmd.io._point_cloud import with_results
from sklearn_mcmd.planes._indexed_cloud import IndexedCloud
from sklearn_mcmd.planes._whole import part_of
from sklearn_mcmd.runtime._progress import progress_part
from sklearn_mcmd.tiling._base import TiledVerb, check_estimator, warm_up
from sklearn_mcmd.tiling._catalog import Catalog
from sklearn_mcmd.tiling._cells import Levels, rounding_told
from sklearn_mcmd.tiling._halo import HOPS, HaloLimits, part_within

RINGS = 2.0 * HOPS  # usual radii within which rings of neighbors nearly always end
LEVELS = 2.0**12  # half between a number and its double, to which p-values are rounded up
BODIES = 250_000  # points of each cloud, about, that tell which flat surfaces moved
LOOKED = 0.05  # share of the time after which both clouds are known, for the progress
MEDIANS = 1_000_000  # points, about, of which medians are told


class Pair(NamedTuple):
    """What all cells know of both clouds."""

    counts: list[int]  # their points; those of the second have numbers from the first count on
    scale: Scale
    covariance: Any  # of the registration, as of `Measured.registered`
    center: np.ndarray
    told: dict  # of the `Whole` of the second


class TiledChange(TiledVerb):
    """Distances to a second cloud, along the normals of the first."""

    def __init__(self, estimator, second):
        check_estimator(estimator, CloudChange)
        super().__init__(estimator)
        if second is None:
            raise ValueError("second=None: CloudChange compares the source with a second cloud.")
        self.also = [second if isinstance(second, Catalog) else Catalog(second)]

    def prepare(self, catalog):
        Catalog([*catalog.paths, *self.also[0].paths])  # refuses several coordinate systems
        for one in (catalog, *self.also):
            check_sizes(one.n_points, 3, self.n_neighbors)
        self.registration = registration_of(self.estimator.registration, 3)
        warm_up(self.estimator)

    def measure_fit(self, xyz):
        alone = clone(self.estimator).set_params(registration=None)
        alone.fit(xyz[::2]).compare(xyz[1::2])

    def find(self, run):
        k, counts = self.estimator.n_neighbors, [run.catalog.n_points, self.also[0].n_points]
        is_auto = isinstance(self.registration, str)
        with progress_part(0.0, LOOKED):
            run.do("look", partial(look, counts=counts, k=k, thins=is_auto))
        facts = np.array(list(run.found("facts")))  # (n_cells, 2, 3, 3)
        low, high, total = facts[:, :, 0].min(0), facts[:, :, 1].max(0), facts[:, :, 2].sum(0)
        radii, others = (
            np.concatenate(list(run.found(name))) for name in ("radii", "radii_second")
        )
        self.scale = Scale.of(radii, others, k, self.estimator.reach)
        check_overlap((low[0], high[0]), (low[1], high[1]), self.scale.reach)
        warn_of_pair(self.scale, all(report["equal"] for report in run.reports("look")))
        self.bodies, covariance, center = None, self.registration, total[0] / counts[0]
        if is_auto:
            thinned = [np.concatenate(list(run.found(name))) for name in ("thin", "thin_second")]
            known = {"random_state": self.estimator.random_state, "n_jobs": run.plan.n_threads}
            with progress_part(LOOKED, LOOKED):
                self.bodies = moved_bodies(*thinned, alpha=self.estimator.alpha, **known)
            covariance, center = self.bodies.registration, thinned[0].mean(axis=0)
        pair = Pair(counts, self.scale, covariance, center, rounding_told(*run.constants["also"]))
        with progress_part(LOOKED, 1.0):
            run.do(self.task, partial(compare_cell, pair=pair), estimator=self.estimator)
        self.alike = alike_of(np.concatenate(list(run.found("alike"))))
        self._correct(run, counts[0])

    def _correct(self, run, n):
        """Find what the correction does, how many points moved or are not compared, and medians."""
        levels, step, self.medians = Levels(), n // MEDIANS + 1, (np.nan, np.nan)
        self.reasons = np.zeros(len(REASONS), np.int64)
        levels.add(np.empty(0), np.empty(0, np.int64))
        told = [np.empty((2, 0))]
        for values in self.results(run).of_cells():
            changes = self._changes(values[np.isfinite(values[:, 3])], rounded_up)
            compared = changes.reason == 0
            self.reasons += np.bincount(changes.reason, minlength=len(REASONS))
            levels.add(*np.unique(changes.pvalue[compared], return_counts=True))
            both = np.stack([changes.distance, changes.level_of_detection])
            told.append(both[:, compared][:, ::step])
        values, counts = levels.merged()
        self.correction = Correction.of(values, counts, self.estimator.correction)
        self.n_moved = int(counts[self.correction.adjusted < self.estimator.alpha].sum())
        if (both := np.concatenate(told, axis=1)).size:
            self.medians = tuple(np.median(both, axis=1).tolist())

    def _changes(self, values, adjust=None):
        """The `Changes` of results: distance, variance, that of the registration, and reason."""
        distance, variance, registered, reason = values.T.astype(np.float64)
        variance = variance * np.nan_to_num(self.alike, nan=1.0) + registered
        if adjust is None:
            adjust = self._adjust
        return judged(distance, variance, reason.astype(int), self.estimator.alpha, adjust)

    def _adjust(self, pvalues):
        return self.correction.adjust(rounded_up(pvalues))

    def make(self, cloud, values, xyz):
        return with_results(cloud, columns_of(self._changes(values))), None

    def report(self, run, total):
        reasons = self.reasons.tolist()
        warn_of_nothing(reasons[NOTHING] / max(1, sum(reasons)), self.scale.reach)
        summary = Summary(reasons, self.n_moved, *self.medians, self.alike, self.bodies)
        return {"removed_fraction": 0.0, "change": summary.stored()}


def rounded_up(pvalues):
    """P-values of few digits, of which there are not too many to be counted."""
    mantissa, exponent = np.frexp(pvalues)
    return np.ldexp(np.ceil(mantissa * LEVELS) / LEVELS, exponent)


def look(cell, job, counts, k, thins):
    """What is told of the points of both clouds in a cell: the least and most coordinates and their
    sums, how wide neighborhoods are, whether they are equal, and if asked a few of them."""
    xyz, is_first = job.cells.points(cell), job.cells.rows(cell) < counts[0]
    sides, facts = [xyz[is_first], xyz[~is_first]], np.zeros((2, 3, 3))
    facts[:, 0], facts[:, 1] = np.inf, -np.inf
    found = {"equal": are_equal(*sides), "facts": facts}
    for i, (side, n, end) in enumerate(zip(sides, counts, ("", "_second"), strict=True)):
        if len(side):
            facts[i] = side.min(axis=0), side.max(axis=0), side.sum(axis=0)
        found[f"radii{end}"] = radii_in(side, tree_of(side), k, SAMPLE / n, job.n_threads)
        if thins:
            found[f"thin{end}"] = side[sampled(side, BODIES / n)]
    return found


def compare_cell(cell, job, pair):
    """Compare the clouds at the points of the first in a cell."""
    n_first, scale, cells = pair.counts[0], pair.scale, job.cells
    margin = max(scale.reach, RINGS * scale.usual)
    while True:
        part = part_within(cells, cell, margin)
        is_first = part.rows < n_first
        first, second = part.taken(is_first), part.taken(~is_first)
        # A neighborhood of the first cloud is complete, unless strays are far from all of it; the
        # second may have a hole.
        has_most = len(first.rows) > job.estimator.n_neighbors or len(first.rows) == n_first
        is_wide = len(part.rows) > HaloLimits().most * np.count_nonzero(part.own)
        if has_most or is_wide or not first.own.any():
            break
        margin = 2 * margin or float(np.ptp(part.xyz, axis=0).max()) or 1.0
    values = np.full((len(part.rows), 4), np.nan, np.float32)
    found, n_own = np.empty((0, 3)), int(np.count_nonzero(first.own))
    n_proven = n_own * has_most
    values[is_first, 3] = NOTHING if len(second.rows) < FEWEST else NO_SURFACE
    if n_own and min(len(first.rows), len(second.rows)) >= FEWEST:
        sizes = job.estimator.n_neighbors, scale.n_neighbors
        before = surfaces_of(first, sizes[0], job, job.whole)
        after = surfaces_of(second, sizes[1], job, job.whole._replace(**pair.told))
        told = measure(before, after, scale, job.n_threads)
        registered = told.registered(pair.covariance, first.xyz, pair.center)
        columns = told.distance, told.variance, registered, told.reason
        values[is_first] = np.column_stack(columns)
        limits = AlikeLimits()
        share = max(limits.pairs / n_first, 4 * limits.least / n_own)
        chosen = first.own & sampled(first.xyz, share)
        found = alike_pairs(before, told.distance, told.variance, chosen)
        if len(cells) > 1:
            n_proven = count_proven((first, second), sizes, told, job.n_threads)
    return {"results": values[part.own], "alike": found, "n_proven": n_proven}


def surfaces_of(side, n_neighbors, job, whole):
    """The `Surfaces` of the points of one cloud in a part."""
    with part_of(whole):
        xyz, tree = side.xyz.astype(whole.dtype), tree_of(side.xyz)
        return Surfaces.of(xyz, tree, n_neighbors, job.estimator.random_state, job.n_threads)


def count_proven(sides, sizes, told, n_threads):
    """Of how many own points of the first cloud the planes of both clouds are those of the whole
    ones."""
    own, others, proven = sides[0].own, told.others[sides[0].own], []
    asked = own, np.isin(np.arange(len(sides[1].rows)), others)
    for side, k, some in zip(sides, sizes, asked, strict=True):
        seeds = side.own | some
        proven.append(np.zeros(len(seeds), bool))
        proven[-1][seeds], _ = side._replace(own=seeds).proven(
            IndexedCloud.of(side.xyz), k, HOPS, n_threads
        )
    is_alone = told.reason[own] == NOTHING
    return int(np.count_nonzero(proven[0][own] & (is_alone | proven[1][others])))
