"""Weights of the points of a scan from what its instrument promises, and whether that holds."""

from numbers import Integral, Real
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import chdtri
from sklearn.utils.validation import check_array, check_consistent_length, column_or_1d

from sklearn_mcmd._sklearn import Interval, checked
from sklearn_mcmd.adjustment._base import PlaneDetector, check_points, place_of
from sklearn_mcmd.adjustment._robust import m_estimate

COUNT = [Interval(Integral, 1, None, closed="left")]
NOT_NEGATIVE = [Interval(Real, 0, None, closed="left")]
USUAL = 0.95  # share of the ratios of a class whose data hold that are within their interval


class ScanWeights(NamedTuple):
    """How precise the points of a scan are across their plane, as of `scan_weights`.

    Parameters
    ----------
    deviations : ndarray of shape (n_samples,)
        Standard deviation of each point along the normal, in units of X.
    weights : ndarray of shape (n_samples,)
        ``(sigma0 / deviations)^2``.
    sigma0 : float
        The median deviation, which is that of a point of weight 1.
    """

    deviations: NDArray[np.float64]
    weights: NDArray[np.float64]
    sigma0: float


class VarianceComponent(NamedTuple):
    """What the points of one class say of their standard deviation, as of `variance_components`.

    Parameters
    ----------
    low, high : float
        The least and the greatest value of the column.
    n_points : int
        Points of the class that pass.
    ratio : float
        Of their deviation over that which `sigma0` and the weights tell.
    usual : tuple of float
        Where 95 % of such ratios are if the weights hold.
    """

    low: float
    high: float
    n_points: int
    ratio: float
    usual: tuple[float, float]


@checked(range_error=NOT_NEGATIVE, range_ppm=NOT_NEGATIVE, angle_error=NOT_NEGATIVE)
def scan_weights(
    X: "ArrayLike",
    station: "ArrayLike",
    *,
    range_error: float,
    angle_error: float,
    range_ppm: float = 0.0,
    normal: "ArrayLike | None" = None,
) -> ScanWeights:
    """Standard deviations and weights of points from the errors of a range and two angles.

    A range errs along the ray, angles across it, by as much more as the range is longer. Across the
    plane each counts by its share: where a ray meets a wall slantwise, more by angles, less by the
    range.

    Parameters
    ----------
    X : array-like of shape (n_samples, 3)
        Points of a plane.
    station : array-like of shape (3,)
        Where the scanner stood, in the coordinates of X.
    range_error, angle_error : float
        Standard deviations of a range, in units of X, and of a direction across the ray, in
        degrees, as of both angles.
    range_ppm : float, default=0.0
        Part of the standard deviation of a range that grows with it, in millionths.
    normal : array-like of shape (3,), default=None
        Along which residuals are; ``[0, 0, 1]`` for a vertical surface. None takes that of the
        plane of Huber's M-estimation.

    Raises
    ------
    ValueError
        If a point is at the station, or no error is more than 0.

    Examples
    --------
    >>> import numpy as np
    >>> from sklearn_mcmd.adjustment import BaardaPlaneDetector, scan_weights
    >>> rng, station = np.random.default_rng(0), np.array([-3.0, -2.0, 1.2])
    >>> wall = rng.uniform((0, 0, 0), (4, 0, 2.5), (2_000, 3))
    >>> ranges = np.linalg.norm(wall - station, axis=1)
    >>> wall[:, 1] += rng.normal(size=2_000) * ranges * 0.0007
    >>> precision = scan_weights(wall, station, range_error=0, angle_error=0.04, range_ppm=700)
    >>> detector = BaardaPlaneDetector(sigma0="auto", surface="orthogonal")
    >>> n_flagged = (detector.fit_predict(wall, weights=precision.weights) == -1).sum()
    >>> print(f"{n_flagged} of 2000, {precision.deviations.max() / precision.sigma0:.1f}")
    0 of 2000, 1.4
    """
    points = check_array(X, dtype=np.float64)
    if points.shape[1] != 3:
        raise ValueError(f"X has {points.shape[1]} columns: a scan has 3 coordinates.")
    rays = points - place_of(station, 3, "station")
    ranges = np.linalg.norm(rays, axis=1)
    if not ranges.all():
        raise ValueError(f"X has a point at the station (row {ranges.argmin()}): leave it out.")
    if normal is None:
        normal = m_estimate(points, surface="orthogonal")[0].normal
    direction = place_of(normal, 3, "normal")
    if not (length := np.linalg.norm(direction)):
        raise ValueError("normal has no length: give a direction such as [0, 0, 1].")
    along = np.minimum((rays @ direction / (ranges * length)) ** 2, 1.0)
    of_range = range_error**2 + (1e-6 * range_ppm * ranges) ** 2
    of_angles = (np.radians(angle_error) * ranges) ** 2
    deviations = np.sqrt(along * of_range + (1 - along) * of_angles)
    if not deviations.all():
        raise ValueError(
            "range_error, range_ppm and angle_error leave points without an error across the plane "
            f"(row {deviations.argmin()}): give those of the instrument."
        )
    sigma0 = float(np.median(deviations))
    return ScanWeights(deviations, (sigma0 / deviations) ** 2, sigma0)


