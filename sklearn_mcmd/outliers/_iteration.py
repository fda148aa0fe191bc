"""Iteration over the cloud: every point is judged against the points retained so far.

The first pass judges points by the whole cloud and retains the seeds: near their planes, dense,
and in no small group. Each later pass refits the planes among the retained points and judges
all points again, retained or not, so that the retained set grows back along the surfaces.
"""

import numpy as np
from scipy.spatial import cKDTree

from sklearn_mcmd.outliers._company import Company, DenseSpacing, group_sizes
from sklearn_mcmd.outliers._judging import COMMON, HALF, LOCAL, OWN, Judge, judge
from sklearn_mcmd.planes._around import quantile_around, ratio
from sklearn_mcmd.planes._chunks import each_chunk, each_slice, run
from sklearn_mcmd.planes._explaining import Credibility, credible_planes
from sklearn_mcmd.planes._neighborhoods import ORDER_FROM, distinct_rows, spatial_order
from sklearn_mcmd.planes._progress import progress_part
from sklearn_mcmd.planes._record import Neighborhoods, Planes

__all__ = ["IteratedPlanes"]

CHUNK = {True: 4096, False: 256}  # rows a task, compiled or not
# A point stands apart if its neighbors are so many times farther from it than from each other,
# or than is usual on the dense surfaces of its wider surroundings.
STANDS_APART = 2.4
SPARSE = 1.5
# Nor is a surface that company is compared with sparser than so many times those: a group of
# outliers in mid-air that was retained would else excuse the others around it.
SPARSEST = 3.0
# Flat for its size is a plane that is so many times flatter than the radius, or than is usual.
FLATNESS = 0.1
FLATNESS_FACTOR = 3.0
# With one noise for all, a plane with so many times more is no plane of a surface.
NOISY_PLANE = 2.0
# Rounding of a distance must not hide a point that has joined a neighborhood.
NEXT = 1 + 1e-9
# Below this share of changed points the retained set is settled.
SETTLED = 1e-3
# Iterating must not eat the cloud.
LEAST_RETAINED, LEAST_GOING_ON = 0.5, 0.4
# For the display of progress: the time of a later pass, of that of the first; and the share of a
# pass that goes into planes.
LATER_PASS, REFITTING = 0.4, 0.8
# Groups below this many neighborhoods or share of the cloud are outliers unless quite flat.
SMALL_GROUP, SMALL_SHARE = 2, 1 / 20
QUITE_FLAT = 0.05


