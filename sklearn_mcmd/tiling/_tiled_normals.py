"""Normals of clouds larger than memory, and the planes of all places on which other verbs stand.

The stages of `RobustNormalEstimator` ask only for neighbors, and for what the stage before has
found of these. So each stage is one sweep over the cells, whose results lie on disk.
"""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from sklearn.base import clone

from sklearn_mcmd.io._point_cloud import with_results
from sklearn_mcmd.normals._adaptive_k import SizeLimits
from sklearn_mcmd.normals._curvature import Curvatures, curvatures_of_each, curvatures_of_new
from sklearn_mcmd.normals._estimator import fitted_of
from sklearn_mcmd.normals._sides import Sides, TreeLimits
from sklearn_mcmd.normals._surface_planes import SurfacePlanes, Surfaces
from sklearn_mcmd.planes._base import BaseLocalPlanes, mends_planes
from sklearn_mcmd.planes._columns import Columns, points_off
from sklearn_mcmd.planes._nearest import COMPILE_FROM
from sklearn_mcmd.planes._orientation import (
    count_upright,
    orient_toward,
    signs_along,
    spanning_forest,
)
from sklearn_mcmd.planes._record import Planes
from sklearn_mcmd.runtime._chunks import each_part, each_slice
from sklearn_mcmd.tiling._memory import most_neighbors, work_of
from sklearn_mcmd.tiling._result_files import NORMAL_COLUMNS, fit_together, normal_columns
from sklearn_mcmd.tiling._run import TiledVerb, check_estimator, warm_up
from sklearn_mcmd.tiling._sensor_origins import sensor_path, stored_origins
from sklearn_mcmd.tiling._stored_columns import ALL
from sklearn_mcmd.tiling._stored_index import StoredIndex, find_index, find_larger
from sklearn_mcmd.tiling._stored_neighbors import StoredNeighbors
from sklearn_mcmd.tiling._stored_offers import (
    FACES,
    OLD,
    VECTOR,
    find_offers,
    offer_steps,
    settle,
)
from sklearn_mcmd.tiling._sweeps import Job, warn_if_coarse
from sklearn_mcmd.tiling._tiled_sizes import find_sizes, size_steps

# Fields of `Planes`, and of `Surfaces`, that are stored between the sweeps besides `FACES`.
FIELDS = {"eigenvalues": VECTOR, **dict.fromkeys(("kept", "radius", "normal_error"), float)}
OTHERS = {"forms": np.int8, "noise": float, "left": float}


class TiledNormals(TiledVerb):
    """Normals, in sweeps; a tree of all places may decide their sides."""

    options = ("sensor_origin",)

    def __init__(self, estimator, sensor_origin):
        check_estimator(estimator, BaseLocalPlanes)
        super().__init__(estimator)
        self.sensor = sensor_path(estimator, sensor_origin)
        if self.sensor is not None and getattr(estimator, "orientation", None) != "sensor":
            raise ValueError('sensor_origin is given but orientation is not "sensor".')
        self.last_sweep = "planes" if mends_planes(self.estimator) else "normals"

    def prepare(self, catalog):
        estimator = self.estimator
        if self.sensor is not None:  # any position will do
            estimator = clone(estimator).set_params(sensor_origin="origin")
        self.names, _ = normal_columns(warm_up(estimator, 1_500))
        base = "tree" if has_tree(estimator) else "normals"
        work = work_of(base, estimator, sensor=self.sensor)
        n_features = len(self.names) - len(NORMAL_COLUMNS)
        return work, n_features, most_neighbors(catalog.n_points, estimator)

    def find(self, run):
        if run.folder.columns.all_have(len(run.cells), "results"):
            return
        job = PlaneJob.of(run, self.estimator, keep=_write)
        whole = find_planes(run.sweeps(plane_steps(self.estimator)), job)
        if whole is None:
            fit_together(job, self.estimator, run.cells, lambda fitted: normal_columns(fitted)[1])

    def make(self, cloud, values, xyz):
        columns = dict(zip(self.names, values.T.copy(), strict=True))
        return with_results(cloud, columns), None

    def measure(self, values):
        removed = values[:, self.names.index("removed_fraction")].sum(dtype=np.float64)
        return np.array([removed, count_upright(values)])

    def report(self, run, total):
        removed, n_upright = total
        return {"removed_fraction": removed / run.catalog.n_points, "n_upright": int(n_upright)}


