"""Normals and edges of clouds larger than memory."""

from functools import partial

import numpy as np
from sklearn.base import clone

from sklearn_mcmd.edges import SharpFeatureDetector
from sklearn_mcmd.edges._detector import crease_width, least_of_edge, steps_of
from sklearn_mcmd.io._point_cloud import with_results
from sklearn_mcmd.normals._adaptive_k import SizeLimits
from sklearn_mcmd.normals._features import check_features, flip_columns, with_flipped
from sklearn_mcmd.normals._sides import Sides
from sklearn_mcmd.outliers import MCMDOutlierDetector
from sklearn_mcmd.outliers._detector import share_to_flag
from sklearn_mcmd.planes._base import BaseLocalPlanes
from sklearn_mcmd.planes._orientation import count_upright
from sklearn_mcmd.runtime._progress import progress_part
from sklearn_mcmd.tiling._borders import sides_in_overlap, sides_of_cells
from sklearn_mcmd.tiling._halo import HOPS, HOPS_MORE, HOPS_OF_SIZES
from sklearn_mcmd.tiling._outliers import TiledOutliers
from sklearn_mcmd.tiling._outputs import Results
from sklearn_mcmd.tiling._run import TiledVerb, check_estimator, most_neighbors, warm_up
from sklearn_mcmd.tiling._sensor_origins import recognized, sensor_path, stored_origins

NORMAL_COLUMNS = (
    *("normal_x", "normal_y", "normal_z", "surface_variation"),
    *("eigenvalue_0", "eigenvalue_1", "eigenvalue_2", "removed_fraction"),
)
NO_HEIGHTS = {"above": None, "below": None, "low_groups": False}  # of a detector that cleans


class TiledNormals(TiledVerb):
    """Normals; their sides may agree along a tree through all cells."""

    options = ("sensor_origin",)

    def __init__(self, estimator, sensor_origin):
        check_estimator(estimator, BaseLocalPlanes)
        super().__init__(estimator)
        self.sensor = sensor_path(estimator, sensor_origin)
        if self.sensor is not None and getattr(estimator, "orientation", None) != "sensor":
            raise ValueError('sensor_origin is given but orientation is not "sensor".')
        if has_tree(estimator):  # which may turn the sides of a cell
            features = with_flipped(check_features(estimator.features))
            self.fitted = clone(estimator).set_params(features=features)
        else:
            self.fitted = estimator

    @property
    def n_neighbors(self):
        return neighbors_of(self.estimator)

    def prepare(self, catalog):
        most_neighbors(catalog.n_points, self.estimator)
        estimator = self.estimator
        if self.sensor is not None:  # any position will do
            estimator = clone(estimator).set_params(sensor_origin="origin")
        self.names, _ = normal_columns(warm_up(estimator, 1_500))
        self.all_names = self.names
        if has_tree(estimator):
            self.all_names, _ = normal_columns(warm_up(self.fitted, 1_500))

    def beside(self, folder, catalog):
        return [] if self.sensor is None else [self.sensor.beside(folder.cells)]

    def measure_fit(self, xyz):
        given = {} if self.sensor is None else {"sensor_origin": xyz.max(axis=0) + 1.0}
        clone(self.fitted).fit(xyz, **given)

    def find(self, run):
        given = None if self.sensor is None else partial(with_origins, run.folder.cells)
        run.fit(self.task, run.job(self.fitted, keep_normals, hops_of(self.estimator), given=given))
        if has_tree(self.estimator):
            run.results.once("sides", partial(sides_of_cells, run, self.all_names))

    def results(self, run):
        name = "final" if has_tree(self.estimator) else "results"
        return Results(run.results, run.cells, name)

    def make(self, cloud, values, xyz):
        columns = dict(zip(self.all_names, values.T.copy(), strict=True))
        return with_results(cloud, {name: columns[name] for name in self.names}), None

    def measure(self, values):
        removed = values[:, self.all_names.index("removed_fraction")].sum(dtype=np.float64)
        return np.array([removed, count_upright(values)])

    def report(self, run, total):
        removed, n_upright = total
        return {"removed_fraction": removed / run.catalog.n_points, "n_upright": int(n_upright)}


def neighbors_of(estimator):
    """The neighbors that an estimator of normals asks for; of its own number, most."""
    return SizeLimits().around if estimator.n_neighbors == "auto" else int(estimator.n_neighbors)


def hops_of(estimator):
    """The hops of neighbors on which normals depend."""
    return HOPS_OF_SIZES if estimator.n_neighbors == "auto" else HOPS


def has_tree(estimator):
    """Whether a tree of all points decides the sides of normals."""
    return str(getattr(estimator, "orientation", None)) == "mst"  # a direction is an array


def with_origins(folder, job, cell, part):
    """As `Job.given`: where the sensor was for the points of a part."""
    return part, {"sensor_origin": stored_origins(folder)[part.rows]}


def keep_normals(job, cell, part, fitted, cloud):
    """As `Job.keep`."""
    names, columns = normal_columns(fitted)
    columns = columns[part.own]
    if not has_tree(fitted):
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


def without_sides(estimator):
    """The estimator of who asks for no sides; raises for what tiles cannot do."""
    check_estimator(estimator, BaseLocalPlanes)
    Sides(estimator.orientation, estimator.sensor_origin, np.zeros((1, 3)))
    return estimator


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

    @property
    def n_neighbors(self):
        sizes = [self.estimator.n_neighbors, neighbors_of(self.normals)]
        return max([*sizes, *([] if self.detector is None else [self.detector.n_neighbors])])

    def prepare(self, catalog):
        most_neighbors(catalog.n_points, self.estimator, self.detector, self.normals)
        warm_up(self.estimator)
        self.seen, self.cleaning = False, None
        if self.detector is not None:
            _, words = recognized(self.detector, catalog)
            self.seen = bool(words)
            if share_to_flag(self.detector) or self.detector.false_positive_rate:
                # The cutoff is that of all cells.
                self.cleaning = TiledOutliers(
                    self.detector, "mark", (), (), None, False, **NO_HEIGHTS
                )
                self.cleaning.task = "clean"
                self.cleaning.prepare(catalog)

    def find(self, run):
        hops, estimator = hops_of(self.normals) + HOPS_MORE, self.estimator
        if self.cleaning is not None:
            with progress_part(0.0, 0.5):
                self.cleaning.find(run)
            known = {"contamination": None, "false_positive_rate": None}
            detector = clone(self.detector).set_params(cutoff=self.cleaning.cutoff, **known)
            estimator = clone(estimator).set_params(outlier_detector=detector)
        with progress_part(0.0 if self.cleaning is None else 0.5, 1.0):
            run.fit(self.task, run.job(estimator, keep_edges, hops, seen=self.seen))
        reports = [run.results.report(cell, self.task) for cell in range(len(run.cells))]
        self.n_kept = sum(report["n_kept"] for report in reports)
        if self.by_distance:
            self.limit = crease_width(self.estimator)
        else:
            parts = partial(_kept_values, run.results, len(run.cells))
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


def keep_edges(job, cell, part, fitted, cloud):
    """As `Job.keep`: scores, and the values of the criterion at the points that were kept."""
    scores, kept = fitted.scores_[part.own], fitted.inlier_mask_[part.own]
    found = {"results": scores[:, None], "n_kept": int(np.count_nonzero(kept))}
    if fitted.criterion != "crease":
        found["kept"] = kept
    return found


def _kept_values(results, n_cells):
    """The values of the criterion at all kept points, cell by cell."""
    for cell in range(n_cells):
        yield -results.read(cell, "results")[results.read(cell, "kept"), 0]
