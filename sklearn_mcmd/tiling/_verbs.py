"""Normals and edges of clouds larger than memory."""

from functools import partial

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components, minimum_spanning_tree
from sklearn.base import clone

from sklearn_mcmd.edges import SharpFeatureDetector
from sklearn_mcmd.edges._detector import crease_width, least_of_edge, steps_of
from sklearn_mcmd.io._point_cloud import with_results
from sklearn_mcmd.normals import RobustNormalEstimator
from sklearn_mcmd.normals._features import (
    check_features,
    flip_columns,
    needs_curvatures,
    with_flipped,
)
from sklearn_mcmd.normals._rows import may_be_rows, warn_of_rows
from sklearn_mcmd.normals._sides import TreeLimits
from sklearn_mcmd.outliers import MCMDOutlierDetector
from sklearn_mcmd.outliers._detector import share_to_flag
from sklearn_mcmd.planes._base import BaseLocalPlanes
from sklearn_mcmd.planes._indexed_cloud import distinct_numbers
from sklearn_mcmd.planes._orientation import count_upright, signs_along, spanning_forest
from sklearn_mcmd.runtime._chunks import slices
from sklearn_mcmd.runtime._progress import progress_part
from sklearn_mcmd.tiling._base import (
    AT_ONCE,
    TiledVerb,
    check_estimator,
    hops_of,
    in_halo,
    overlaps,
    warm_up,
    without_sides,
)
from sklearn_mcmd.tiling._beside import recognized, sensor_path
from sklearn_mcmd.tiling._halo import HOPS_MORE
from sklearn_mcmd.tiling._outliers import TiledOutliers

# Cosine between normals of neighbors that are of one smooth part, at least.
SMOOTH = 0.9
NORMAL_COLUMNS = (
    *("normal_x", "normal_y", "normal_z", "surface_variation"),
    *("eigenvalue_0", "eigenvalue_1", "eigenvalue_2", "removed_fraction"),
)


class TiledNormals(TiledVerb):
    """Normals; their sides may agree along a tree through all cells."""

    def __init__(self, estimator, sensor_origin):
        check_estimator(estimator, BaseLocalPlanes)
        super().__init__(estimator)
        if isinstance(estimator, RobustNormalEstimator) and may_be_rows(estimator):
            self.warnings = [warn_of_rows]
        self.sensor = sensor_path(estimator, sensor_origin)
        if self.sensor.moves and not has_orientation(estimator, "sensor"):
            raise ValueError('sensor_origin is given but orientation is not "sensor".')
        if has_orientation(estimator, "mst"):  # which may turn the sides of a cell
            features = with_flipped(check_features(estimator.features))
            self.fitted = clone(estimator).set_params(features=features)
            self.names = ("final",)
        else:
            self.fitted = estimator

    def prepare(self, catalog):
        known = {"sensor_origin": "origin"} if self.sensor.moves else {}  # any position will do
        fits = dict.fromkeys((self.estimator, self.fitted))  # they may be one
        names = [normal_columns(warm_up(clone(one).set_params(**known)))[0] for one in fits]
        self.names_written, self.names_found = names[0], names[-1]

    def measure_fit(self, xyz):
        given = {"sensor_origin": xyz.max(axis=0) + 1.0} if self.sensor.moves else {}
        clone(self.fitted).fit(xyz, **given)

    def find(self, run):
        asked = {"keep": keep_normals, "hops": hops_of(self.estimator)}
        asked["moves"] = self.sensor.moves
        # A tree of sides and the change of normals ask those of the halo, and "auto" sees more.
        features = check_features(getattr(self.fitted, "features", None))
        asks_others = has_orientation(self.fitted, "mst") or needs_curvatures(features)
        asked["asks_own"] = not asks_others and self.fitted.n_neighbors != "auto"
        run.do(self.task, estimator=self.fitted, **asked)
        if has_orientation(self.estimator, "mst"):
            sides_of_cells(run, self.names_found)

    def make(self, cloud, values, xyz):
        columns = dict(zip(self.names_found, values.T.copy(), strict=True))
        return with_results(cloud, {name: columns[name] for name in self.names_written}), None

    def measure(self, values):
        removed = values[:, self.names_found.index("removed_fraction")].sum(dtype=np.float64)
        return np.array([removed, count_upright(values)])

    def report(self, run, total):
        removed, n_upright = total
        return {"removed_fraction": removed / run.catalog.n_points, "n_upright": int(n_upright)}


