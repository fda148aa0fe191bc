"""SharpFeatureDetector: edges and corners of point clouds."""

import warnings
from itertools import chain
from math import fsum, sqrt
from numbers import Integral, Real
from typing import ClassVar, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator, clone
from sklearn.utils.validation import check_is_fitted, check_random_state

from sklearn_mcmd._choices import Criterion, choices_of
from sklearn_mcmd._errors import ParameterError
from sklearn_mcmd._sklearn import DocLinkMixin, HasMethods, Interval, StrOptions, fit_context
from sklearn_mcmd._validation import (
    SAID,
    FittedScoresMixin,
    check_extent,
    check_inliers,
    check_sizes,
    check_work,
    validate_points,
)
from sklearn_mcmd.edges._crease_distance import CreaseLimits, find_creases
from sklearn_mcmd.normals._estimator import RobustNormalEstimator
from sklearn_mcmd.outliers._detector import MCMDOutlierDetector
from sklearn_mcmd.planes._around import quantile_of
from sklearn_mcmd.planes._base import warn_if_few
from sklearn_mcmd.planes._columns import Columns, split_columns
from sklearn_mcmd.planes._indexed_cloud import IndexedCloud
from sklearn_mcmd.planes._neighborhoods import NeighborIndex
from sklearn_mcmd.planes._rules import MAD_TO_SD
from sklearn_mcmd.planes._whole import whole_cloud
from sklearn_mcmd.runtime._progress import progress_part

# What steps within warn of, whose n_neighbors nobody gave.
TOO_MANY = "n_neighbors=.* is more than the number"


class EdgeLimits(NamedTuple):
    """Which points belong to an edge, where no parameter says it."""

    width: float = 2.0  # spacings from a crease
    # Share of the neighbors on which planes rest that meet in creases: a smaller patch reaches
    # across an edge less.
    of_planes: float = 0.75
    # Chance that no trial of a plane is of one face: by 207 trials, in place of 69, another seed
    # finds half as many other edges.
    luck: float = 1e-12
    robust_std: float = 3.0  # robust standard deviations above the median
    paper_std: float = 1.0  # standard deviations above the mean (Eq. 25)