def without_sides(estimator):
    """The estimator, changed, of who asks for no sides; raises for what tiles cannot do."""
    check_estimator(estimator, BaseLocalPlanes)
    Sides(estimator.orientation, estimator.sensor_origin, np.zeros((1, 3)))
    return estimator.set_params(orientation=None, sensor_origin=None)


def _write(cell, job, fitted):
    """Write the results of the points of a cell, from those of its places."""
    _, values = normal_columns(fitted)
    if job.origins() is None:  # else they are of points, not of places
        values = values[job.columns.read(cell, "place_of")]
    return {"results": values}


@dataclass(frozen=True)
class PlaneJob(Job):
    """A job whose estimator is a `RobustNormalEstimator`.

    ``keep(cell, job, fitted)`` returns what is kept of an estimator that has what is public of
    the places of a cell. `later` is how many neighbors are asked for later; None if new points are,
    whose planes need all that was found.
    """

    keep: object = None
    later: int | None = 0

    @property
    def is_sized(self):
        """Whether each place has its own number of neighbors."""
        return self.estimator.n_neighbors == "auto"

    def origins(self):
        """Where the sensor was for each point of the inputs, if it matters; else None."""
        by_sensor = str(self.estimator.orientation) == "sensor"
        return stored_origins(self.points) if by_sensor else None

    def index(self):
        """The `StoredIndex` of the estimator's neighborhoods."""
        whole, k = self.whole(), self.estimator.n_neighbors
        if self.is_sized:
            k = whole.columns.report(ALL, "numbers")["largest"]
        return StoredIndex(whole, self.cells, k, self.estimator.radius, self.is_sized)

    def model(self):
        """The `LocalPlaneModel` of all places."""
        return self.model_on(self.index(), self.estimator.cutoff)

    def surfaces(self, model):
        """The `SurfacePlanes` of a model; None where the estimator corrects no planes."""
        if not mends_planes(self.estimator):
            return None
        whole = self.whole()
        others = [whole.open(n, private=True) if whole.has(n) else np.empty(0) for n in OTHERS]
        members = Surfaces(whole.planes(private=True), *others)
        return SurfacePlanes(self.estimator, model, members)


def plane_steps(estimator):
    """The steps of `find_planes` in their order, as of `Sweeps`."""
    sizes = (*size_steps(), "larger") if estimator.n_neighbors == "auto" else ()
    bends = ("planes", "bends") if mends_planes(estimator) else ()
    tree = ("forest", "sides") if has_tree(estimator) else ()
    return "places", "neighbors", *sizes, *offer_steps(estimator), *bends, "normals", *tree


def has_tree(estimator):
    """Whether a tree of all places decides the sides of normals."""
    return str(estimator.orientation) == "mst"  # a direction is an array


