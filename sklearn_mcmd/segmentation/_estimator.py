"""RegionGrowing: surfaces of a point cloud as clusters."""

import warnings
from numbers import Integral, Real
from typing import ClassVar, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike
from sklearn.base import BaseEstimator, ClusterMixin, clone

from sklearn_mcmd._sklearn import DocLinkMixin, Interval, StrOptions, fit_context
from sklearn_mcmd._validation import SAID, check_work, validate_points
from sklearn_mcmd.normals._estimator import RobustNormalEstimator
from sklearn_mcmd.planes._columns import Columns, split_columns
from sklearn_mcmd.planes._neighborhoods import NeighborIndex
from sklearn_mcmd.planes._orientation import point_up
from sklearn_mcmd.planes._record import Planes
from sklearn_mcmd.planes._resolution import coordinate_steps, least_scales
from sklearn_mcmd.runtime._progress import progress_part
from sklearn_mcmd.segmentation._assign_points import Claims
from sklearn_mcmd.segmentation._cylinder_parts import CylinderParts
from sklearn_mcmd.segmentation._graph import GrowthRules, grow_regions, link_neighbors, seed_order
from sklearn_mcmd.segmentation._merge_coplanar import RegionPlanes, join_coplanar
from sklearn_mcmd.segmentation._narrow_faces import NarrowFaces
from sklearn_mcmd.segmentation._region_division import divide_at_creases
from sklearn_mcmd.segmentation._region_sums import n_regions_of, region_moments, region_sizes
from sklearn_mcmd.segmentation._region_table import region_table


class GrowthSteps(NamedTuple):
    """What refines the paper's growth; tests switch single steps off."""

    mutual: bool = True  # planes explain each other
    find_narrow_faces: bool = True
    divide_at_creases: bool = True
    join_coplanar: bool = True
    join_curved: bool = True
    assign_unlabeled: bool = True


class Segments(NamedTuple):
    """The points of a cloud, and the regions found among them."""

    neighbor_index: NeighborIndex
    labels: np.ndarray  # (n,) of its points, from 0 for the largest region on; -1 for none
    planes: Planes  # of these points; `scale` and `radius` are those that growth uses
    copies: np.ndarray | None  # (n,), points at each place; None for one
    step: float  # to which the coordinates were rounded, 0 where there is none


