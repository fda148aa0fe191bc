"""PlaneOutlierDetector: the comparators as one outlier detector."""

from numbers import Real
from typing import Any, ClassVar, Literal, Self

import numpy as np
from numpy.typing import ArrayLike

from sklearn_mcmd._sklearn import Interval, StrOptions, fit_context
from sklearn_mcmd.baselines._methods import COMPARATORS
from sklearn_mcmd.planes._base import BasePlaneOutliers, model_of
from sklearn_mcmd.planes._rules import comparator_of


class PlaneOutlierDetector(BasePlaneOutliers):
    """Outliers of local neighborhoods by the methods that MCMD is compared with.

    The detector judges each point in the neighborhood of its nearest points: by its distance to
    the neighborhood's plane ("pca", "ransac", "msac"), by its robust Mahalanobis or orthogonal
    distance ("robpca"), by the ratio of the densities of regular and of all points ("ulsif"),
    or by its distance to a small random sample ("qsp").

    Parameters
    ----------
    n_neighbors : int or None, default=50
        Size of a neighborhood, at least ``n_features + 1``; a point of the fitted cloud is its
        own first neighbor. None means one neighborhood of all points.

    method : {"msac", "pca", "qsp", "ransac", "robpca", "ulsif"}, default="ransac"
        How neighborhoods are judged.

    method_params : dict, default=None
        Parameters of the method, see :class:`~sklearn_mcmd.baselines.Ransac`,
        :class:`~sklearn_mcmd.baselines.Msac`, :class:`~sklearn_mcmd.baselines.Pca`,
        :class:`~sklearn_mcmd.baselines.Robpca`, :class:`~sklearn_mcmd.baselines.Ulsif` and
        :class:`~sklearn_mcmd.baselines.Qsp`. Give the `contamination` of the last two to this
        class.

    contamination : "auto" or float in (0, 0.5], default="auto"
        Share of the fitted points that is flagged. "auto" means the method's own cut-off;
        "ulsif" and "qsp" have none and need a share.

    random_state : int, RandomState instance or None, default=None
        Seed of the one table of random positions that all neighborhoods use.

    n_jobs : int, default=None
        Number of threads. None means 1 unless in a :obj:`joblib.parallel_config` context, and
        -1 means all processors. Results do not depend on it.

    Attributes
    ----------
    labels_ : ndarray of int of shape (n_samples,)
        1 for the fitted points that are inliers, and -1 for outliers: as `fit_predict` returns.

    offset_ : float
        ``decision_function = score_samples - offset_``: the negative cut-off, or the quantile
        of the fitted points' scores that `contamination` asks for.

    scores_ : ndarray of shape (n_samples,)
        ``score_samples`` of the fitted points.

    n_neighbors_ : int
        Size of a neighborhood: `n_neighbors`, or the number of samples if that is smaller.

    n_features_in_, feature_names_in_ : int and ndarray of str of shape (`n_features_in_`,)
        Number of features seen during `fit`, and their names, if all are strings.

    See Also
    --------
    sklearn_mcmd.MCMDOutlierDetector : Outliers by maximum consistency.
    sklearn_mcmd.RobustNormalEstimator : Normals by the same methods.
    sklearn.linear_model.RANSACRegressor : RANSAC for one regression, with vertical distances.
    sklearn.covariance.EllipticEnvelope : The MCD of all points at once.

    Notes
    -----
    New points are scored against the fitted cloud, by their own neighborhoods in it, so
    ``fit_predict(X)`` equals ``fit(X).predict(X)``.

    "ransac" and "msac" take a few times as long as MCMD, and "robpca" and "ulsif" about a hundred
    times as long.

    Examples
    --------
    >>> import numpy as np
    >>> from sklearn_mcmd.baselines import PlaneOutlierDetector
    >>> rng = np.random.default_rng(0)
    >>> wall = rng.uniform(0, 2, (40, 3)) * [1, 0, 1] + rng.normal(0, 0.004, (40, 3))
    >>> car = [[0.5, -0.8, 0.4], [0.6, -0.8, 0.4], [0.5, -0.8, 0.5], [0.6, -0.8, 0.5]]
    >>> X = np.vstack([wall, car])
    >>> for method in ("pca", "ransac", "robpca"):
    ...     labels = PlaneOutlierDetector(30, method=method, random_state=0).fit_predict(X)
    ...     print(f"{method}: {np.sum(labels[:40] == -1)} of 40 wall points swamped, "
    ...           f"{np.sum(labels[40:] == -1)} of 4 car points found")
    pca: 0 of 40 wall points swamped, 0 of 4 car points found
    ransac: 0 of 40 wall points swamped, 4 of 4 car points found
    robpca: 0 of 40 wall points swamped, 4 of 4 car points found
    """

    _parameter_constraints: ClassVar[dict] = {
        name: BasePlaneOutliers._parameter_constraints[name]
        for name in ("n_neighbors", "random_state", "n_jobs")
    } | {
        "method": [StrOptions(set(COMPARATORS))],
        "method_params": [dict, None],
        "contamination": [StrOptions({"auto"}), Interval(Real, 0, 0.5, closed="right")],
    }

    def __init__(
        self,
        n_neighbors: int | None = 50,
        *,
        method: str = "ransac",
        method_params: dict[str, Any] | None = None,
        contamination: float | Literal["auto"] = "auto",
        random_state: int | np.random.RandomState | None = None,
        n_jobs: int | None = None,
    ) -> None:
        self.n_neighbors = n_neighbors
        self.method = method
        self.method_params = method_params
        self.contamination = contamination
        self.random_state = random_state
        self.n_jobs = n_jobs

    @fit_context(prefer_skip_nested_validation=True)
    def fit(self, X: "ArrayLike", y: object = None) -> Self:
        """Judge the points of a cloud, and keep what new points are scored against.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)
            Coordinates, float64 or float32, in any unit; at least two features and
            ``n_features + 1`` points.
        y : Ignored

        Returns
        -------
        self : object

        Raises
        ------
        ValueError
            If X has NaN, infinite or too few values, `n_neighbors` is too small, `method_params`
            has an unknown name or a value out of its range, or the method needs a share.
        """
        comparator = comparator_of(self.method, self.method_params)
        if getattr(comparator, "contamination", None) is not None:
            raise ValueError(
                "method_params has 'contamination'; give it as contamination="
                f"{comparator.contamination} to the detector."
            )
        if self.contamination == "auto" and not comparator.has_cutoff:
            raise ValueError(
                f"contamination='auto' but method={self.method!r} has no cut-off of its own: give "
                "the share of outliers, such as contamination=0.1."
            )
        xyz, index = self._index_cloud(X)
        precision, steps = np.finfo(xyz.dtype).eps, self._steps(xyz)
        shape = xyz.shape
        self._model = model_of(self, index, shape, precision, steps, comparator=comparator)
        self.scores_ = -self._score(xyz)
        if self.contamination == "auto":
            self.offset_ = -comparator.usual_cutoff(self.n_neighbors_, xyz.shape[1])
        else:
            self.offset_ = float(np.percentile(self.scores_, 100 * self.contamination))
        return self

    def _score(self, X):
        return np.minimum(self._model.evaluate(X, n_jobs=self.n_jobs)[1], np.finfo(float).max)