def has_orientation(estimator, word):
    """Whether a word says how the sides of normals are decided."""
    return str(getattr(estimator, "orientation", None)) == word  # a direction is an array


def keep_normals(job, cell, part, fitted, cloud):
    """As `Job.keep`."""
    names, columns = normal_columns(fitted)
    columns = columns[part.own]
    if not has_orientation(fitted, "mst"):
        return {"results": columns}
    signs, sides = sides_in_overlap(part, fitted, cloud)
    columns[signs < 0] = flip_columns(columns[signs < 0], names)
    return {"results": columns, **sides}


def normal_columns(fitted):
    """Names of the results of a fitted estimator, and their values: float32 (n, n_columns)."""
    names, n_features = fitted.get_feature_names_out(["x", "y", "z"]), fitted.features_.shape[1]
    names = [*NORMAL_COLUMNS, *names[len(names) - n_features :]]
    columns = np.empty((len(fitted.normals_), len(names)), np.float32)
    columns[:, :3], columns[:, 3] = fitted.normals_, fitted.surface_variation_
    columns[:, 4:7], columns[:, 7] = fitted.eigenvalues_, fitted.removed_fraction_
    columns[:, 8:] = fitted.features_
    if fitted.n_neighbors == "auto":
        names, sizes = [*names, "n_neighbors"], fitted.n_neighbors_.astype(np.float32)
        columns = np.column_stack([columns, sizes])
    return names, columns


def sides_in_overlap(part, fitted, cloud):
    """What `sides_of_cells` asks of a cell whose normals agree along a tree of all points: the
    smooth parts of the tree of own points and their neighbors, and where these are joined.

    Signs of the own points, by which normals agree in each part, and arrays: the parts of own
    points and of those of others, heights of parts, and pairs of them with a cosine of normals.
    """
    n, k = len(cloud.points), min(TreeLimits().n_neighbors, len(cloud.points))
    own, normals = distinct_numbers(cloud.places[part.own]), fitted.normals_[cloud.rows]
    near = np.concatenate([cloud.neighbors(rows, k, 0) for rows in slices(n, AT_ONCE)])[own]
    ends = spanning_forest(normals, cloud.points, np.repeat(own, k), near.ravel())
    bent = np.abs(np.einsum("ij,ij->i", *(normals[end] for end in ends))) < SMOOTH
    first, second = (end[~bent] for end in ends)
    signs = signs_along(normals, cloud.points, first, second)
    smooth = coo_array((np.ones(len(first)), (first, second)), shape=(n, n))
    n_parts, tree = connected_components(smooth, directed=False)
    normals = normals * signs[:, None]
    first, second = (end[bent] for end in ends)
    cosine = np.einsum("ij,ij->i", normals[first], normals[second])
    joints = np.column_stack([tree[first], tree[second], cosine])
    near = np.isin(np.arange(n), near)[cloud.places]
    tree, signs = tree[cloud.places], signs[cloud.places]
    top = np.full(n_parts, -np.inf)
    np.maximum.at(top, tree[part.own], part.xyz[part.own, 2])
    return signs[part.own], {
        "trees": tree[part.own],
        "tops": top,
        "joints": joints,
        "halo": in_halo(part, tree, near),
        "halo_normals": (fitted.normals_ * signs[:, None])[near & ~part.own],
    }


def sides_of_cells(run, names):
    """Flip the normals of cells so that they agree with those of others, as final results."""
    results, tops = run.results, list(run.found("tops"))
    starts = np.cumsum([0, *map(len, tops)])
    pairs, votes = [np.empty((2, 0), np.int64)], [np.empty(0)]
    for cell, home, rows, at, tree in overlaps(run):
        theirs = starts[home] + results.mapped(home, "trees")[at].astype(np.int64)
        both = results.mapped(cell, "halo_normals")[rows], results.mapped(home, "results")[at, :3]
        pairs.append(np.stack([starts[cell] + tree, theirs]))
        votes.append(np.sign(np.einsum("ij,ij->i", *both)))
    # They count less than any vote: a tree of the whole has them last, too.
    for start, joints in zip(starts, run.found("joints"), strict=False):
        pairs.append(start + joints[:, :2].astype(np.int64).T)
        agree = np.clip(np.abs(joints[:, 2]), 1e-9, SMOOTH)
        votes.append(np.where(joints[:, 2] < 0, -agree, agree))
    signs = _signs(np.concatenate(pairs, axis=1), np.concatenate(votes), np.concatenate(tops))
    for cell in range(len(run.cells)):
        columns, trees = results.read(cell, "results"), results.read(cell, "trees")
        down = signs[starts[cell] + trees] < 0
        columns[down] = flip_columns(columns[down], names)
        results.keep(cell, "final", {"final": columns})


