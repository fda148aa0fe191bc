"""RobustNormalEstimator: normals, curvature and features, robust to outliers and edges."""

from collections.abc import Sequence
from numbers import Integral, Real
from typing import Any, ClassVar, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import TransformerMixin
from sklearn.utils.validation import check_is_fitted

from sklearn_mcmd._choices import RuleMethod, choices_of
from sklearn_mcmd._sklearn import Interval, StrOptions, check_feature_names_in, fit_context
from sklearn_mcmd.baselines._methods import COMPARATORS  # registers them
from sklearn_mcmd.normals._adaptive_k import sized_index
from sklearn_mcmd.normals._curvature import curvatures_of_fitted, curvatures_of_new
from sklearn_mcmd.normals._features import (
    FEATURES,
    check_features,
    evaluate_features,
    feature_columns,
    needs_curvatures,
)
from sklearn_mcmd.normals._rows import doubted, may_be_rows, warn_of_rows
from sklearn_mcmd.normals._sides import Sides
from sklearn_mcmd.normals._surface_planes import SurfacePlanes
from sklearn_mcmd.planes._base import BaseLocalPlanes, mends_planes
from sklearn_mcmd.planes._columns import column_names, joined_columns, plane_offsets
from sklearn_mcmd.planes._orientation import point_up
from sklearn_mcmd.planes._principal_planes import surface_variation
from sklearn_mcmd.planes._resolution import coordinate_steps, with_depths
from sklearn_mcmd.runtime._progress import progress_part

FINDING = 0.3  # share of the work that n_neighbors="auto" takes first