def find_planes(sweeps, job, least=0, **stored):
    """Find the planes of all places, and call ``job.keep`` for each cell with points.

    Returns the `StoredColumns`; None, and nothing is found, if there are so few places that other
    code works on them than on tiles.

    Later steps need the `least` places. ``job.keep`` fills the columns `stored`, as of
    `StoredColumns.make`.
    """
    cells = job.cells
    sweep = partial(sweeps, cells=cells, job=job)
    asked = SizeLimits().around if job.is_sized else job.estimator.n_neighbors
    along = TreeLimits().n_neighbors if has_tree(job.estimator) else 0
    least = max(COMPILE_FROM, 0 if job.is_sized else asked + 1, least)
    whole = find_index(sweep, job, max(asked, along, job.later or 0), least, job.later)
    if whole is None:
        return None
    if job.is_sized:
        find_sizes(sweep, job)
        sweep("larger", find_larger)
    whole.columns.once("neighbors", lambda: warn_if_coarse(job.constants, job.index()))
    if mends_planes(job.estimator):
        find_offers(sweep, job)
        whole.make(**FIELDS, **OTHERS)
        sweep("planes", _fit_own)
        sweep("bends", _bend)
        if job.later is None:
            whole.copy(asks=f"{OLD}asks", **{name: f"{OLD}{name}" for name in FACES})
        sweep("bends-settled", settle)
        if job.later is not None:
            whole.remove("asks", "noise")
    whole.make(**stored)
    if not has_tree(job.estimator):
        sweep("normals", _keep_fitted, then=_narrow)
    else:
        whole.make(sides=(job.constants.dtype, 3))
        sweep("normals", _keep_fitted, job=replace(job, keep=_keep_normals))
        sweep("forest", _find_forest)
        whole.columns.once("tree", partial(_join_forests, whole, np.flatnonzero(cells.counts)))
        sweep("sides", _keep_fitted, then=_narrow)
    if job.later is not None:
        whole.remove("larger", *FIELDS, *OTHERS)
        whole.columns.finish(ALL, "near", k=job.later)
    if job.later:  # others ask for planes, which are changed
        sweep("faces-settled", settle_planes)
    return whole


def _join_forests(whole, cells):
    """Fill signs, by which the sides of normals agree along a tree of all places."""
    points, normals = whole.open("points"), whole.open("sides")
    forests = np.concatenate([whole.columns.read(cell, "forest") for cell in cells])
    whole.make(signs=float)
    tree = spanning_forest(normals, points, *forests.T)
    whole.open("signs")[:] = signs_along(normals, points, *tree)


def stored_planes(cell, job, fitted):
    """The points of a cell, their `Columns` by a fitted estimator, and what `settle_planes` puts
    into `FACES`, without the offsets of the columns."""
    points = job.whole().rows_of("points", job.whole().rows(cell))
    columns = Columns.of(fitted, points.astype(job.constants.dtype))
    planes = columns.planes(np.arange(len(points)))
    return points, columns, {name: getattr(planes, name) for name in ("normals", "scale")}


def settle_planes(cell, job):
    """As `settle`, of `stored_planes`, whose offsets take a third of their centroids' disk."""
    settle(cell, job, ("normals", "scale"))
    whole, columns = job.whole(), job.columns
    if columns.path(cell, "offset").exists():
        points, normals = (whole.rows_of(name, whole.rows(cell)) for name in ("points", "normals"))
        points, offset = points.astype(job.constants.dtype), columns.read(cell, "offset")
        whole.put(cell, centroids=points_off(points, offset, normals))
        columns.drop(cell, "offset")


def fitted_to_new(job, queries):
    """An estimator that has what is public of new points (m, 3), once planes are found."""
    model, X = job.model(), queries.astype(job.constants.dtype)
    surfaces, around = job.surfaces(model), model.index.query(queries)  # at once, which is faster
    planes = Planes.empty(*X.shape)

    def task(rows):
        near = around.take(rows)
        if surfaces is not None:
            found = surfaces.evaluate_neighborhoods(X[rows], near, surfaces.members.planes)
        else:
            found, _ = model.evaluate_neighborhoods(queries[rows], near)
        planes.put(rows, found)

    each_slice(len(X), model.chunk(), task, None)
    # Normals point up, and have no sides.
    return fitted_of(job.estimator, model, planes, X, lambda normals: None, curvatures_of_new, None)


def _fit_own(cell, job):
    """Fill the planes of the places of a cell, each of its own neighborhood."""
    surfaces, whole = job.surfaces(job.model()), job.whole()
    surfaces.fit_own(whole.rows(cell), job.n_threads)
    _put(whole, cell, surfaces.members)


