"""Lines of a plane's report: precision, reliability, flatness, comparison and plan."""

import numpy as np

from sklearn_mcmd.adjustment._power import POWER
from sklearn_mcmd.adjustment._precision import quantile

__all__ = [
    "comparison_rows",
    "flatness_rows",
    "plan_rows",
    "precision_rows",
    "reliability_rows",
    "rows_of",
    "usual_reliability",
    "with_heading",
]

# Standard error in degrees from which on a plane falls to no side.
NO_DIRECTION = 60.0
OUTCOMES = {
    "found": "of the outliers",
    "correct": "all outliers and no other point go",
    "missed": "outliers stay, no good point goes",
    "wrongly_excluded": "good points go in place of outliers (type III)",
    "over_excluded": "good points go with all outliers",
    "false_alarm": "a point goes though there is no outlier",
}


def with_heading(title, rows):
    """Lines of a part of the report: a title, and names beside values."""
    return ["", title, "-" * len(title), *rows_of(rows)]


def rows_of(rows):
    """Lines of names beside values."""
    return [f"{name:<22}{value}" for name, value in rows.items()]


def precision_rows(detector, X, unit):
    """Standard errors a posteriori, and how much they change a priori."""
    is_exact = detector._scale == detector._rounding_of(detector._plane.direction)
    variance = "prior" if is_exact else "posterior"
    precision = detector.precision(variance)
    center = quantile(0.95, precision.dof) * precision.offset_error
    plane, point = detector.band(X[detector.support_], variance=variance)
    prior = "there are none a priori, because sigma0 is estimated"
    if detector.sigma0 != "auto":
        prior = f"a priori {detector.sigma0_ / precision.scale:.3g} times as large"
    posterior = f"with {precision.dof:g} degrees of freedom; {prior}"
    distance_error = float(np.sqrt(precision.covariance[-1, -1]))
    rows = {
        "a posteriori": "the points have no noise; these are a priori" if is_exact else posterior,
        "normal": f"ellipse {' x '.join(f'{error:.2g}' for error in precision.ellipse)}, cone "
        f"{precision.cone:.2g} degrees; 95 %: {precision.confidence_factor():.2f} ellipses",
        "tilt": _plus_minus(precision.tilt, precision.tilt_error, " degrees"),
        "distance": _plus_minus(detector.distance_, distance_error, f"{unit} from the origin"),
        "band of 95 %": f"plane ± {center:.3g} at its center to ± {plane.max():.3g}{unit} at its "
        f"rim, a point ± {point.max():.3g}{unit}",
    }
    if precision.azimuth_error < NO_DIRECTION:
        words = " degrees from the y axis, clockwise"
        rows["falls to"] = _plus_minus(precision.azimuth, precision.azimuth_error, words)
    return rows


def usual_reliability(detector, X, n_worst=10):
    """The reliability of the usual power, or None where there is none: of M-estimates, of tests so
    lax that their level is no smaller, and of points without noise."""
    is_lax = detector._level_of_one() >= POWER
    if detector.loss != "squared_error" or is_lax or detector._sigma0_is_rounding:
        return None
    return detector.reliability(X, n_worst=n_worst)


def reliability_rows(reliability, unit):
    """Internal and external reliability, in words."""
    bias = reliability.minimal_bias[np.isfinite(reliability.minimal_bias)]
    if len(bias) == 0:
        return {"detectable bias": "none: no point is controlled by others"}
    kinds = ("normal", "tilt", "offset")
    normal, tilt, offset = (getattr(reliability, f"effect_on_{kind}").max() for kind in kinds)
    rows = {
        "level, power": f"{reliability.level:.3g} of one point, {reliability.power:g}; "
        f"noncentrality {reliability.noncentrality:.2f}",
        "B-method": f"a global test of level {reliability.coupled_level:.3g} finds the same bias",
        "detectable bias": f"{bias.min():.4g} to {bias.max():.4g}{unit} (MDB)",
        "effect of such a bias": f"normal {normal:.2g} degrees, tilt {tilt:.2g} degrees, center "
        f"{offset:.2g}{unit} at most; below, in degrees of the normal",
        "gross error": "below: what a point is wrong by, if no other is",
        "bias to noise": f"{reliability.bias_to_noise.max():.3g} at most",
    }
    if len(reliability.pairs):
        at = int(np.abs(reliability.correlation).argmax())
        i, j = reliability.pairs[at]
        rows["told apart"] = (
            f"rows {i} and {j}, correlation {reliability.correlation[at]:.2g}: from a bias of "
            f"{reliability.identifiable_bias[at]:.4g}{unit} on"
        )
    return rows


def comparison_rows(comparison, unit):
    """The verdict on two planes, and both differences with their tests."""
    rows = {"verdict": comparison.verdict}
    for name, words in (("tilt", " degrees"), ("offset", f"{unit} along the normal")):
        one = getattr(comparison, name)
        verdict = "significant" if one.significant else "not significant"
        rows[name] = (
            f"{_plus_minus(one.value, one.error, words)}, {verdict} (p = {one.pvalue:.2g}); "
            f"{one.smallest:.2g} would be found with a power of {POWER:g}"
        )
    return rows


def flatness_rows(flat, unit):
    """Points against the tolerance, both zones and the verdict."""
    return {
        "tolerance": f"{flat.tolerance:g}{unit} between two parallel planes",
        "outside": f"{flat.n_outside} of {flat.n_points} points "
        f"({100 * flat.n_outside / flat.n_points:.2f} %), {flat.n_significant} of them by more "
        f"than their uncertainty of {flat.uncertainty:.3g}{unit}",
        "zone": f"{flat.zone:.4g}{unit} by least squares, {flat.minimum_zone:.4g}{unit} at "
        "least; without outliers, with noise",
        "verdict": f"{flat.verdict}, the uncertainty of the points considered",
    }


def plan_rows(plan, unit):
    """What data snooping will find, in words."""
    bias, error = plan.bias
    found = f"{bias:.4g}{unit} (given)" if error == 0 else _plus_minus(bias, error, unit)
    rows = {
        "outliers": plan.n_outliers,
        "detectable bias": f"{plan.minimal_bias:.4g}{unit} of one outlier, by formula (MDB)",
        "bias": found if np.isfinite(bias) else "none up to 1000 deviations is found so often",
    }
    for name, words in OUTCOMES.items():
        value, error = getattr(plan, name)
        rows[name.replace("_", " ")] = f"{value:.4f} ± {error:.4f}  {words}"
    normal = " and ".join(f"{error:.2g}" for error in plan.normal_errors)
    rows["plane"] = f"± {plan.offset_error:.3g}{unit} at the center, ± {normal} degrees"
    return rows


def _plus_minus(value, error, words):
    """A value to the second digit of its standard error."""
    digits = int(np.clip(1 - np.floor(np.log10(error)), 0, 9)) if 0 < error < np.inf else 6
    return f"{value:.{digits}f} ± {error:.{digits}f}{words}"