class RobustNormalEstimator(TransformerMixin, BaseLocalPlanes):
    """Normals and curvature of a point cloud that neither outliers nor edges tilt (Algorithm 4).

    The estimator removes outliers from the neighborhood of each point, as
    :class:`MCMDOutlierDetector` does. It fits a plane to the rest by principal components. A few
    wrong points do not tilt its normal. Next to an edge the normal is that of one face, and not
    the mean of two.

    Parameters
    ----------
    n_neighbors : int, "auto" or None, default=50
        Size of a neighborhood (k), at least ``n_features + 1``. A point of the fitted cloud
        is its own first neighbor. "auto" gives each point 16 to 256 neighbors, as many as it takes
        for the noise around it to tilt its normal by 2.5 degrees, unless the surface bends
        before, and for a row of a scan to be a third at most; see `n_neighbors_`. It is for 2D and
        3D. None means one neighborhood of all points.

    orientation : {"sensor", "mst"} or array-like of shape (n_features,), default=None
        Which of the two normals is taken:

        - None: the one whose last coordinate (z) is positive. Of upright faces noise decides;
        - "sensor": the one toward `sensor_origin`;
        - "mst": the one that agrees with the neighbors, along a minimum spanning tree from the
          highest point of each connected part, where the normal points up;
        - an array: the one on the side of that direction.

    sensor_origin : array-like of shape (n_features,), "origin" or None, default=None
        Where the sensor stood, for ``orientation="sensor"``, in units of X. "origin" is the
        origin of the coordinates. `fit` takes a position for each point. See :ref:`sensor`.

    features : "all", str or list of str, default=None
        Further columns of `transform`, in this order, from the cleaned neighborhoods with
        eigenvalues l_0 <= l_1 <= l_2 and their shares e_i of the sum:

        - "linearity", (l_2 - l_1) / l_2; "planarity", (l_1 - l_0) / l_2; both in 3D only;
        - "sphericity", l_0 / l_2; "anisotropy", (l_2 - l_0) / l_2;
        - "omnivariance", the geometric mean of the e_i; "eigenentropy", - sum e_i ln e_i;
        - "verticality", 1 - abs(n_z): 0 on a floor, 1 on a wall;
        - "roughness", distance of the point to its plane, in units of X;
        - "normal_error", as `normal_error_`; "removed_fraction", as `removed_fraction_`.

        And from a quadric over each plane, in 3D only; :ref:`curvatures` has units and signs:

        - "max_curvature", "min_curvature", "mean_curvature" and "gaussian_curvature";
        - "mean_curvature_error", "max_curvature_error" and "min_curvature_error", their standard
          errors;
        - "max_curvature_direction" and "min_curvature_direction", three columns each;
        - "shape_index", from -1 in a cup to 1 on a cap, 0 on a saddle and on a plane.

        "all" takes those that exist for ``n_features``.

    radius : float, default=None
        Largest distance of a neighbor, in units of X. A neighborhood then has this radius and
        `n_neighbors` points at most. A point with fewer than ``n_features + 1`` neighbors in it
        uses its nearest ``n_features + 1``.

    max_outlier_rate : float in [0, 1), default=0.5
        The largest share of outliers that a neighborhood must survive (epsilon in Eq. 13). It
        sets the number of trials that are drawn before neighbors are asked, not how many points
        are removed. Too small a rate risks planes through outliers.

    success_probability : float in (0, 1), default=0.9999
        Probability that at least one minimal subset has no outlier (P_r). It sets the number of
        trials, together with `max_outlier_rate`.

    support_fraction : float in (0, 1], default=0.5
        Share of a neighborhood that forms the consistent set. Where neighbors agree, all others
        may be off the plane that is kept.

    cutoff : float, default=None
        Robust distance beyond which a neighbor is removed. None means 2.5 for "mcmd_z" and 3.06
        in 3D for "mcmd_md", see :ref:`the defaults <cutoffs>`.

    method : {"mcmd_z", "mcmd_md", "pca", "ransac", "msac", "robpca", "ulsif", "qsp"}, \
            default="mcmd_z"
        How outliers of a neighborhood are found. "mcmd_z" takes robust z-scores (Algorithm 2),
        "mcmd_md" robust Mahalanobis distances (Algorithm 3). "pca" removes none: it is the
        common estimate, which is not robust. The others are the methods that the paper compares
        with.

    method_params : dict, default=None
        Parameters of the last five methods, see :class:`~sklearn_mcmd.baselines.Ransac` and
        the other classes there. "ulsif" and "qsp" need a ``"contamination"``. The parameters
        above, from `max_outlier_rate` on, and `reweight` belong to "mcmd_z" and "mcmd_md".

    reweight : bool, default=True
        Whether plane and scale are refitted twice before outliers are removed, and neighbors
        :ref:`agree on planes <agreement>`. None is removed if a plane and noise, or one smooth
        curved surface, explain all neighbors; the normal of the latter is that of the surface at
        the point. From four dimensions on, and with ``n_neighbors=None``, no neighbor is asked, and
        every point has its refitted plane. False is the paper's form.

    neighbor_planes : bool, default=True
        Whether a point next to an edge is given the plane of the neighbor that explains it and
        the points nearest to it best. Most of its own neighborhood may lie on the other face, or
        its own plane may run across both. Neighbors have agreed on planes before; there a point
        refits the plane that it takes, here it does not. Nothing is lent without `reweight`, or in
        more than three dimensions.

    tangents : bool, default=True
        Whether the normal is that of a quadric at the point where a surface bends. False leaves it
        the plane of all members; edges are sought between such planes, to which levels of a
        camera's depths are surfaces.

    random_state : int, RandomState instance or None, default=None
        Seed of the one table of trials that all neighborhoods use. It decides little where
        neighbors :ref:`agree on planes <agreement>`.

    n_jobs : int, default=None
        Number of threads. None means 1 unless in a :obj:`joblib.parallel_config` context, and
        -1 means all processors. Results do not depend on it.

    Attributes
    ----------
    normals_ : ndarray of shape (n_samples, n_features)
        Unit normals of the fitted points.

    surface_variation_ : ndarray of shape (n_samples,)
        Least eigenvalue over the sum of all, "curvature" in the paper (Eq. 3): 0 on a plane, at
        most 1 / n_features. Curvatures with a unit are among the `features`.

    eigenvalues_ : ndarray of shape (n_samples, n_features)
        Of the covariance of the cleaned neighborhoods, ascending, in squared units of X.

    removed_fraction_ : ndarray of shape (n_samples,)
        Share of each neighborhood that was removed as outliers.

    normal_error_ : ndarray of shape (n_samples,)
        Standard error of each normal, in degrees: root mean square of its tilt from the noise of
        its plane or, on a surface that bends, quadric; and the doubt which plane around is right,
        and whether the surface goes on as its fit says, where planes are mended (see
        :ref:`errors of normals <errors_of_normals>`). Where neighbors lie in one row of a scan, it
        is the angle to the plane of four times as many, if that is more; where they lie on one
        level of a camera's depths, it holds the tilt that this hides. The true normal is within
        1.73 times that with 95 % confidence (in 3D; 1.96 times in 2D). 90 where nothing determines
        the normal.

    plane_offset_ : ndarray of shape (n_samples,)
        Signed distance of each point's plane from the point, along its normal, in units of X.

    plane_scale_ : ndarray of shape (n_samples,)
        Standard deviation of each plane's neighbors from it, in units of X: noise, and the bend
        of a curved surface within the neighborhood.

    features_ : ndarray of shape (n_samples, n_chosen)
        The columns asked for by `features`, one each but three for a direction.

    plane_index_ : ndarray of int of shape (n_samples,)
        The row whose plane each point was given: its own, or that of the neighbor that lent it.

    n_neighbors_, n_support_ : int or ndarray of int of shape (n_samples,)
        Size of a neighborhood and of a consistent set; an array with ``n_neighbors="auto"``.

    n_trials_ : int
        Minimal subsets tried in each neighborhood that has more than noise, before neighbors are
        asked.

    n_features_in_ : int
        Number of features seen during `fit`.

    feature_names_in_ : ndarray of shape (`n_features_in_`,)
        Names of features seen during `fit`, when X has names that are all strings.

    See Also
    --------
    MCMDOutlierDetector : Outliers by the same planes.
    sklearn_mcmd.baselines.PlaneOutlierDetector : Outliers by the methods compared with.
    sklearn.decomposition.PCA : Of all points at once; of neighbors it is Open3D's
        ``estimate_normals`` and PDAL's ``filters.normal``.

    Notes
    -----
    A collinear neighborhood has no normal. Its point gets the perpendicular of the line that is
    nearest to the last axis, or that axis itself if all neighbors coincide. There
    ``eigenvalues_[:, 1]`` is zero.

    The error of a normal takes the surface for a plane or a quadric, and noise for independent from
    point to point. With ``reweight=False`` the scale and the error are too small.

    The time grows as ``n_samples * n_neighbors * (n_trials_ + n_neighbors)``, since each point may
    try the planes of all its neighbors, and as ``n_samples * log(n_samples)`` for the search.

    Features follow [3]_. jakteristics does not divide by the sum of the eigenvalues in
    "omnivariance" and "eigenentropy", which then depend on the unit. Curvatures are those of the
    osculating jet of degree 2 [4]_. Where the neighbors do not determine it, curvatures and
    directions are 0, and the errors are one over the radius of the neighborhood.

    References
    ----------
    .. [1] A. Nurunnabi, G. West, D. Belton, "Outlier detection and robust normal-curvature
       estimation in mobile laser scanning 3D point cloud data", Pattern Recognition 48
       (2015) 1404-1419, Algorithm 4.
    .. [2] H. Hoppe et al., "Surface reconstruction from unorganized points", SIGGRAPH 1992,
       for ``orientation="mst"``.
    .. [3] M. Weinmann, B. Jutzi, S. Hinz, C. Mallet, "Semantic point cloud interpretation
       based on optimal neighborhoods, relevant features and efficient classifiers", ISPRS
       Journal of Photogrammetry and Remote Sensing 105 (2015) 286-304, for `features`.
    .. [4] F. Cazals, M. Pouget, "Estimating differential quantities using polynomial fitting of
       osculating jets", Computer Aided Geometric Design 22 (2005) 121-146.

    Examples
    --------
    >>> import numpy as np
    >>> from sklearn_mcmd import RobustNormalEstimator
    >>> rng = np.random.default_rng(0)
    >>> floor = rng.uniform(0, 1, (200, 3)) * [1, 1, 0] + rng.normal(0, 0.002, (200, 3))
    >>> floor[:20, 2] += 0.2  # leaves on the floor
    >>> for method in ("pca", "mcmd_z"):
    ...     estimator = RobustNormalEstimator(30, method=method, random_state=0).fit(floor)
    ...     tilt = np.degrees(np.arccos(estimator.normals_[20:, 2]))
    ...     print(f"{method}: {np.median(tilt):.1f} degrees")
    pca: 2.9 degrees
    mcmd_z: 0.2 degrees

    How well each normal is known, and features for a classifier:

    >>> estimator = RobustNormalEstimator(30, features=["planarity", "roughness"], random_state=0)
    >>> columns = estimator.fit_transform(floor)
    >>> print(f"standard error {np.median(estimator.normal_error_[20:]):.2f} degrees")
    standard error 0.37 degrees
    >>> estimator.get_feature_names_out()[-2:]
    array(['planarity', 'roughness'], dtype=object)
    >>> print(f"leaves {columns[:20, -1].mean():.2f}, floor {columns[20:, -1].mean():.4f}")
    leaves 0.20, floor 0.0015
    """

    _parameter_constraints: ClassVar[dict] = {
        **BaseLocalPlanes._parameter_constraints,
        "n_neighbors": [Interval(Integral, 2, None, closed="left"), StrOptions({"auto"}), None],
        "method": [StrOptions({*choices_of(RuleMethod), *COMPARATORS})],
        "method_params": [dict, None],
        "neighbor_planes": ["boolean"],
        "tangents": ["boolean"],
        "radius": [Interval(Real, 0, None, closed="neither"), None],
        "orientation": [StrOptions({"sensor", "mst"}), "array-like", None],
        "sensor_origin": ["array-like", StrOptions({"origin"}), None],
        "features": [StrOptions({"all", *FEATURES}), "array-like", None],
    }
    _small_faces: ClassVar = True

    def __init__(
        self,
        n_neighbors: int | Literal["auto"] | None = 50,
        *,
        method: str = "mcmd_z",
        method_params: dict[str, Any] | None = None,
        support_fraction: float = 0.5,
        max_outlier_rate: float = 0.5,
        success_probability: float = 0.9999,
        cutoff: float | None = None,
        reweight: bool = True,
        neighbor_planes: bool = True,
        tangents: bool = True,
        radius: float | None = None,
        orientation: 'Literal["sensor", "mst"] | ArrayLike | None' = None,
        sensor_origin: 'ArrayLike | Literal["origin"] | None' = None,
        features: str | Sequence[str] | None = None,
        random_state: int | np.random.RandomState | None = None,
        n_jobs: int | None = None,
    ) -> None:
        self.n_neighbors = n_neighbors
        self.method = method
        self.method_params = method_params
        self.support_fraction = support_fraction
        self.max_outlier_rate = max_outlier_rate
        self.success_probability = success_probability
        self.cutoff = cutoff
        self.reweight = reweight
        self.neighbor_planes = neighbor_planes
        self.tangents = tangents
        self.radius = radius
        self.orientation = orientation
        self.sensor_origin = sensor_origin
        self.features = features
        self.random_state = random_state
        self.n_jobs = n_jobs

    @fit_context(prefer_skip_nested_validation=True)
    def fit(
        self,
        X: "ArrayLike",
        y: object = None,
        sensor_origin: 'ArrayLike | Literal["origin"] | None' = None,
    ) -> Self:
        """Estimate the normals of a cloud.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)
            Coordinates, float64 or float32, in any unit; at least two features and
            ``n_features + 1`` points.
        y : Ignored
        sensor_origin : array-like of shape (n_features,) or (n_samples, n_features), or "origin"
            Where the sensor stood, for each point where it moved; in place of the parameter. A
            pipeline passes it on after ``set_fit_request(sensor_origin=True)``.

        Returns
        -------
        self : object

        Raises
        ------
        ValueError
            If X has NaN, infinite or too few values, or if parameters do not fit it or each other.

        Warns
        -----
        UserWarning
            If the neighbors of 2 % of the points or more lie in one row of a scan.
        """
        if self.n_neighbors is None and self.radius is not None:
            raise ValueError(
                f"radius={self.radius} has no meaning with n_neighbors=None, one neighborhood of "
                "all points; give a number of neighbors."
            )
        xyz = self._fit_planes(X, self.radius, self.cutoff)
        origin = self.sensor_origin if sensor_origin is None else sensor_origin
        self._sides = Sides(self.orientation, origin, xyz)
        self._feature_names = check_features(self.features, xyz.shape[1])
        self._surfaces = None
        with self._part_of_planes():
            if mends_planes(self) and xyz.shape[1] <= 3:
                surfaces = SurfacePlanes(self, self._model)
                planes, self.plane_index_, self._surfaces = surfaces.fit(xyz, self.n_jobs)
            else:
                with progress_part(0.0, 1.0, "normals"):
                    planes, _ = self._model.evaluate_fitted(xyz, n_jobs=self.n_jobs)
                self.plane_index_ = np.arange(len(xyz))

        planes = with_depths(planes, self._model.settings.steps)
        if xyz.shape[1] == 3 and may_be_rows(self):
            planes = doubted(planes, xyz, self._model.index, self.n_jobs)
            warn_of_rows(self._model.index)
        self._fill(planes, xyz)
        return self

    def fit_transform(
        self,
        X: "ArrayLike",
        y: object = None,
        sensor_origin: 'ArrayLike | Literal["origin"] | None' = None,
    ) -> NDArray[np.floating]:
        """Estimate the normals of a cloud and return them beside the coordinates.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)
        y : Ignored
        sensor_origin : array-like or "origin"
            As in `fit`.

        Returns
        -------
        X_out : ndarray of shape (n_samples, 3 * n_features + 3 + n_chosen)
            As by `transform`.
        """
        xyz = self.fit(X, sensor_origin=sensor_origin)._check_queries(X)
        offset, scale = self.plane_offset_[:, None], self.plane_scale_[:, None]
        return joined_columns(xyz, self.normals_, self.eigenvalues_, offset, scale, self.features_)

    def transform(self, X: "ArrayLike") -> NDArray[np.floating]:
        """Normals and curvature at points, by their neighborhoods in the fitted cloud.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)
            If the sensor moved, each counts as measured from where the nearest of the fitted
            points was.

        Returns
        -------
        X_out : ndarray of shape (n_samples, 3 * n_features + 3 + n_chosen)
            Coordinates, normals, surface variation, eigenvalues, offset and scale of the planes
            and the chosen `features`, named by `get_feature_names_out`, in the dtype of X.
        """
        check_is_fitted(self)
        xyz = self._check_queries(X)
        with self._part_of_planes():
            if self._surfaces is not None:
                planes = self._surfaces.evaluate(xyz, self.n_jobs)
            else:
                planes, _ = self._model.evaluate(xyz, n_jobs=self.n_jobs)
        planes = with_depths(planes, self._model.settings.steps)
        if xyz.shape[1] == 3 and may_be_rows(self):
            planes = doubted(planes, xyz, self._model.index, self.n_jobs)
        normals = point_up(planes.normals)
        self._sides.orient(self._model.index, normals, xyz, self.n_jobs)
        features = self._evaluate_features(planes, normals, xyz, curvatures_of_new)
        offset = plane_offsets(planes, normals, xyz)
        return joined_columns(
            xyz, normals, planes.eigenvalues, offset[:, None], planes.scale[:, None], features
        )

    def get_feature_names_out(
        self, input_features: Sequence[str] | None = None
    ) -> NDArray[np.object_]:
        """Names of the columns of `transform`.

        Parameters
        ----------
        input_features : array-like of str, default=None
            Names of the coordinates; by default those seen in `fit`, or x0, x1, ...

        Returns
        -------
        names : ndarray of str objects
            The coordinates' names, the same names after ``normal_``, ``surface_variation``,
            ``eigenvalue_0`` (the least) and so on, ``plane_offset``, ``plane_scale``, and the names
            of `features`. A direction has a column for each coordinate, such as
            ``max_curvature_direction_x0``.
        """
        check_is_fitted(self, "n_features_in_")
        names = check_feature_names_in(self, input_features)
        return column_names(names, feature_columns(self._feature_names, names))

    def __sklearn_tags__(self):
        tags = super().__sklearn_tags__()
        tags.transformer_tags.preserves_dtype = ["float64", "float32"]
        return tags

    def _steps(self, X):
        # Edges are sought between planes of faces, as if levels of depths were surfaces.
        return coordinate_steps(X) if self.tangents else super()._steps(X)

    def _fill(self, planes, X):
        """Fill what is public of the fitted points X (n, d)."""
        self.normals_ = point_up(planes.normals)
        self.eigenvalues_ = planes.eigenvalues
        self.surface_variation_ = surface_variation(planes.eigenvalues)
        self.removed_fraction_ = 1.0 - planes.kept
        self.normal_error_ = planes.normal_error
        self._sides.fit(self._model.index, self.normals_, X, self.n_jobs)
        self.features_ = self._evaluate_features(planes, self.normals_, X, curvatures_of_fitted)
        self.plane_offset_ = plane_offsets(planes, self.normals_, X)
        self.plane_scale_ = planes.scale

    def _make_index(self, xyz, radius):
        if self.n_neighbors != "auto":
            return super()._make_index(xyz, radius)
        if xyz.shape[1] > 3:
            raise ValueError(
                'n_neighbors="auto" is for points in 2D and 3D, and X has '
                f"{xyz.shape[1]} features; give a number of neighbors, such as 50."
            )
        with progress_part(0.0, FINDING, "sizes of neighborhoods"):
            return sized_index(xyz, self._steps(xyz), radius, self.n_jobs)

    def _part_of_planes(self):
        """The part of the work that comes before the curvatures."""
        first = FINDING if self.n_neighbors == "auto" else 0.0
        return progress_part(first, 0.9 if needs_curvatures(self._feature_names) else 1.0)

    def _evaluate_features(self, planes, normals, X, find_curvatures):
        curvatures = None
        if needs_curvatures(self._feature_names):
            planes = planes._replace(normals=normals)
            with progress_part(0.9, 1.0, "curvatures"):
                curvatures = find_curvatures(self._model, planes, X, self.n_jobs)
        return evaluate_features(self._feature_names, planes, X, curvatures)
