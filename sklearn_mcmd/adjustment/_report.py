"""A report of a fitted plane test for a surveyor's files, as text."""

import numpy as np
from numpy.typing import ArrayLike

from sklearn_mcmd._errors import counted
from sklearn_mcmd._sklearn import validate_params
from sklearn_mcmd.adjustment._base import N_WORST, PlaneDetector, check_points
from sklearn_mcmd.adjustment._comparison import PlaneComparison
from sklearn_mcmd.adjustment._flatness import PlaneFlatness
from sklearn_mcmd.adjustment._report_lines import (
    comparison_rows,
    flatness_rows,
    precision_rows,
    reliability_rows,
    rows_of,
    usual_reliability,
    with_heading,
)

__all__ = [
    "describe",
    "global_test_row",
    "normal_row",
    "point_row",
    "share",
    "sigma0_origin",
    "sign_of_residuals",
    "text_report",
    "tilt",
]

LEAST_ERROR = 1e-9  # the least standard error that is told


@validate_params(N_WORST, prefer_skip_nested_validation=True)
def text_report(
    detector: PlaneDetector,
    X: ArrayLike,
    *,
    title: str = "Plane test",
    unit: str = "",
    n_worst: int = 10,
    comparison: PlaneComparison | None = None,
    flatness: PlaneFlatness | None = None,
) -> str:
    """Plane, precision, reliability and the worst points of a fitted detector, as text.

    Parameters
    ----------
    detector : BaardaPlaneDetector or FuzzyPlaneDetector
        Fitted to X.
    X : array-like of shape (n_samples, n_features)
        The training points.
    title : str, default="Plane test"
    unit : str, default=""
        Unit of X, for example "m"; only printed.
    n_worst : int, default=10
        Number of points to list, those with the largest test statistics.
    comparison : PlaneComparison, default=None
        With another plane, by `compare_planes`.
    flatness : PlaneFlatness, default=None
        Of these points, by :func:`flatness`.

    Returns
    -------
    str

    Raises
    ------
    ValueError
        If the detector was fitted to other points than X.

    Examples
    --------
    >>> import numpy as np
    >>> from sklearn_mcmd.adjustment import BaardaPlaneDetector, text_report
    >>> X = np.array([[0.0, 0], [1, 1], [2, 2], [3, 9], [4, 4], [5, 5], [6, 6]])
    >>> print(text_report(BaardaPlaneDetector().fit(X), X, n_worst=1))
    Plane test
    ==========
    ...
    outliers              1 of 7 (14.29 %)
    ...
    """
    X = check_points(detector, X)
    residuals, outliers = detector.residuals(X), detector.labels_ == -1
    reliability = usual_reliability(detector, X, n_worst)
    suffix, squared = (f" {unit}", f" {unit}^2") if unit else ("", "")
    digits = _decimals(residuals[~outliers])
    plane = {"normal": normal_row(detector), "point of the plane": point_row(detector, suffix)}
    if detector.surface == "vertical":
        errors = np.sqrt(np.diag(detector.precision().slopes_covariance)[:-1])
        plane["slopes"] = _with_error(detector.coef_, errors.max())
    tests = {
        "test": f"{_test_row(detector)}, {detector.correction} correction, "
        f"alpha = {detector.alpha:g}",
        "level of one point": f"{detector._level_of_one():.3g}",
        "critical value": f"{detector.critical_value_:.4f}",
        "sigma0": f"{detector.sigma0_:.6g}{suffix} ({sigma0_origin(detector)})",
        "degrees of freedom": detector.dof_,
        "variance factor": f"{detector.variance_factor_initial_:.6g}{squared} with all points, "
        f"{detector.variance_factor_:.6g}{squared} without outliers",
        "deviation": f"{np.sqrt(detector.variance_factor_):.6g}{suffix} of one observation, "
        "without outliers",
        "global test": global_test_row(detector),
        **_details(detector),
    }
    parts = {"Plane": plane | {"tilt from horizontal": tilt(detector)}}
    if not detector._sigma0_is_rounding:
        parts["Standard errors"] = precision_rows(detector, X, suffix)
    parts["Tests"] = tests
    if reliability is not None:
        parts["Reliability"] = reliability_rows(reliability, suffix)
    if flatness is not None:
        parts["Flatness"] = flatness_rows(flatness, suffix)
    if comparison is not None:
        parts["Against the other plane"] = comparison_rows(comparison, suffix)
    first = {
        "method": describe(detector),
        "points": len(X),
        "outliers": share(outliers.sum(), len(X)),
    }
    kinds = {"all": residuals, "inliers": residuals[~outliers], "outliers": residuals[outliers]}
    columns = f"{'row':>8}{'residual':>14}{'redundancy':>12}{'statistic':>12}"
    if reliability is not None:
        columns += f"{'MDB':>12}{'gross error':>14}{'deviation':>12}{'effect':>12}"
    lines = [
        *(title, "=" * len(title), *rows_of(first)),
        *(line for part in parts.items() for line in with_heading(*part)),
        *with_heading(f"Residuals{suffix and f' ({unit})'}", {}),
        f"A residual is {sign_of_residuals(detector)}.",
        f"{'':<12}{'points':>10}{'mean':>14}{'rms':>14}{'least':>14}{'largest':>14}",
        *(_residual_row(name, values, digits) for name, values in kinds.items()),
        *("", f"{min(n_worst, len(X))} largest test statistics"),
        f"{columns}  verdict   coordinates",
    ]
    for i in np.argsort(-detector.test_statistic_, kind="stable")[:n_worst]:
        line = f"{i:>8}{residuals[i]:>14.{digits}f}{detector.redundancy_[i]:>12.6f}"
        line += f"{detector.test_statistic_[i]:>12.4g}"
        if reliability is not None:
            line += (
                f"{reliability.minimal_bias[i]:>12.{digits}f}"
                f"{reliability.gross_error[i]:>14.{digits}f}"
                f"{reliability.gross_error_deviation[i]:>12.{digits}f}"
                f"{reliability.effect_on_normal[i]:>12.2g}"
            )
        lines.append(f"{line}  {'outlier' if outliers[i] else 'inlier':<10}{_row(X[i])}")
    return "\n".join(lines) + "\n"


