"""Results whose neighborhoods reach beyond what was read around a tile.

A tile's estimator has planes of all points, of which some are not those of the whole cloud. What is
wrong is few: neighborhoods that reach the border, and what depends on their planes. Only that is
computed again, stage by stage as the estimator does, with neighborhoods that are searched for in
all cells. Everything else is taken from the estimator.
"""

import copy
from typing import NamedTuple

import numpy as np

from sklearn_mcmd.normals._curvature import curvatures_of_each
from sklearn_mcmd.normals._surface_planes import SurfacePlanes
from sklearn_mcmd.planes._columns import plane_offsets
from sklearn_mcmd.planes._indexed_cloud import distinct_rows
from sklearn_mcmd.planes._neighborhoods import NeighborIndex
from sklearn_mcmd.planes._orientation import point_up
from sklearn_mcmd.planes._plane import surface_variation
from sklearn_mcmd.planes._record import Neighborhoods, Planes

__all__ = ["WiderCloud", "mended", "widened"]

NOT_SEARCHED = -1


class WiderCloud:
    """The points of an index, and beyond them those that its neighborhoods turn out to have.

    Rows are those of the index; then come the points beyond, as they are found.

    Parameters
    ----------
    cells : Cells
        Of the whole cloud.
    index : NeighborIndex
        Of all points of a box, and maybe of others.
    exact : ndarray of bool of shape (m,)
        Which neighborhoods are those of the whole cloud.
    reach : ndarray of shape (m,)
        Distances within which points have all neighbors of the index.
    box : pair of ndarray of shape (3,)
    complete : callable
        Adds points of the cloud to some, so that compiled code searches them.
    """

    def __init__(self, cells, index, exact, reach, box, complete):
        self.cells, self.index, self.box, self.complete = cells, index, box, complete
        self.exact, self.reach, self.sizes = exact, reach.copy(), index.sizes
        self.beyond = np.empty((0, 3))
        self._found = []
        self._place = np.full(len(exact), NOT_SEARCHED, np.int32)

    def points(self):
        """All points, (n, 3)."""
        return np.vstack([self.index.points, self.beyond])

    def is_exact(self, rows):
        """Whether the index has the neighborhoods of rows."""
        known = np.zeros(len(rows), bool)
        own = rows < len(self.index.points)
        known[own] = self.exact[rows[own]]
        return known

    def search(self, rows):
        """Search in all cells for neighborhoods that are not known."""
        rows = rows[~self.is_exact(rows)]
        rows = rows[self._place[rows] == NOT_SEARCHED]
        if not len(rows):
            return
        near, around, reach = self._searched(rows, self.points()[rows])
        used = np.unique(around.indices)
        numbers = np.full(len(near.points), NOT_SEARCHED, np.int32)
        numbers[used] = self._numbers(near, used)
        around = widened(around._replace(indices=numbers[around.indices]), self.index.n_neighbors)
        self._place[rows] = sum(len(other.sizes) for other in self._found) + np.arange(len(rows))
        self._found.append(around)
        # As many neighbors of a point as it has lie as near to each of them as its ball is wide.
        wide = np.broadcast_to(2.0 * reach[:, None], around.indices.shape)
        tells = ... if self.sizes is None else self.sizes[around.indices] <= around.sizes[:, None]
        np.minimum.at(self.reach, around.indices[tells], wide[tells])

    def around(self, rows):
        """The neighborhoods of rows, which are exact or were searched for."""
        k = self.index.n_neighbors
        indices, sizes = np.empty((len(rows), k), np.int32), np.empty(len(rows), np.int64)
        known = self.is_exact(rows)
        own = widened(self.index.query_own(rows[known]), k)
        indices[known], sizes[known] = own.indices, own.sizes
        if not known.all():
            joined = Neighborhoods(*map(np.concatenate, zip(*self._found, strict=True)))
            self._found = [joined]
            found = joined.take(self._place[rows[~known]])
            indices[~known], sizes[~known] = found.indices, found.sizes
        return Neighborhoods(indices, sizes)

    def _searched(self, rows, queries):
        """An index of points around queries, their neighborhoods, and how far these reach."""
        found, reach = self.cells.neighbors(queries, self.index.n_neighbors, self.reach[rows])
        near = NeighborIndex(self.complete(found), self.index.n_neighbors, self.index.radius)
        return near, near.query_own(near.nearest(queries)), reach

    def _numbers(self, near, used):
        """Rows of the points of an index that are used, of which some are new."""
        points = near.points[used]
        within = ((points >= self.box[0]) & (points < self.box[1])).all(axis=1)
        numbers, m, n = np.empty(len(points), np.intp), len(self.exact), len(self.beyond)
        numbers[within] = self.index.nearest(points[within])
        together = np.vstack([self.beyond, points[~within]])
        first, same = distinct_rows(together)
        self.beyond = together[first]
        numbers[~within] = m + (np.arange(len(together)) if same is None else same)[n:]
        n_new = len(self.beyond) - n
        self.reach = np.append(self.reach, np.full(n_new, np.inf))
        self._place = np.append(self._place, np.full(n_new, NOT_SEARCHED, np.int32))
        return numbers


