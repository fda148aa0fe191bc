"""The contaminated plane of the paper's Section 5.1."""

from numbers import Integral, Real
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.utils import Bunch, check_random_state

from sklearn_mcmd._sklearn import Interval, checked

_REGULAR_MEAN, _OUTLIER_MEAN = np.full(3, 2.0), np.array([7.0, 6.0, 8.0])
_REACH = 9.0  # of uniform outliers to both sides of the origin, on every axis


@checked(
    n_samples=[Interval(Integral, 1, None, closed="left")],
    outlier_share=[Interval(Real, 0, 1, closed="both")],
    regular_variances=["array-like"],
    outlier_variances=["array-like"],
)
def make_contaminated_plane(
    n_samples: int = 50,
    *,
    outlier_share: float = 0.2,
    outliers: Literal["clustered", "uniform"] = "clustered",
    regular_variances: "ArrayLike" = (6.0, 6.0, 0.01),
    outlier_variances: "ArrayLike" = (2.0, 2.0, 1.5),
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
    regular_variances : array-like of shape (3,), default=(6, 6, 0.01)
        Variances (not standard deviations) of the regular points along the axes, about (2, 2, 2).
        The axis of the least one is the plane's normal.
    outlier_variances : array-like of shape (3,), default=(2, 2, 1.5)
        Variances of clustered outliers, about (7, 6, 8). Uniform ones lie between -9 and 9.
    return_X_y : bool, default=True
        If False, return a Bunch that also holds the clean twin and the plane's normal.
    random_state : int, RandomState instance or None, default=None
        Seed. The same seed gives the same regular points for every `outlier_share`.

    Returns
    -------
    (X, y) : tuple if ``return_X_y=True``
        `X` is float64 of shape (n_samples, 3). `y` is int64 of shape (n_samples,), +1
        for regular points and -1 for outliers, as scikit-learn's outlier detectors have it.
    dataset : :class:`~sklearn.utils.Bunch` if ``return_X_y=False``
        ``data`` and ``target`` are `X` and `y`. ``clean``, of the shape of `X`, is the clean twin;
        its rows equal those of `X` where ``target == 1``. ``normal``, of shape (3,), is
        the true plane's unit normal.

    Raises
    ------
    ValueError
        If variances are not three, one is negative, or no single axis has the least regular one.

    See Also
    --------
    make_street : A whole street with four kinds of outliers.
    sklearn.datasets.make_blobs : Isotropic Gaussian clusters.

    Notes
    -----
    Table 2 varies the first two variances of both distributions, Fig. 7c the third variance of the
    regular points. :doc:`/reproduction` says why they are variances.

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
    scale = _deviations(regular_variances, "regular")
    least = scale == scale.min()
    if least.sum() > 1:
        raise ValueError(f"regular_variances={(scale**2).tolist()}: one must be the least.")
    outlier_scale = _deviations(outlier_variances, "outlier")
    rng = check_random_state(random_state)
    clean = _REGULAR_MEAN + scale * rng.standard_normal((n_samples, 3))
    n_outliers = round(outlier_share * n_samples)
    if outliers == "clustered":
        intruders = _OUTLIER_MEAN + outlier_scale * rng.standard_normal((n_outliers, 3))
    else:
        intruders = rng.uniform(-_REACH, _REACH, (n_outliers, 3))
    data = np.concatenate([clean[: n_samples - n_outliers], intruders])
    target = np.repeat([1, -1], [n_samples - n_outliers, n_outliers])
    if return_X_y:
        return data, target
    return Bunch(data=data, target=target, clean=clean, normal=least.astype(float))


def _deviations(variances, kind):
    """Standard deviations along the axes."""
    variances = np.asarray(variances, float)
    if variances.shape != (3,) or not (np.isfinite(variances) & (variances >= 0)).all():
        raise ValueError(f"{kind}_variances={variances.tolist()}: three are needed, not negative.")
    return np.sqrt(variances)