class SharpFeatureDetector(DocLinkMixin, FittedScoresMixin, BaseEstimator):
    """Edges and corners: points next to a line in which two faces meet (Eq. 25 and better).

    The detector cleans the cloud first, because outliers look like edges. It gives each point
    and its neighbors the planes that explain them best. Where two of these planes meet in a
    crease, it knows the distance to the crease to a fraction of the spacing of the points. An
    edge and a curved surface are told apart by which of the two explains the neighborhoods
    better. With the other criteria a point is on an edge if its neighborhood is not flat, as in
    the paper.

    Parameters
    ----------
    n_neighbors : int, default=40
        Size of a neighborhood, at least ``n_features + 1``. A point of the fitted cloud is its
        own first neighbor. Fewer neighbors tell apart edges that are close to each other, more
        neighbors withstand noise. For "crease" the cleaning and the planes take three quarters
        of them.

    criterion : {"crease", "eigenvalue", "surface_variation"}, default="crease"
        What makes an edge:

        - "crease": the distance to the line where the planes of two faces meet, in spacings of
          the points;
        - "eigenvalue": the least eigenvalue of the neighborhood, in squared units of X
          (Eq. 25);
        - "surface_variation": the same over the sum of the eigenvalues (Eq. 3), which does not
          depend on the spacing.

    threshold : float or "mean", default=None
        The limit of an edge. A number is the largest distance in spacings for "crease", at most
        10, and the least value of the criterion for the others. None means 2 spacings for
        "crease", and the median plus `n_std` robust standard deviations of the cloud for the
        others. "mean" means the mean plus `n_std` standard deviations (Eq. 25), and is not for
        "crease".

    n_std : float, default=None
        Standard deviations above the median or the mean (a in Eq. 25). None means 3 from the
        median and 1, as in the paper, from the mean.

    min_angle : float, default=20
        Least angle between two faces of an edge, in degrees. For "crease" only.

    outlier_detector : estimator or "passthrough", default=None
        The detector that cleans the cloud first: an estimator with `fit_predict`, +1 for
        inliers. None means :class:`MCMDOutlierDetector`: with three quarters of `n_neighbors` for
        "crease", and ``strictness="surfaces"`` for the other criteria. "passthrough" cleans
        nothing.

    normal_estimator : RobustNormalEstimator, default=None
        The estimator of the planes of the cleaned cloud. None means one with three quarters of
        `n_neighbors` for "crease", since a smaller patch reaches across an edge less, with
        ``tangents=False``, because a tangent turns beside an edge from one face to the other,
        with three times as many trials, so that another seed changes fewer edges, and
        with ``method="pca"`` for "eigenvalue" and "surface_variation". A robust fit removes one
        of two faces, and its own eigenvalues then do not show the edge.

    normals : {"estimate", "precomputed"}, default="estimate"
        "estimate": X are coordinates, and `normal_estimator` fits the planes. "precomputed": X
        are the columns of :meth:`RobustNormalEstimator.transform`, as in a Pipeline behind it.
        No step between them may scale columns.

    random_state : int, RandomState instance or None, default=None
        Seed of `outlier_detector` and `normal_estimator` where these have none of their own.

    n_jobs : int, default=None
        Number of threads. None means 1 unless in a :obj:`joblib.parallel_config` context, and
        -1 means all processors. Results do not depend on it.

    Attributes
    ----------
    labels_ : ndarray of int of shape (n_samples,)
        1 for the fitted points of surfaces, and -1 for those of edges: as `fit_predict` returns.

    offset_ : float
        ``decision_function = score_samples - offset_``.

    scores_ : ndarray of shape (n_samples,)
        ``score_samples`` of the fitted points.

    inlier_mask_ : ndarray of bool of shape (n_samples,)
        Which of the fitted points were left by the cleaning.

    outlier_detector_, normal_estimator_ : estimators
        As fitted; absent where none was.

    n_features_in_ : int
        Number of features seen during `fit`.

    feature_names_in_ : ndarray of shape (`n_features_in_`,)
        Names of features seen during `fit`, when X has names that are all strings.

    See Also
    --------
    MCMDOutlierDetector : What cleans the cloud.
    RobustNormalEstimator : The planes. scikit-learn, Open3D and PDAL have no edges.

    Notes
    -----
    Equation 25 to the letter is ``SharpFeatureDetector(30, criterion="eigenvalue",
    threshold="mean", outlier_detector="passthrough",
    normal_estimator=RobustNormalEstimator(30, reweight=False))``. A few outliers with huge
    eigenvalues raise its limit above every edge. A robust fit keeps to one face right up to the
    edge and has no large eigenvalue there. Therefore the other criteria work in two stages and
    take the median.

    An edge needs two visible faces. The free rim of a plate is no edge, nor is the line where the
    scan ends or a shadow begins. Each face needs a few points within the neighborhood. Rods as
    thin as a few spacings are told from prisms by chance.

    "crease" withstands most outliers that the default cleaning leaves. Cleaning it by
    ``strictness="surfaces"`` would lose narrow faces: with 10 % of outliers F1 falls by 3 to 11 %
    on three of four machined parts; it changes by less than 1 % on a box and a crown roof, and
    by 1.4 % on a street. Eigenvalues do not withstand outliers: that cleaning raises their F1
    from 60 to 72, from 24 to 80 and from 73 to 79 % there.

    A point that the cleaning removed is scored like a new one, by the points that are left; one
    off all planes counts as far from creases, but not as flat by the other criteria.

    The time of "crease" grows as ``n_edge * n_neighbors ** 2``, with the number of points that
    see two faces. From four dimensions on no bent surface is fitted, so each crease counts.

    References
    ----------
    .. [1] A. Nurunnabi, G. West, D. Belton, "Outlier detection and robust normal-curvature
       estimation in mobile laser scanning 3D point cloud data", Pattern Recognition 48
       (2015) 1404-1419, Section 5.2.2.

    Examples
    --------
    >>> from sklearn_mcmd import SharpFeatureDetector
    >>> from sklearn_mcmd.datasets import make_box
    >>> box = make_box(random_state=0)
    >>> labels = SharpFeatureDetector(random_state=0).fit_predict(box.data)
    >>> far = box.edge_distance > 3 * box.spacing
    >>> on_edge = box.edge_distance < box.spacing
    >>> print(f"{(labels[on_edge] == -1).mean():.0%} of the edge found, "
    ...       f"{(labels[far] == -1).mean():.0%} of the faces by mistake")
    100% of the edge found, 0% of the faces by mistake
    """

    _parameter_constraints: ClassVar[dict] = {
        "n_neighbors": [Interval(Integral, 3, None, closed="left")],
        "criterion": [StrOptions(choices_of(Criterion))],
        "threshold": [Interval(Real, 0, None, closed="neither"), StrOptions({"mean"}), None],
        "n_std": [Interval(Real, 0, None, closed="left"), None],
        "min_angle": [Interval(Real, 0, 90, closed="neither")],
        "outlier_detector": [HasMethods("fit_predict"), StrOptions({"passthrough"}), None],
        "normal_estimator": [RobustNormalEstimator, None],
        "normals": [StrOptions({"estimate", "precomputed"})],
        "random_state": ["random_state"],
        "n_jobs": [Integral, None],
    }

    def __init__(
        self,
        n_neighbors: int = 40,
        *,
        criterion: Criterion = "crease",
        threshold: float | Literal["mean"] | None = None,
        n_std: float | None = None,
        min_angle: float = 20.0,
        outlier_detector: BaseEstimator | Literal["passthrough"] | None = None,
        normal_estimator: RobustNormalEstimator | None = None,
        normals: Literal["estimate", "precomputed"] = "estimate",
        random_state: int | np.random.RandomState | None = None,
        n_jobs: int | None = None,
    ) -> None:
        self.n_neighbors = n_neighbors
        self.criterion = criterion
        self.threshold = threshold
        self.n_std = n_std
        self.min_angle = min_angle
        self.outlier_detector = outlier_detector
        self.normal_estimator = normal_estimator
        self.normals = normals
        self.random_state = random_state
        self.n_jobs = n_jobs

    @fit_context(prefer_skip_nested_validation=False)
    def fit(self, X: "ArrayLike", y: object = None) -> Self:
        """Clean a cloud, find its planes, and settle the limit of an edge.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)
            Coordinates, float64 or float32, in any unit; at least two features and
            ``n_features + 1`` points. With ``normals="precomputed"`` also the other columns.
        y : Ignored

        Returns
        -------
        self : object

        Raises
        ------
        ValueError
            If X has NaN, infinite or too few values or columns, `n_neighbors` is too small,
            `threshold` or `normals` does not fit `criterion`, or `outlier_detector` gives other
            labels than +1 and -1 or leaves too few points for a plane.
        """
        table = validate_points(self, X, ensure_min_features=2)
        columns = self._columns(table, None)  # precomputed columns determine the dimensions
        xyz = columns.coordinates
        self._n_dimensions = xyz.shape[1]
        self._check_parameters(xyz)
        for name in ("outlier_detector_", "normal_estimator_", "_creases"):
            self.__dict__.pop(name, None)  # of a fit with other parameters
        detector, normal_estimator = steps_of(self, self._n_dimensions)
        creases = self.criterion == "crease"
        index = self._index(xyz) if creases else None
        self.inlier_mask_ = kept = self._clean(xyz, detector)
        if index is not None:
            index = index if kept.all() else self._index(xyz[kept])
            warn_if_few(self, index, int(kept.sum()))
        members = table[kept]
        if self.normals == "estimate":
            self.normal_estimator_ = normal_estimator
            with progress_part(0.6, 0.8), warnings.catch_warnings():
                warnings.filterwarnings("ignore", SAID)
                if creases and self.normal_estimator is None:
                    warnings.filterwarnings("ignore", TOO_MANY)
                normal_estimator.fit(members)
        if index is not None:
            self.offset_, self.scores_ = crease_width(self), np.empty(len(xyz))
            with progress_part(0.8, 1.0, "creases"):
                with progress_part(0.0, 0.9):
                    if self.normals == "estimate":
                        of_members = Columns.of(normal_estimator, members)
                    else:
                        of_members = split_columns(members, self._n_dimensions)
                    planes = of_members.planes(index.rows).without("radius")
                    del of_members, members  # index and planes have what is needed
                    on_surface = getattr(detector, "on_surface_", kept)[kept]
                    is_part = (whole := whole_cloud()) is not None and whole.n_points > len(xyz)
                    on_surface |= not (is_part or on_surface.any())  # blobs are asked everywhere
                    on_surface = on_surface[index.rows].astype(float)
                    self._creases, distances = find_creases(
                        index, planes, self.min_angle, on_surface, self.n_jobs
                    )
                self.scores_[kept] = distances[index.places]
                with progress_part(0.9, 1.0):
                    self.scores_[~kept] = self._creases.distance(xyz[~kept].astype(np.float64))
        else:
            values = self._values(columns, fitted=True)
            self.offset_ = -least_of_edge(lambda: [values[kept]], self.threshold, self.n_std)
            self.scores_ = -values
        return self

    def score_samples(self, X: "ArrayLike") -> NDArray[np.float64]:
        """Distance to the nearest crease, or the opposite of the criterion.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)

        Returns
        -------
        scores : ndarray of shape (n_samples,)
            Lower means nearer to an edge. For "crease" it is the distance in spacings of the
            points. It is larger where a smooth surface explains the neighbors better than a crease
            does, and off all planes. Without a crease it is 10 to 20, and larger for flatter
            neighborhoods. For the other criteria it is minus the value.
        """
        check_is_fitted(self)
        X = validate_points(self, X, reset=False)
        columns = self._columns(X, self._n_dimensions)
        if self.criterion == "crease":
            return self._creases.distance(columns.coordinates.astype(np.float64))
        return -self._values(columns)

    def _columns(self, X, d):
        """Coordinates, and the precomputed columns if X has them; d is None if they tell it."""
        if self.normals == "precomputed":
            return split_columns(X, d)
        check_extent(X)
        unknown = dict.fromkeys(Columns._fields[1:], np.empty(0))
        return Columns(coordinates=X, **unknown)

    def _check_parameters(self, xyz):
        n, d = xyz.shape
        check_sizes(n, d, self.n_neighbors)
        check_work(self, n)
        if self.criterion != "crease":
            return
        if isinstance(self.threshold, str):
            raise ValueError(
                "threshold='mean' is for eigenvalues; criterion='crease' takes a distance in "
                "spacings of the points, or None for 2."
            )
        far = CreaseLimits().far
        if (self.threshold or 0.0) > far:
            raise ParameterError(
                f"$threshold={self.threshold:g} is in spacings of the points for "
                f"$criterion='crease', and creases farther than {far:g} are not sought: lower it."
            )

    @property
    def _work(self):
        return "n_neighbors", 2 if self.criterion == "crease" else 1

    def _index(self, xyz):
        """The neighbors of points, of which cleaning and planes take the nearest: one search, so
        that equal distances have one order, too."""
        index = NeighborIndex(xyz.astype(np.float64, copy=False), self.n_neighbors)
        index.query_own(slice(0, 1))
        return index

    def _clean(self, xyz, detector):
        """Mask of the points to keep."""
        if detector is None:
            return np.ones(len(xyz), dtype=bool)
        self.outlier_detector_ = detector
        with progress_part(0.0, 0.6), warnings.catch_warnings():
            warnings.filterwarnings("ignore", SAID)
            if self.outlier_detector is None:
                warnings.filterwarnings("ignore", TOO_MANY)
            labels = detector.fit_predict(xyz)
        kept = check_inliers("outlier_detector", detector, labels, least=xyz.shape[1] + 1)
        if not kept.all():
            IndexedCloud.release(xyz.astype(np.float64, copy=False))
        return kept

    def _values(self, columns, fitted=False):
        """The value of the criterion at points, if it is not "crease"; these may be the fitted."""
        if self.normals == "precomputed":
            return values_of(self.criterion, columns)
        estimator, xyz = self.normal_estimator_, columns.coordinates
        values, is_new = np.empty(len(xyz)), np.ones(len(xyz), dtype=bool)
        if fitted:
            is_new = ~self.inlier_mask_  # what was removed is scored like a new point
            values[~is_new] = values_of(self.criterion, Columns.of(estimator, xyz[~is_new]))
        if is_new.any():
            name = "eigenvalue_0" if self.criterion == "eigenvalue" else self.criterion
            column = list(estimator.get_feature_names_out()).index(name)
            values[is_new] = np.asarray(estimator.transform(xyz[is_new]))[:, column]
        return values