def widened(around, k):
    """The same neighborhoods with k columns; those beyond the sizes repeat the first."""
    m, width = around.indices.shape
    if width == k:
        return around
    first = np.broadcast_to(around.indices[:, :1], (m, k - width))
    return around._replace(indices=np.hstack([around.indices, first]))


class _Points(NamedTuple):
    """What stages ask of an index."""

    points: np.ndarray


def mended(estimator, cloud, rows, dtype):
    """A copy of the estimator whose results are those of some points of its index.

    Parameters
    ----------
    estimator : RobustNormalEstimator
        Fitted to the points of the cloud's index.
    cloud : WiderCloud
    rows : ndarray of int of shape (n,)
        Of the index, in ascending order.
    dtype : dtype
        Of the coordinates.
    """
    cloud.search(rows)
    around = cloud.around(rows)
    surfaces = estimator._surfaces
    model, points = estimator._model, cloud.index.points[rows]
    if surfaces is None:
        model = _model_of(model, cloud.points())
        planes = model.evaluate_neighborhoods(points, around)[0]
    else:
        planes = _Stages(surfaces, cloud).planes_of(rows, around)
        model = _model_of(model, cloud.points())
    result, X = copy.copy(estimator), points.astype(dtype)
    result.normals_ = point_up(planes.normals)
    result._sides.orient(None, result.normals_, X, 1)
    result.eigenvalues_, result.removed_fraction_ = planes.eigenvalues, 1.0 - planes.kept
    result.surface_variation_ = surface_variation(planes.eigenvalues)
    result.plane_offset_ = plane_offsets(planes, result.normals_, X)
    result.plane_scale_ = planes.scale

    def curvatures(_, planes, *args):
        return curvatures_of_each(model, planes, points, around)

    result.features_ = result._evaluate_features(planes, result.normals_, X, curvatures)
    return result