@checked(n_classes=COUNT, sigma0=[Interval(Real, 0, None, closed="neither"), None])
def variance_components(
    detector: PlaneDetector,
    X: "ArrayLike",
    by: "ArrayLike",
    *,
    sigma0: float | None = None,
    n_classes: int = 4,
) -> list[VarianceComponent]:
    """Whether points have the deviations that their weights tell, class by class of a column.

    The variance of a class is the sum of its weighted squares over that of its redundancy numbers
    (W. Foerstner, "Ein Verfahren zur Schaetzung von Varianz- und Kovarianzkomponenten", 1979, one
    step). Points that the tests reject are left out.

    Parameters
    ----------
    detector : BaardaPlaneDetector or FuzzyPlaneDetector
        Fitted to X.
    X : array-like of shape (n_samples, n_features)
        The training points; others raise a ValueError.
    by : array-like of shape (n_samples,)
        By which points are put in classes of as many each, such as ranges or intensities.
    sigma0 : float, default=None
        What a point of weight 1 is said to have, such as ``scan_weights(...).sigma0``. None takes
        ``detector.sigma0_``: an estimate tells then only how classes differ.
    n_classes : int, default=4

    Raises
    ------
    ValueError
        If X or `by` do not fit the detector, or `by` has values that are not finite.

    Examples
    --------
    >>> import numpy as np
    >>> from sklearn_mcmd.adjustment import BaardaPlaneDetector, variance_components
    >>> rng = np.random.default_rng(0)
    >>> X = np.column_stack([rng.uniform(0, 4, (2_000, 2)), np.zeros(2_000)])
    >>> X[:, 2] = rng.normal(size=2_000) * 0.001 * (1 + X[:, 0])
    >>> detector = BaardaPlaneDetector(sigma0="auto").fit(X)
    >>> for one in variance_components(detector, X, by=X[:, 0], n_classes=2):
    ...     print(f"{one.low:.0f} to {one.high:.0f}: {one.ratio:.2f} ({one.usual[0]:.2f} is usual)")
    0 to 2: 0.69 (0.96 is usual)
    2 to 4: 1.24 (0.96 is usual)
    """
    points, column = check_points(detector, X), column_or_1d(by, dtype=np.float64)
    check_consistent_length(points, column)
    check_array(column, ensure_2d=False, input_name="by")
    unit = detector.sigma0_ if sigma0 is None else sigma0
    passes = (detector.labels_ == 1) & detector.support_
    weights = detector._fitted.weights
    squares = detector.residuals(points) ** 2 * (1.0 if weights is None else weights)
    order = np.flatnonzero(passes)[np.argsort(column[passes], kind="stable")]
    components = []
    for rows in np.array_split(order, n_classes):
        redundancy = detector.redundancy_[rows].sum()
        if redundancy <= 0:
            continue
        ratio = np.sqrt(squares[rows].sum() / redundancy) / unit
        tails = (1 + USUAL) / 2, (1 - USUAL) / 2
        low, high = (float(np.sqrt(chdtri(redundancy, tail) / redundancy)) for tail in tails)
        values = column[rows]
        components.append(
            VarianceComponent(
                low=float(values.min()),
                high=float(values.max()),
                n_points=len(rows),
                ratio=float(ratio),
                usual=(low, high),
            )
        )
    return components