def _signs(pairs, votes, tops):
    """The signs by which parts agree along the tree of the most votes; that of the highest is 1."""
    n = len(tops)
    sums = coo_array((votes, np.sort(pairs, axis=0)), shape=(n, n)).tocsr()
    sums.eliminate_zeros()
    # The most votes first: SciPy's tree takes the least costs, which tell of which sums they are.
    order = np.argsort(-np.abs(sums.data), kind="stable")
    costs = sums.copy()
    costs.data[order] = np.arange(1.0, len(order) + 1)
    tree = minimum_spanning_tree(costs).tocoo()
    turned = sums.data[order[tree.data.astype(int) - 1]] < 0
    _, part = connected_components(tree, directed=False)
    by_height = np.lexsort((tops, part))
    highest = by_height[np.flatnonzero(np.diff(part[by_height], append=n))]
    # Each part is two nodes, one of each sign, that are apart: one hangs together with the highest.
    rows, columns = np.r_[tree.row, tree.row + n], np.r_[tree.col, tree.col]
    columns = columns + n * np.r_[turned, ~turned]
    both = coo_array((np.ones(len(rows)), (rows, columns)), shape=(2 * n, 2 * n))
    _, side = connected_components(both, directed=False)
    return np.where(side[:n] == side[highest[part]], 1.0, -1.0)


class TiledEdges(TiledVerb):
    """Edges of what a detector leaves."""

    def __init__(self, estimator, colors):
        check_estimator(estimator, SharpFeatureDetector)
        self.detector, normals = steps_of(estimator)  # no detector if nothing is removed
        removing = [] if self.detector is None else [self.detector]
        for detector in removing:
            check_estimator(detector, MCMDOutlierDetector)
        self.normals, self.colors = without_sides(normals), colors
        super().__init__(estimator, normals, *removing)
        self.by_distance = estimator.criterion == "crease"

    def prepare(self, catalog):
        warm_up(self.estimator)
        self.seen, self.cleaning = False, None
        if self.detector is not None:
            self.seen = bool(recognized(self.detector, catalog)[1])
            if share_to_flag(self.detector) or self.detector.false_positive_rate:
                # The cutoff is that of all cells.
                self.cleaning = TiledOutliers(self.detector)
                self.cleaning.task = "clean"
                self.cleaning.prepare(catalog)

    def find(self, run):
        hops, estimator, begin = HOPS_MORE + hops_of(self.normals), self.estimator, 0.0
        if self.cleaning is not None:
            begin = 0.5
            with progress_part(0.0, begin):
                self.cleaning.find(run)
            known = {"contamination": None, "false_positive_rate": None}
            detector = clone(self.detector).set_params(cutoff=self.cleaning.cutoff, **known)
            estimator = clone(estimator).set_params(outlier_detector=detector)
        with progress_part(begin, 1.0):
            asked = {"estimator": estimator, "keep": keep_edges, "hops": hops}
            run.do(self.task, told={"seen": self.seen}, **asked)
        self.n_kept = sum(report["n_kept"] for report in run.reports(self.task))
        if self.by_distance:
            self.limit = crease_width(self.estimator)
        else:
            values = partial(run.found, "values")
            self.limit = -least_of_edge(values, self.estimator.threshold, self.estimator.n_std)

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


def keep_edges(job, cell, part, fitted, cloud):
    """As `Job.keep`: scores, and the values of another criterion at the points that were kept."""
    scores, kept = fitted.scores_[part.own], fitted.inlier_mask_[part.own]
    found = {"results": scores[:, None], "n_kept": int(np.count_nonzero(kept))}
    return found if fitted.criterion == "crease" else found | {"values": -scores[kept]}