def describe(detector):
    if hasattr(detector, "elimination_step_"):
        how = "one at a time" if detector.elimination == "single" else "all rejected at once"
        how += ", robust start" if detector.robust_start else ""
        name = f"Baarda's data snooping, {how}"
    else:
        name = f"fuzzy memberships, width {detector.width:g}, weighting {detector.weighting}"
    how = "least squares" if detector.loss == "squared_error" else f"{detector.loss} loss"
    return f"{name}; {detector.surface} surface, {how}"


def sigma0_origin(detector):
    """The origin of sigma0, in words."""
    if detector._sigma0_is_rounding:
        return "float64's rounding: no noise to test against"
    return "estimated" if detector.sigma0 == "auto" else "given"


def global_test_row(detector):
    """p of the global test before and after the removal, or why there is none, in words."""
    if detector.sigma0 == "auto":
        return "none: sigma0 is estimated from these points, so it fits them at any noise"
    before, after = detector.global_test_pvalue_initial_, detector.global_test_pvalue_
    level = detector.global_test_level_
    verdict = f"; rejected at the level {level:.3g}" if after < level else ""
    return f"p = {before:.2g} with all points, {after:.2g} without outliers{verdict}"


def sign_of_residuals(detector):
    """What the sign of a residual means, in words."""
    side = "on the side of the normal" if detector.surface == "orthogonal" else "above the plane"
    return f"positive {side}"


def normal_row(detector):
    """The normal and the standard error of its direction, in radians."""
    return _with_error(detector.normal_, np.radians(detector.precision().ellipse[0]))


def point_row(detector, suffix):
    """The center of the points that pass, and the standard error of the plane there."""
    plane = detector._plane
    return _with_error(plane.center, detector._scale / np.sqrt(plane.sum_weights)) + suffix


def _with_error(values, error):
    """Numbers to the first digit of their standard error, which exact points do not have."""
    digits = _digits(error)
    error = f"{error:.{digits}f}" if error >= LEAST_ERROR else "less than 1e-9"
    return f"{_row(np.round(values, digits) + 0.0, digits)} ± {error}"


def _digits(error):
    return max(0, -int(np.floor(np.log10(max(error, LEAST_ERROR)))))


def _test_row(detector):
    replaced = " in place of w, as sigma0 is estimated" if detector.test_ != detector.test else ""
    return detector.test_ + replaced


def _details(detector):
    if hasattr(detector, "elimination_step_"):
        removed = np.count_nonzero(detector.elimination_step_)
        back = np.count_nonzero((detector.elimination_step_ > 0) & (detector.labels_ == 1))
        return {"removed": f"{removed} in {counted(detector.n_iter_, 'round')}, {back} came back"}
    if np.isnan(detector.defuzzification_limit_):
        return {"limit": "none: no residual is abnormal"}
    return {"limit": f"1 - C_H = {detector.defuzzification_complement_:.6g}"}


def _decimals(residuals):
    """Number of decimals that shows three digits of a typical residual."""
    rms = np.sqrt(np.mean(residuals**2)) if len(residuals) else 0.0
    return int(np.clip(2 - np.floor(np.log10(rms)), 0, 9)) if rms > 0 else 6


def _residual_row(name, residuals, digits):
    if len(residuals) == 0:
        return f"{name:<12}{0:>10}"
    values = residuals.mean(), np.sqrt(np.mean(residuals**2)), residuals.min(), residuals.max()
    values = np.round(values, digits) + 0.0  # no "-0.0000"
    return f"{name:<12}{len(residuals):>10}" + "".join(f"{v:>14.{digits}f}" for v in values)


def share(part, total):
    return f"{part} of {total} ({100 * part / total:.2f} %)"


def tilt(detector):
    """Angle between the plane and the horizontal plane, in words."""
    degrees = detector.precision().tilt
    digits = min(_digits(detector.precision().ellipse[0]), 6)
    return f"{degrees:.{digits}f} degrees"


def _row(values, digits=6):
    return " ".join(f"{value:.{digits}f}" for value in values)