def _bend(cell, job):
    """Decide the forms of the planes of a cell, and change the planes as these ask.

    What an earlier run has changed in part is filled anew before.
    """
    surfaces, whole = job.surfaces(job.model()), job.whole()
    own = whole.rows(cell)
    if whole.columns.is_done(cell, "begun"):
        surfaces.fit_own(own, job.n_threads)
    else:
        planes = surfaces.members.planes
        whole.changed(cell, **{name: getattr(planes, name)[own] for name in FACES})
    surfaces.bend(own, job.n_threads)
    whole.columns.finish(cell, "begun")
    whole.columns.drop(cell, "changes")
    _put(whole, cell, surfaces.members)


def _put(whole, cell, members):
    """Fill what a cell has of the columns, but keep `FACES`, for which others ask, beside them."""
    found, own = {**members.planes._asdict(), **members._asdict()}, whole.rows(cell)
    whole.put(cell, **{name: found[name][own] for name in (*FIELDS, *OTHERS)})
    whole.change(cell, **{name: found[name][own] for name in FACES})


def _keep_fitted(cell, job):
    """Find what is public of the places of a cell; returns what the job keeps of it."""
    model, whole = job.model(), job.whole()
    surfaces, own, index = job.surfaces(model), whole.rows(cell), model.index
    planes = Planes.empty(own.stop - own.start, 3).without("spacing")

    def find(rows, part):
        if surfaces is None:
            found, _ = model.evaluate_neighborhoods(index.points[rows], index.query_own(rows))
            return planes.put(part, found)
        planes.put(part, surfaces.last(rows)[1])

    each_part(own, model.chunk(), find, job.n_threads)
    rows_of, origins = np.arange(own.start, own.stop), job.origins()
    if origins is not None:  # copies of a point may have been measured from elsewhere
        place_of, origins = job.columns.read(cell, "place_of"), origins[job.cells.rows(cell)]
        rows_of, planes = rows_of[place_of], planes.take(place_of)
    X = index.points[rows_of].astype(job.constants.dtype)

    def orient(normals):
        if origins is not None:
            orient_toward(normals, origins - X)
        elif not has_tree(job.estimator):
            sides = Sides(job.estimator.orientation, job.estimator.sensor_origin, X)
            sides.orient(None, normals, X, job.n_threads)
        elif job.columns.is_done(ALL, "tree"):
            normals *= whole.open("signs")[own, None]

    def curvatures(model, planes, X, n_jobs):
        found = Curvatures.empty(len(X))

        def task(part):
            given = index.points[rows_of[part]], index.query_own(rows_of[part])
            found.put(part, curvatures_of_each(model, planes.take(part), *given))

        each_slice(len(X), model.chunk(), task, n_jobs)
        return found

    fitted = fitted_of(job.estimator, model, planes, X, orient, curvatures, job.n_threads)
    fitted.n_neighbors_ = index.n_neighbors
    if index.sizes is not None:
        fitted.n_neighbors_ = index.sizes[rows_of]
    return job.keep(cell, job, fitted)


def _narrow(cell, job):
    """Free neighbors that nobody asks for later."""
    if job.later is not None:
        StoredNeighbors(job.whole()).free(cell, all_of_them=not job.later)


def _keep_normals(cell, job, fitted):
    return {"sides": fitted.normals_}


def _find_forest(cell, job):
    """Find the edges of the forest of the places of a cell and their neighbors, by rows."""
    whole, index = job.whole(), job.index()
    near = index.query_own(whole.rows(cell), min(TreeLimits().n_neighbors, len(whole))).indices
    known, local = np.unique(near, return_inverse=True)
    local = local.reshape(near.shape).astype(np.int32)
    first = np.repeat(local[:, 0], local.shape[1])
    normals = whole.open("sides")[known]
    edges = spanning_forest(normals, index.points[known], first, local.ravel())
    return {"forest": known[np.column_stack(edges)]}
