"""The contaminated plane of the paper's Section 5.1."""

from numbers import Integral, Real
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.utils import Bunch, check_random_state

from sklearn_mcmd._sklearn import Interval, StrOptions, validate_params


@validate_params(
    {
        "n_samples": [Interval(Integral, 1, None, closed="left")],
        "outlier_share": [Interval(Real, 0, 1, closed="both")],
        "outliers": [StrOptions({"clustered", "uniform"})],
        "regular_mean": ["array-like"],
        "regular_variances": ["array-like"],
        "outlier_mean": ["array-like"],
        "outlier_variances": ["array-like"],
        "uniform_range": ["array-like"],
        "shuffle": ["boolean"],
        "return_X_y": ["boolean"],
        "random_state": ["random_state"],
    },
    prefer_skip_nested_validation=True,
)
def make_contaminated_plane(
    n_samples: int = 50,
    *,
    outlier_share: float = 0.2,
    outliers: Literal["clustered", "uniform"] = "clustered",
    regular_mean: ArrayLike = (2.0, 2.0, 2.0),
    regular_variances: ArrayLike = (6.0, 6.0, 0.01),
    outlier_mean: ArrayLike = (7.0, 6.0, 8.0),
    outlier_variances: ArrayLike = (2.0, 2.0, 1.5),
    uniform_range: tuple[float, float] = (-9.0, 9.0),
    shuffle: bool = False,
    return_X_y: bool = True,
    random_state: int | np.random.RandomState | None = None,
) -> Bunch | tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Make a noisy plane with clustered or uniform outliers (Section 5.1).

    Regular points are Gaussian with one small variance, across the plane. Outliers then replace
    the last ``round(outlier_share * n_samples)`` of them: a second Gaussian off the plane (Fig. 3a)
    or a uniform cube around it (Fig. 3d). The cloud before the replacement is the *clean twin*.
    Table 1 compares with it: its bias angle lies between the planes that one method fits to both.

    Parameters
    ----------
    n_samples : int, default=50
        Number of points, outliers included.
    outlier_share : float, default=0.2
        Share of outliers in [0, 1]; the number is rounded to the nearest integer.
    outliers : {"clustered", "uniform"}, default="clustered"
        Distribution of the outliers.
    regular_mean : array-like of shape (n_features,), default=(2, 2, 2)
        Mean of the regular points. Its length sets the number of dimensions.
    regular_variances : array-like of shape (n_features,), default=(6, 6, 0.01)
        Variances (not standard deviations) of the regular points along the axes. The axis of
        the least one is the plane's normal.
    outlier_mean, outlier_variances : array-like of shape (n_features,)
        Mean, by default (7, 6, 8), and variances, by default (2, 2, 1.5), of clustered outliers.
    uniform_range : (float, float), default=(-9, 9)
        Range of uniform outliers on every axis.
    shuffle : bool, default=False
        Whether to shuffle the rows. Otherwise the outliers come last.
    return_X_y : bool, default=True
        If False, return a Bunch that also holds the clean twin and the plane's normal.
    random_state : int, RandomState instance or None, default=None
        Seed. The same seed gives the same regular points for every `outlier_share`.

    Returns
    -------
    (X, y) : tuple if ``return_X_y=True``
        `X` is float64 of shape (n_samples, n_features). `y` is int64 of shape (n_samples,), +1
        for regular points and -1 for outliers, as scikit-learn's outlier detectors have it.
    dataset : :class:`~sklearn.utils.Bunch` if ``return_X_y=False``
        ``data`` and ``target`` are `X` and `y`. ``clean``, of the shape of `X`, is the clean twin;
        its rows equal those of `X` where ``target == 1``. ``normal``, of shape (n_features,), is
        the true plane's unit normal. ``feature_names`` is a list of str.

    Raises
    ------
    ValueError
        If means and variances differ in length, a variance is negative, no single axis has the
        least regular variance, or `uniform_range` is not increasing.

    See Also
    --------
    make_street : A whole street with four kinds of outliers.
    sklearn.datasets.make_blobs : Isotropic Gaussian clusters.

    Notes
    -----
    Section 5.1 calls (6, 6, 0.01) variances, and they are. Read as standard deviations, they give
    PCA a bias angle of 12 degrees, where Table 1 prints 34. Table 2 varies the first two variances
    of both distributions, Fig. 7c the third variance of the regular points.

    References
    ----------
    .. [1] Nurunnabi, West, Belton, "Outlier detection and robust normal-curvature estimation
       in mobile laser scanning 3D point cloud data", Pattern Recognition 48 (2015), Section 5.1.

    Examples
    --------
    >>> from sklearn_mcmd.datasets import make_contaminated_plane
    >>> X, y = make_contaminated_plane(n_samples=50, outlier_share=0.2, random_state=0)
    >>> X.shape, int((y == -1).sum())
    ((50, 3), 10)
    >>> cloud = make_contaminated_plane(return_X_y=False, random_state=0)
    >>> cloud.normal
    array([0., 0., 1.])
    >>> int((cloud.clean != cloud.data).any(axis=1).sum())
    10
    """
    center, scale = _gaussian(regular_mean, regular_variances, "regular")
    least = scale == scale.min()
    if least.sum() > 1:
        raise ValueError(
            f"regular_variances={(scale**2).tolist()} has no single least value, so the plane "
            "has no normal: make one variance smaller than the others."
        )
    low_high = np.asarray(uniform_range, float)
    if low_high.shape != (2,) or not np.isfinite(low_high).all() or low_high[0] >= low_high[1]:
        raise ValueError(
            f"uniform_range={low_high.tolist()} must be two increasing finite numbers."
        )
    if outliers == "clustered":
        outlier_center, outlier_scale = _gaussian(outlier_mean, outlier_variances, "outlier")
        if outlier_center.shape != center.shape:
            raise ValueError(
                f"outlier_mean has {outlier_center.size} coordinates and regular_mean "
                f"{center.size}: both need the same number."
            )

    rng = check_random_state(random_state)
    clean = center + scale * rng.standard_normal((n_samples, center.size))
    n_outliers = round(outlier_share * n_samples)
    shape = (n_outliers, center.size)
    if outliers == "clustered":
        intruders = outlier_center + outlier_scale * rng.standard_normal(shape)
    else:
        intruders = rng.uniform(*low_high, shape)
    data = np.concatenate([clean[: n_samples - n_outliers], intruders])
    target = np.repeat([1, -1], [n_samples - n_outliers, n_outliers])
    if shuffle:
        order = rng.permutation(n_samples)
        data, clean, target = data[order], clean[order], target[order]
    if return_X_y:
        return data, target
    names = list("xyz") if center.size == 3 else [f"x{i}" for i in range(center.size)]
    return Bunch(
        data=data, target=target, clean=clean, normal=least.astype(float), feature_names=names
    )


def _gaussian(mean, variances, kind):
    """Mean and standard deviations of one of the two Gaussian distributions."""
    mean, variances = np.asarray(mean, float), np.asarray(variances, float)
    if mean.ndim != 1 or mean.shape != variances.shape or mean.size < 2:
        raise ValueError(
            f"{kind}_mean has shape {mean.shape} and {kind}_variances {variances.shape}: give "
            "both as many coordinates, two at least."
        )
    if not np.isfinite(mean).all():
        raise ValueError(f"{kind}_mean={mean.tolist()} must be finite.")
    if not (np.isfinite(variances).all() and (variances >= 0).all()):
        raise ValueError(f"{kind}_variances={variances.tolist()} must be finite and not negative.")
    return mean, np.sqrt(variances)