class IteratedPlanes:
    """A fitted cloud that judges points by the planes of its retained points.

    Parameters
    ----------
    model : LocalPlaneModel
        Of the whole cloud; then, once fitted, of the retained points.
    noise_scale : {"own", "local", "pooled"} or float
    borrow : bool
    keep_groups : bool
    cutoff : float
        Up to which points are retained for the next pass.
    max_iter : int
    n_jobs : int or None
    verdict : float, default=None
        Beyond which points are outliers at last; None is `cutoff`. So planes and passes do not
        depend on how many points the user wants to be flagged.

    Attributes
    ----------
    n_iter, noise_scale_found : as ``n_iter_`` and ``noise_scale_`` of the detector
    plane_index : ndarray of int of shape (n,)
    scores : ndarray of shape (n,)
        Of the fitted cloud.
    """

    def __init__(
        self, model, *, noise_scale, borrow, keep_groups, cutoff, max_iter, n_jobs, verdict=None
    ):
        self.model = model
        self.verdict = cutoff if verdict is None else verdict
        self.borrow = borrow
        self.keep_groups = keep_groups
        self.cutoff = cutoff
        self.max_iter = max_iter
        self.ruler = {"own": OWN, "local": LOCAL}.get(noise_scale, COMMON)
        self.pooled = noise_scale == "pooled"
        self.noise_scale_found = None if isinstance(noise_scale, str) else float(noise_scale)
        # The paper; and one plane for all has no cloud to iterate over.
        self.own_planes_only = model.index.n_neighbors is None or (
            self.ruler == OWN and max_iter == 1 and not borrow
        )
        self.n_jobs = n_jobs

    def fit(self, X):
        """Iterate until the retained set settles."""
        self.n_iter = 1
        if self.own_planes_only:
            self.plane_index, self.scores = np.arange(len(X)), self.score(X)
            return self
        n = len(X)
        order = spatial_order(X) if n >= ORDER_FROM else np.arange(n)
        X = X[order]
        retained = np.ones(n, dtype=bool)
        n_removals = np.zeros(n, dtype=np.int8)
        self._start(X)
        self.alone = np.zeros(n, dtype=bool)  # in a small group, once
        self.left, self.joined = None, None  # rows and locations, in the last pass
        self.tied = np.zeros(n, dtype=bool)  # whose neighbors another tree may order otherwise
        self.member_rows = np.argsort(order).astype(np.int32)[self.model.index.rows]
        self.distinct = np.sort(self.member_rows)  # copies of a point count once
        k = self.neighbors.shape[1]
        self.small_group = min(SMALL_GROUP * k, SMALL_SHARE * len(self.distinct))
        while True:
            begin, end, stage = self._part_of_pass()
            middle = begin + REFITTING * (end - begin)
            with progress_part(begin, middle, stage):
                self._refit(X)
            if self.n_iter == 1:
                self.copied = self.neighbors[:, 0].copy()  # the row that stands for its copies
            last = self.n_iter == self.max_iter
            # With one noise for all, borrowed planes would let outliers creep back in.
            borrow = self.borrow and (last or self.ruler != COMMON)
            with progress_part(middle, end, stage):
                scores, owners, usual = self._judge_all(X, borrow)
            if last:
                break
            passed = self._passed(X, scores)
            # A point that was let in again and failed again stays out: no oscillation.
            n_removals += retained & ~passed
            passed &= n_removals < 2
            differs = passed != retained
            changed = np.count_nonzero(differs[self.distinct])
            few = passed[self.distinct].sum() < self._least()
            if changed <= SETTLED * len(self.distinct) or few:
                break
            self.left, self.joined = differs & retained, X[differs & passed]
            retained = passed
            self.model = self.model.over(X[retained])
            rows = np.flatnonzero(retained).astype(np.int32)
            self.member_rows = self.copied[rows[self.model.index.rows]]
            self.n_iter += 1
        if borrow != self.borrow or self.cutoff != self.verdict:
            self.cutoff = self.verdict
            scores, owners, usual = self._judge_all(X, self.borrow)
        gaps = np.linalg.norm(X - X[self.neighbors[:, 0]], axis=1)
        self._settle(X, order, scores, owners, usual, gaps)
        # What new points are judged by stays; these take as much memory.
        del self.neighbors, self.distinct, self.copied, self.left, self.joined, self.tied
        return self

    @property
    def compiled(self):
        """Whether compiled code does the work, here and now: a pickle may come elsewhere."""
        return self.model.ready()

    def score(self, queries):
        """Robust distances of queries (m, d), those that stand apart raised accordingly."""
        if self.own_planes_only:
            planes, distance = self.model.evaluate(queries, n_jobs=self.n_jobs)
            # Of one plane for all the noise may still be known.
            if self.ruler == COMMON and not self.pooled:
                return ratio(distance * planes.scale, self.noise_scale_found)
            return distance
        scores, precision = np.empty(len(queries)), np.finfo(queries.dtype).eps
        queries = np.ascontiguousarray(queries, dtype=np.float64)

        def task(part):
            points = queries[part]
            around = self.model.index.query(points)
            planes, distance = self.model.evaluate_neighborhoods(points, around, precision)
            rows = around._replace(indices=self.member_rows[around.indices])
            judged = self._judge(points, planes, distance, rows, self.borrow, precision)
            first = around.indices[:, 0]
            gaps = np.linalg.norm(points - self.model.index.points[first], axis=1)
            scores[part] = self._spare_company(points, *judged[::2], gaps)

        each_chunk(queries, CHUNK[self.compiled], task, self.n_jobs)
        return scores

    def _start(self, X):
        """Arrays of the fitted points; rows are those of the sorted cloud."""
        n, d = X.shape
        k = self.model.index.n_neighbors
        self.neighbors = np.full((n, k), -1, dtype=np.int32)
        self.fitted, self.distance = Planes.empty(n, d), np.empty(n)
        self.credible = np.zeros(n, dtype=bool)

    def _refit(self, X):
        """Planes of the neighborhoods among the retained points, where these have changed."""
        index, fitted = self.model.index, self.fitted

        # Only next to points that left or joined is searched again, and where distances tie: a
        # search costs nearly as much as a plane.
        tree = cKDTree(self.joined) if self.n_iter > 1 and len(self.joined) else None

        def task(part):
            part = np.arange(part.start, part.stop)
            if self.n_iter > 1:
                changed = self.tied[part] | self.left[self.neighbors[part]].any(axis=1)
                if tree is not None:
                    changed |= tree.query(X[part])[0] <= fitted.radius[part] * NEXT
                part = part[changed]
                if len(part) == 0:
                    return
            around, self.tied[part] = index.query_ties(X[part])
            rows = self.member_rows[around.indices]
            stale = (rows != self.neighbors[part]).any(axis=1)
            self.neighbors[part] = rows
            part, around = part[stale], around.take(stale)
            if len(part):
                planes, distance = self.model.evaluate_neighborhoods(X[part], around)
                fitted.put(part, planes)
                self.distance[part] = distance

        each_slice(len(X), CHUNK[self.compiled], task, self.n_jobs)
        rows = self.member_rows
        scale, radius = fitted.scale[rows], fitted.radius[rows]
        if self.pooled:
            self.noise_scale_found = float(np.median(scale))
        usual = float(np.median(np.where(radius > 0, ratio(scale, radius), 0.0)))
        # A cloud whose noise is as large as its neighborhoods has no flatter planes than that.
        self.limits = Credibility(max(FLATNESS, FLATNESS_FACTOR * usual))
        self._find_credible()
        if self.n_iter == 1 and self.ruler != OWN:
            self.dense = DenseSpacing(index.points, fitted.spacing[rows])

    def _part_of_pass(self):
        """Begin and end of this pass, as shares of all that may be, and its name."""
        total = 1 + LATER_PASS * (self.max_iter - 1)
        end = 1 + LATER_PASS * (self.n_iter - 1)
        begin = end - LATER_PASS if self.n_iter > 1 else 0.0
        stage = f"outliers, pass {self.n_iter} of at most {self.max_iter}"
        return begin / total, end / total, stage

    def _find_credible(self):
        fitted, chunk = self.fitted, CHUNK[self.compiled]
        self.credible[:] = False

        def task(rows):
            around = self._around(self.neighbors[rows])
            usual = quantile_around(fitted.radius, around, HALF, self.compiled)
            credible = credible_planes(fitted.take(rows), usual, self.limits)
            if self.ruler == COMMON:
                credible &= fitted.scale[rows] <= NOISY_PLANE * self.noise_scale_found
            self.credible[rows] = credible

        rows = self.member_rows
        run([(rows[i : i + chunk],) for i in range(0, len(rows), chunk)], task, self.n_jobs)

    @staticmethod
    def _around(neighbors):
        return Neighborhoods(neighbors, np.full(len(neighbors), neighbors.shape[1]))

    def _judge_all(self, X, borrow):
        n = len(X)
        scores, owners, usual = np.empty(n), np.empty(n, dtype=np.int64), np.empty(n)
        fitted, chunk = self.fitted, CHUNK[self.compiled]

        def task(part):
            around = self._around(self.neighbors[part])
            judged = self._judge(X[part], fitted.take(part), self.distance[part], around, borrow)
            scores[part], owners[part], usual[part] = judged

        parts = [(np.arange(i, min(i + chunk, n)),) for i in range(0, n, chunk)]
        run(parts, task, self.n_jobs, told=True)
        return scores, owners, usual

    def _judge(self, queries, planes, distance, around, borrow, precision=0.0):
        """Scores, owners (rows of the sorted cloud, -1 the own) and the usual spacing."""
        least = max(self.model.rounding, 8 * precision) * np.abs(queries).max(axis=1)
        noise = self.noise_scale_found if self.ruler == COMMON else np.nan
        options = Judge(self.ruler, noise, self.cutoff, borrow, self.limits)
        scores, owners, usual = judge(
            options, queries, planes, distance, least, around, self.fitted, self.credible,
            self.compiled,
        )  # fmt: skip
        if self.ruler != OWN:
            scores = np.maximum(scores, self.cutoff * self._apart(queries, planes.spacing, usual))
        return scores, owners, usual

    def _apart(self, queries, spacing, usual):
        """How far queries stand apart, beyond 1 too far."""
        # Among copies of one point there is no spacing to compare with.
        apart = ratio(spacing, STANDS_APART * np.where(usual > 0, usual, np.inf))
        # Only of the seeds: among those retained, what is sparse would be eaten pass by pass.
        if self.n_iter == 1 and self.max_iter > 1:
            dense = self.dense.around(queries)
            sparse = ratio(spacing, SPARSE * np.where(dense > 0, dense, np.inf))
            apart = np.maximum(apart, sparse)
        return apart

    def _passed(self, X, scores):
        """Who is retained for the next pass."""
        limit = self.cutoff
        if self.ruler != OWN and self.n_iter == 1:
            # Where density varies wildly there is no one dense surface to compare with.
            limit = max(limit, float(np.quantile(scores[self.distinct], LEAST_RETAINED)))
        passed = scores <= limit
        if self.ruler != OWN:
            members = self.member_rows
            sizes = group_sizes(X, members, self.neighbors, self.compiled)
            rough = self.fitted.scale[members] > QUITE_FLAT * self.fitted.radius[members]
            small = sizes < self.small_group
            found = members[small & (rough | ~passed[members])]
            self.alone[self.copied[found]] = True
            self.alone = self.alone[self.copied]
            passed &= ~self.alone
        return passed

    def _settle(self, X, order, scores, owners, usual, gaps):
        """What new points need, and results in the order of the rows of the fitted cloud."""
        n, k = len(X), self.model.index.n_neighbors
        self.company = None
        if self.keep_groups and self.ruler != OWN:
            rejected = np.flatnonzero(scores > self.cutoff)
            distinct = rejected[distinct_rows(X[rejected])] if len(rejected) else rejected
            n_group = int(np.ceil(self.small_group))
            self.company = Company(X[distinct], k, n_group, self.alone[distinct])
            chunk = CHUNK[self.compiled]

            def task(rows):
                scores[rows] = self._spare_company(X[rows], scores[rows], usual[rows], gaps[rows])

            parts = [(rejected[i : i + chunk],) for i in range(0, len(rejected), chunk)]
            run(parts, task, self.n_jobs)
        self.scores, self.plane_index = np.empty(n), np.empty(n, dtype=np.intp)
        self.scores[order] = scores
        self.plane_index[order] = order[np.where(owners < 0, np.arange(n), owners)]

    def _spare_company(self, queries, scores, usual, gaps):
        """Scores, lowered where a rejected point keeps company."""
        if self.company is None:
            return scores
        far = np.flatnonzero(scores > self.cutoff)
        usual = np.minimum(usual[far], SPARSEST * self.dense.around(queries[far]))
        isolation = self.company.isolation(queries[far], usual, gaps[far])
        scores[far] = np.minimum(scores[far], self.cutoff * isolation)
        return scores

    def _least(self):
        """Fewest points to go on with: some are left out of the half for being alone."""
        least = LEAST_GOING_ON * len(self.distinct)
        return max(self.model.index.points.shape[1] + 1, self.neighbors.shape[1], least)