class RegionGrowing(DocLinkMixin, ClusterMixin, BaseEstimator):
    """Surfaces of a point cloud, one number each: road, kerb, walls, poles (section 5.2.3).

    A region starts at the point of least curvature. It takes in neighbors that lie in the plane
    of one of its points, are near to that point, and have a similar normal. The next region
    starts at the flattest point that is left. Normals may turn from point to point, so a pole or
    a vault is one region. Normals may not jump: road, kerb and footpath are three regions, if
    the normals stay those of one face up to the edge.

    Parameters
    ----------
    n_neighbors : int, default=30
        Size of a neighborhood (k), the point itself included. Fewer than 12 tear bent surfaces.

    max_angle : float, default=15
        Largest angle between the normals of neighbors in a region, in degrees, in (0, 90].

    max_distance : float, default=None
        Largest distance of a neighbor from the plane of a point, in units of X. None means the
        median of the distances of the neighbors that `max_gap` leaves, the point among them, and
        two robust standard deviations.

    max_gap : float, default=None
        Largest distance of a neighbor, in units of X. None means the median of the
        neighborhood's distances: the nearer half of the neighbors.

    min_region_size : int, default=10
        Regions of fewer points are dissolved.

    refine : bool, default=True
        Whether growth is refined; False is the paper's growth alone. Planes must then explain each
        other, what is left over grows again as narrow faces such as kerbs, regions are divided at
        creases that single neighborhoods do not show, parts of one plane or cylinder are joined,
        and points and fragments of no region go to the nearest plane that explains them.
        :ref:`refined_growth` has the six steps. Creases and cylinders are for three dimensions.

    normals : {"estimate", "precomputed"}, default="estimate"
        "estimate": X are coordinates, and `normal_estimator` finds normals and curvature.
        "precomputed": X are the columns of :meth:`RobustNormalEstimator.transform`, as in a
        Pipeline behind it.

    normal_estimator : RobustNormalEstimator, default=None
        The estimator of the normals. It is cloned. None means ``RobustNormalEstimator()`` with
        the `random_state` and `n_jobs` given here. Not used with ``normals="precomputed"``.

    random_state : int, RandomState instance or None, default=None
        Seed of the default `normal_estimator`; growing itself draws nothing.

    n_jobs : int, default=None
        Number of threads. None means 1 unless in a :obj:`joblib.parallel_config` context, and
        -1 means all processors. Results do not depend on it.

    Attributes
    ----------
    labels_ : ndarray of int of shape (n_samples,)
        Region of each point, from 0 for the largest on; -1 for points of none.

    n_regions_ : int
        Number of regions.

    region_sizes_ : ndarray of int of shape (`n_regions_`,)
        Points in each region.

    region_centroids_ : ndarray of shape (`n_regions_`, n_dimensions)
        Mean of each region's points.

    region_normals_ : ndarray of shape (`n_regions_`, n_dimensions)
        Unit normal of the plane fitted to each region, the last coordinate positive.

    region_errors_ : ndarray of shape (`n_regions_`,)
        Root mean square distance of a region's points to its plane, in units of X: the noise
        where the region is flat, more where it is curved.

    regions_ : ndarray of shape (`n_regions_`,) or None
        In three dimensions a structured array of `kind` ("plane", "cylinder" or "curved"),
        `points`, `area` and `outline` (WKT) of the convex hull in the plane of best fit,
        `centroid`, `normal`, `dip` (0 is level) and `dip_direction` (clockwise from y, the way
        down) in degrees, `rms` about the plane or cylinder, standard errors of the plane's height
        at the centroid (`height_error`) and, in degrees, of its normal (`normal_error`), dip
        (`dip_error`) and direction of dip (`dip_direction_error`), and of
        cylinders `axis_point`, `axis` and `radius`, else not a number. A plane's distances are
        its noise or what a flat region shows; a cylinder leaves the neighborhoods' noise, and 1.5
        times less than a plane.

    normal_estimator_ : RobustNormalEstimator
        The fitted estimator of normals; absent with ``normals="precomputed"``.

    n_features_in_ : int
        Number of features seen during `fit`.

    feature_names_in_ : ndarray of shape (`n_features_in_`,)
        Names of features seen during `fit`, when X has names that are all strings.

    See Also
    --------
    RobustNormalEstimator : The normals that regions grow by.
    sklearn_mcmd.metrics.segmentation_scores : Compares regions with the truth.
    sklearn.cluster.DBSCAN : By distance alone, as PDAL's ``filters.cluster``; Open3D's
        ``detect_planar_patches`` finds flat patches.

    Notes
    -----
    The paper leaves the automatic thresholds to a reference that was not at hand. Those here,
    the median and two median absolute deviations of the distances to the plane and the median
    of the distances between points, are remembered from later papers of its authors, and
    unverified. ``refine=False`` is nearest to the paper. Departures: deviations are scaled to
    standard deviations by 1.4826, and half the step of rounded coordinates is added, or what their
    precision amounts to.

    A region holds all points that can be reached from its seed. Sums over regions are exact in any
    order, and ties end at coordinates. So labels depend neither on the order of rows nor on
    `n_jobs`, if there is a `random_state`: without one each fit draws other planes, and in one of
    six small clouds some labels change. Copies of a point count once in neighborhoods and get the
    same label.

    Time and memory grow in proportion to ``n_samples * n_neighbors``, but for the search of
    neighbors, which adds a logarithm. In 3D and from 2,000 points on the work is done by
    compiled code.

    References
    ----------
    .. [1] A. Nurunnabi, G. West, D. Belton, "Outlier detection and robust normal-curvature
       estimation in mobile laser scanning 3D point cloud data", Pattern Recognition 48
       (2015) 1404-1419, section 5.2.3.

    Examples
    --------
    A floor and a wall that meet in an edge:

    >>> import numpy as np
    >>> from sklearn_mcmd import RegionGrowing
    >>> rng = np.random.default_rng(0)
    >>> floor = rng.uniform(0, 1, (700, 3)) * [1, 1, 0]
    >>> wall = rng.uniform(0, 1, (500, 3)) * [1, 0, 1]
    >>> X = np.vstack([floor, wall]) + rng.normal(0, 0.002, (1200, 3))
    >>> growing = RegionGrowing(random_state=0).fit(X)
    >>> growing.n_regions_
    2
    >>> np.abs(growing.region_normals_).round(1)
    array([[0., 0., 1.],
           [0., 1., 0.]])

    Behind an estimator of normals, and with a grid's parameters by name:

    >>> from sklearn.pipeline import make_pipeline
    >>> from sklearn_mcmd import RobustNormalEstimator
    >>> pipeline = make_pipeline(
    ...     RobustNormalEstimator(random_state=0), RegionGrowing(normals="precomputed"))
    >>> bool((pipeline.fit_predict(X) == growing.labels_).all())
    True
    """

    _parameter_constraints: ClassVar[dict] = {
        "n_neighbors": [Interval(Integral, 2, None, closed="left")],
        "max_angle": [Interval(Real, 0, 90, closed="right")],
        "max_distance": [Interval(Real, 0, None, closed="neither"), None],
        "max_gap": [Interval(Real, 0, None, closed="neither"), None],
        "min_region_size": [Interval(Integral, 1, None, closed="left")],
        "refine": ["boolean"],
        "normals": [StrOptions({"estimate", "precomputed"})],
        "normal_estimator": [RobustNormalEstimator, None],
        "random_state": ["random_state"],
        "n_jobs": [Integral, None],
    }
    _work: ClassVar = ("growth_neighbors", 1)  # for `check_work`, as the command line names it

    def __init__(
        self,
        n_neighbors: int = 30,
        *,
        max_angle: float = 15.0,
        max_distance: float | None = None,
        max_gap: float | None = None,
        min_region_size: int = 10,
        refine: bool = True,
        normals: Literal["estimate", "precomputed"] = "estimate",
        normal_estimator: RobustNormalEstimator | None = None,
        random_state: int | np.random.RandomState | None = None,
        n_jobs: int | None = None,
    ) -> None:
        self.n_neighbors = n_neighbors
        self.max_angle = max_angle
        self.max_distance = max_distance
        self.max_gap = max_gap
        self.min_region_size = min_region_size
        self.refine = refine
        self.normals = normals
        self.normal_estimator = normal_estimator
        self.random_state = random_state
        self.n_jobs = n_jobs

    @fit_context(prefer_skip_nested_validation=True)
    def fit(self, X: "ArrayLike", y: object = None) -> Self:
        """Find the regions of a cloud.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)
            Coordinates in any unit, float64 or float32, at least two and ``n_features + 1``
            points; or, with ``normals="precomputed"``, the columns of a
            :class:`RobustNormalEstimator`.
        y : Ignored

        Returns
        -------
        self : object

        Raises
        ------
        ValueError
            If X has NaN, infinite or too few values, or ``normals="precomputed"`` and X are not
            the columns of a :class:`RobustNormalEstimator`.
        """
        index, labels, planes, copies, step = self._segment(X)
        points, places, n_regions = index.points, index.places, n_regions_of(labels)
        weights = copies if len(points) < len(places) else None
        region_planes = RegionPlanes.of(region_moments(points, labels, n_regions, weights))
        self.n_regions_ = n_regions
        self.region_sizes_ = region_planes.sizes.astype(np.int64)
        self.region_centroids_ = region_planes.centroids
        self.region_normals_ = point_up(region_planes.axes[..., 0].copy())
        self.region_errors_ = np.sqrt(region_planes.eigenvalues[:, 0])
        self.regions_ = None
        if points.shape[1] == 3:
            self.regions_ = region_table(points, labels, planes, region_planes, step)
        self.labels_ = labels[places].astype(np.int64)
        return self

    def _segment(self, X):
        """The `Segments` of a cloud."""
        columns = self._columns(X)
        xyz = columns.coordinates
        index = NeighborIndex(xyz.astype(np.float64, copy=False), self.n_neighbors)
        points, rows = index.points, index.rows
        steps = coordinate_steps(xyz)
        # The planes know the steps of a depth: as a floor these would join a book to its table.
        floor = least_scales(points, np.finfo(xyz.dtype).eps, steps._replace(growth=0.0))
        planes = columns.planes(rows)
        planes.scale[:] = np.maximum(planes.scale, floor)
        rules = self._rules()
        with progress_part(0.35, 0.5, "links of neighbors"):
            links, planes.radius[:] = link_neighbors(index, planes, floor, rules, self.n_jobs)
        with progress_part(0.5, 0.55, "growing regions"):
            seeds = seed_order(columns.surface_variation[rows], points, planes)
            labels = grow_regions(links, seeds)
            del links, seeds
        copies = None  # each has a place of its own
        if index.n_distinct < len(xyz):
            copies = np.bincount(index.places, minlength=len(points))
        labels = renumbered(labels, copies, self.min_region_size)
        with progress_part(0.55, 1.0):
            labels = self._refined(labels, index, planes, floor, copies)
        return Segments(index, labels, planes, copies, steps.lattice)

    def _refined(self, labels, index, planes, floor, copies):
        """The regions from those that have grown; the largest is 0, -1 is none.

        Labels are changed. The planes are of ``index.points``; what tells of their faces may be
        changed. `floor` is as by `least_scales`, and `copies` as of `Segments`.
        """
        rules, steps, in_space = self._rules(), self._steps(), index.points.shape[1] == 3
        if steps.find_narrow_faces:
            with progress_part(0.0, 0.45, "narrow faces"):
                faces = NarrowFaces(
                    index=index, planes=planes, floor=floor, rules=rules, n_jobs=self.n_jobs
                )
                labels = renumbered(faces.grow(labels), copies, self.min_region_size)
        claims = Claims(index, planes, rules, self.n_jobs)
        with progress_part(0.45, 0.65, "joining regions"):
            if steps.divide_at_creases and in_space:
                labels = divide_at_creases(labels, index, planes, rules, self.n_jobs)
                labels = renumbered(labels, copies, self.min_region_size)
            if steps.assign_unlabeled:
                labels = renumbered(claims.absorb_fragments(labels), copies)
            if steps.join_coplanar:
                labels = join_coplanar(index.points, labels, planes, self.n_jobs)
        curved = []
        with progress_part(0.65, 1.0, "cylinders and the rest"):
            if steps.join_curved and in_space:
                gap = self.max_gap or np.inf
                cylinders = CylinderParts(
                    index=index, planes=planes, floor=floor, max_gap=gap, n_jobs=self.n_jobs
                )
                labels, curved = cylinders.grow(labels)
            if steps.assign_unlabeled:
                labels = claims.assign_unlabeled(labels, curved)
        return renumbered(labels, copies)

    def _steps(self):
        """The `GrowthSteps`: all of them, or none."""
        steps = GrowthSteps()
        return steps if self.refine else GrowthSteps._make(False for _ in steps)

    def _rules(self):
        """The `GrowthRules` that the parameters are."""
        cosine = np.cos(np.radians(self.max_angle))
        return GrowthRules(cosine, self.max_distance, self.max_gap, self._steps().mutual)

    def _columns(self, X):
        """Coordinates and planes of all points."""
        X = validate_points(self, X, ensure_min_features=2)
        check_work(self, len(X))
        if self.normals == "precomputed":
            columns = split_columns(X)
            self.__dict__.pop("normal_estimator_", None)  # of a fit with other parameters
            return columns
        estimator = self.normal_estimator
        if estimator is None:
            estimator = RobustNormalEstimator(random_state=self.random_state, n_jobs=self.n_jobs)
        self.normal_estimator_ = clone(estimator)
        with progress_part(0.0, 0.35), warnings.catch_warnings():
            warnings.filterwarnings("ignore", SAID)
            return Columns.of(self.normal_estimator_.fit(X), X)


def renumbered(labels, copies, min_size=1):
    """Labels in order of size, 0 for the largest region; -1 below `min_size`."""
    sizes = region_sizes(labels, n_regions_of(labels), copies)
    return numbers_by_size(sizes, min_size)[labels]


def numbers_by_size(sizes, min_size=1):
    """Numbers of regions in order of size, of equal ones the first; -1 of those below `min_size`,
    and the last, which is that of no region."""
    order = np.argsort(-sizes, kind="stable")
    order = order[sizes[order] >= max(min_size, 1)]
    number = np.full(len(sizes) + 1, -1, np.int32)
    number[order] = np.arange(len(order))
    return number