class _Stages:
    """The stages of `SurfacePlanes` for some rows of a wider cloud.

    A row's stage needs the stage before of its members, but only where it asks them: only rough
    planes are lent another.
    """

    def __init__(self, surfaces, cloud):
        self.surfaces, self.cloud = surfaces, cloud
        self.swept = np.empty(0, np.intp)  # ascending
        self.planes, self.forms = Planes.empty(0, 3), np.empty(0, np.int8)
        self.noise, self.left = surfaces.noise, surfaces.left
        self._bent = np.empty(0, np.intp)

    def planes_of(self, rows, around):
        """The planes of rows, whose neighborhoods are given."""
        places = self.bend(rows)
        own, forms = self.planes.take(places), self.forms[places]
        rough = np.flatnonzero(forms == SurfacePlanes.ROUGH)
        if not (self.surfaces.lends and len(rough)):
            return own
        around = around.take(rough)
        members = np.unique(around.indices)
        wrong = members[~_is_settled(self.cloud, members)]
        again = self.bend(wrong)
        replaced = np.searchsorted(members, wrong)
        known = members.copy()
        known[replaced] = 0  # some row of the index
        lent = self.surfaces.members_of(known)
        noise = self.surfaces.noise_of(known, lent)
        lent.put(replaced, self.planes.take(again)._replace(spacing=lent.spacing))
        bends = self.forms[again] == SurfacePlanes.BENT
        noise[replaced] = np.where(bends, self.left[wrong], self.planes.scale[again])
        points = self.cloud.points()
        around = around._replace(indices=np.searchsorted(members, around.indices))
        part, stage = own.take(rough), self._stage(points[members])
        stage.lend(points[rows[rough]], part, forms[rough], around, lent, noise)
        own.put(rough, part)
        return own

    def bend(self, rows):
        """Places of rows among those that were swept, whose planes are as before any is lent."""
        self.sweep(rows)
        new = rows[~np.isin(rows, self._bent)]
        asked = [np.unique(self.cloud.around(some).indices) for some in self._parts(new)]
        asked = np.unique(np.concatenate([new, *asked]))
        self.sweep(asked[~self.cloud.is_exact(asked)])
        points = self.cloud.points()
        stage = self._stage(points)
        stage.noise = self.noise
        for some in self._parts(new):
            places = np.searchsorted(self.swept, some)
            own, forms = self.planes.take(places), self.forms[places]
            stage._bend(points[some], own, forms, self.left[some], self.cloud.around(some))
            self.planes.put(places, own)
            self.forms[places] = forms
        self._bent = np.union1d(self._bent, new)
        return np.searchsorted(self.swept, rows)

    def sweep(self, rows):
        """Fit the planes of rows that were not swept before."""
        rows = rows[~np.isin(rows, self.swept)]
        if not len(rows):
            return
        self.cloud.search(rows)
        points = self.cloud.points()
        n_new = len(points) - len(self.noise)
        self.noise = np.append(self.noise, np.full(n_new, np.nan))
        self.left = np.append(self.left, np.full(n_new, np.nan))
        stage = self._stage(points)
        planes, forms = Planes.empty(len(rows), 3), np.empty(len(rows), np.int8)
        done = 0
        for some in self._parts(rows):
            part, own = slice(done, done + len(some)), Planes.empty(len(some), 3)
            around = self.cloud.around(some)
            found = stage._own(points[some], own, around)
            forms[part], self.noise[some], self.left[some] = found
            planes.put(part, own)
            done += len(some)
        order = np.argsort(swept := np.append(self.swept, rows), kind="stable")
        self.swept = swept[order]
        self.forms = np.append(self.forms, forms)[order]
        both = zip(self.planes, planes, strict=True)
        self.planes = Planes(*(np.concatenate(values)[order] for values in both))

    def _stage(self, points):
        return SurfacePlanes(
            _model_of(self.surfaces.model, points),
            self.surfaces.lends,
            1,
            self.surfaces.tangents,
        )

    def _parts(self, rows):
        """Parts of rows that are computed at once."""
        return (
            np.array_split(rows, -(-len(rows) // self.surfaces.model.chunk())) if len(rows) else []
        )


def _is_settled(cloud, rows):
    """Whether the estimator knows the planes of rows before any is lent, those of no surface too:
    the own neighborhood and those of its members are exact."""
    settled = cloud.is_exact(rows)
    around = cloud.index.query_own(rows[settled])
    settled[settled] = cloud.exact[around.indices].all(axis=1)
    return settled


def _model_of(model, points):
    """The same model with other points, whose neighborhoods are given."""
    model = copy.copy(model)
    model.index = _Points(points)
    return model