def crease_width(detector):
    """Spacings from a crease within which a point belongs to the edge."""
    return EdgeLimits().width if detector.threshold is None else float(detector.threshold)


def steps_of(edges, d=3):
    """The detector that cleans a cloud of d dimensions, None if nothing does, and the normal
    estimator."""
    # Both get one seed, drawn once, because a RandomState would give them two.
    seed = check_random_state(edges.random_state).randint(np.iinfo(np.int32).max)
    common = {"random_state": seed, "n_jobs": edges.n_jobs}
    cleaner, normals = edges.outlier_detector, edges.normal_estimator
    crease = edges.criterion == "crease"
    # A plane needs d + 1 members.
    size = max(int(EdgeLimits().of_planes * edges.n_neighbors), d + 1)
    if cleaner is None and crease:
        cleaner = MCMDOutlierDetector(size, strictness="groups", **common)
    elif cleaner is None:
        cleaner = MCMDOutlierDetector(strictness="surfaces", **common)
    if normals is None:
        normals = RobustNormalEstimator(
            size if crease else edges.n_neighbors,
            method="mcmd_z" if crease else "pca",
            success_probability=1.0 - EdgeLimits().luck,
            tangents=False,  # beside an edge they turn from one face to the other
            **common,
        )
    cleans = crease or edges.normals == "estimate"
    if not cleans or (isinstance(cleaner, str) and cleaner == "passthrough"):
        return None, _seeded(normals, seed)
    return _seeded(cleaner, seed), _seeded(normals, seed)


def _seeded(estimator, seed):
    """A copy of the estimator, with this seed if it takes one and has none."""
    estimator = clone(estimator)
    if estimator.get_params().get("random_state", seed) is None:
        estimator.set_params(random_state=seed)
    return estimator


def values_of(criterion, columns):
    """The values (n,) of a criterion at points whose planes have these `Columns`."""
    least = columns.eigenvalues[:, 0] if criterion == "eigenvalue" else columns.surface_variation
    return least.astype(np.float64)


def least_of_edge(parts, threshold, n_std):
    """The limit that a threshold means; it depends on neither the parts nor their order.

    ``parts()`` iterates over arrays, the values of a cloud.
    """
    if isinstance(threshold, Real):
        return float(threshold)
    if threshold == "mean":  # Eq. 25
        n = sum(len(values) for values in parts())
        mean = _sum(parts()) / n
        variance = _sum(np.square(values - mean) for values in parts()) / (n - 1)
        return mean + (EdgeLimits().paper_std if n_std is None else n_std) * sqrt(variance)
    usual = quantile_of(parts, 0.5)
    deviation = quantile_of(lambda: (np.abs(values - usual) for values in parts()), 0.5)
    n_std = EdgeLimits().robust_std if n_std is None else n_std
    return float(usual + n_std * MAD_TO_SD * deviation)


def _sum(parts):
    """The sum as if it were exact, and rounded once."""
    return fsum(chain.from_iterable(values.tolist() for values in parts))
