"""The figures of a tested plane, each once: text, picture, page and terminal print these rows."""

from typing import NamedTuple

import numpy as np
from scipy.special import chdtri

from sklearn_mcmd._errors import fixed
from sklearn_mcmd.adjustment._precision import quantile
from sklearn_mcmd.adjustment._tests import POWER, pvalue

LEAST_ERROR = 1e-9  # the least standard error that is printed
NO_DIRECTION = 60.0  # standard error in degrees from which on a plane falls to no side


class Row(NamedTuple):
    """A figure: numbers to the second digit of their standard error, or words."""

    name: str
    value: str
    unit: str = ""
    error: str = ""
    note: str = ""

    def __str__(self):
        words = f"{self.value} ± {self.error}" if self.error else self.value
        words = f"{words} {self.unit}" if self.unit else words
        return f"{words} ({self.note})" if self.note else words


class Table(NamedTuple):
    """Figures of several points or groups of points."""

    header: tuple[str, ...]
    rows: list[tuple[str, ...]]


class PlaneFigures(NamedTuple):
    """All figures of a plane: rows by the title of their part, and tables by their title."""

    parts: dict[str, list[Row]]
    tables: dict[str, Table]

    def rows(self):
        """The rows of all parts by their names, which differ."""
        return {row.name: row for rows in self.parts.values() for row in rows}


def plane_figures(
    detector, X, unit="", *, n_worst=None, comparison=None, flatness=None, by_range=()
):
    """The figures of a fitted detector, its training points, and what was compared with them.

    The unit is only printed. `comparison`, `flatness` and `by_range` are results of
    `compare_planes`, `flatness` and `variance_components`. Without `n_worst`, the number of points
    to list, there are neither tables nor reliability.
    """
    unit = f" {unit}" if unit else ""
    # Tests so lax that their level is no smaller than the power have none, nor have exact points.
    has_reliability = detector._level_of_one() < POWER and not detector._fitted.is_rounding
    reliability = detector.reliability(X) if n_worst is not None and has_reliability else None
    outliers = _share(np.count_nonzero(detector.labels_ == -1), len(X))
    parts = {
        "": {"method": _method(detector), "points": len(X), "outliers": outliers},
        "Plane": _plane_rows(detector, unit),
        "Standard errors": _error_rows(detector, X, unit),
        "Form": _form_rows(detector, unit),
        "Tests": _test_rows(detector, unit) | _range_rows(by_range, unit),
        "Reliability": _reliability_rows(reliability, unit),
        "Flatness": _flatness_rows(flatness, unit),
        "Against the other plane": _comparison_rows(comparison, unit),
        "Residuals": _residual_rows(detector, X, unit),
    }
    tables = {}
    if n_worst is not None:
        worst = _worst_table(detector, X, reliability, n_worst)
        tables[f"{len(worst.rows)} largest test statistics"] = worst
    words = {title: _words(rows) for title, rows in parts.items() if rows}
    return PlaneFigures(words, tables)


def _words(rows):
    """Rows of words; what is a row already stays."""
    return [row if isinstance(row, Row) else _row(name, row) for name, row in rows.items()]


def _row(name, value, unit="", *, error=None, note=""):
    """A row of words, or of numbers with a standard error."""
    if error is not None:
        value, error = _rounded(np.atleast_1d(value), float(error))
    return Row(name=name, value=str(value), unit=unit.strip(), error=error or "", note=note)


def _rounded(values, error):
    """Numbers to the second digit of their standard error, which exact points do not have."""
    digits = 6
    if error < np.inf:
        digits = int(np.clip(1 - np.floor(np.log10(max(error, LEAST_ERROR))), 0, 9))
    words = " ".join(fixed(value, f".{digits}f") for value in np.round(values, digits) + 0.0)
    return words, fixed(error, f".{digits}f") if error >= LEAST_ERROR else "less than 1e-9"


def _share(part, total, noun=""):
    return f"{part} of {total}{noun} ({100 * part / total:.2f} %)"


def _method(detector):
    if hasattr(detector, "elimination_step_"):
        how = "one at a time" if detector.elimination == "single" else "all rejected at once"
        how += ", robust start" if detector.robust_start else ""
        name = f"Baarda's data snooping, {how}"
    else:
        name = f"fuzzy memberships, width {detector.width:g}, weighting {detector.weighting}"
    return f"{name}; {detector.surface} surface"


def _is_exact(detector):
    """Whether the points that pass have no noise, so that errors are those of a given sigma0."""
    fitted = detector._fitted
    return fitted.scale == fitted.rounding and not fitted.is_rounding


def _plane_rows(detector, unit):
    plane = detector._fitted.plane
    precision = detector.precision("prior" if _is_exact(detector) else "posterior")
    at_center = precision.scale / np.sqrt(plane.sum_weights)
    rows = [
        _row("normal", detector.normal_, error=np.radians(precision.ellipse[0])),
        _row("point", plane.center, unit, error=at_center, note="on the plane"),
    ]
    if detector.surface == "vertical":
        errors = np.sqrt(np.diag(precision.slopes_covariance)[:-1])
        rows.append(_row("slopes", detector.coef_, error=errors.max()))
    horizontal = " degrees from the horizontal"
    rows.append(_row("dip", precision.tilt, horizontal, error=precision.tilt_error))
    leans = precision.tilt > precision.confidence_factor() * precision.tilt_error
    is_exact = detector._fitted.is_rounding
    if leans and not is_exact and precision.azimuth_error < NO_DIRECTION:
        rows.append(_dip_direction(detector, precision))
    return {row.name: row for row in rows}


def _dip_direction(detector, precision):
    """Where the plane falls to; if it is upright within its error, where its normal points."""
    direction, note = precision.azimuth, ""
    if 90 - precision.tilt < quantile(0.95, precision.dof) * precision.tilt_error:
        note = "or opposite: upright within its error"
        x, y = detector.normal_[:2]
        direction = np.degrees(np.arctan2(x, y)) % 360
    clockwise = " degrees from the y axis, clockwise"
    error = precision.azimuth_error
    return _row("dip direction", direction, clockwise, error=error, note=note)


def _error_rows(detector, X, unit):
    """Standard errors a posteriori, and how much they change a priori."""
    if detector._fitted.is_rounding:
        return {}
    variance = "prior" if _is_exact(detector) else "posterior"
    precision = detector.precision(variance)
    center = quantile(0.95, precision.dof) * precision.offset_error
    plane, point = detector.band(X[detector.support_], variance=variance)
    prior = "there are none a priori, because sigma0 is estimated"
    if detector.sigma0 != "auto":
        prior = f"a priori {detector.sigma0_ / precision.scale:.3g} times as large"
    posterior = f"with {precision.dof:g} degrees of freedom; {prior}"
    times = share = ""
    if precision.alike > 1:
        times = f"{precision.alike:.2g} times those "
        share = f", and {quantile(0.95, precision.dof):.3g} of them hold 95 %"
    exact = "the points have no noise; these are a priori"
    ellipse = " x ".join(f"{error:.2g}" for error in precision.ellipse)
    return {
        "errors": f"{times}of independent noise{share}; the middle of the plane lies within ± "
        f"{center:.2g}{unit} (95 %); not in them: form of the whole plane, registration, "
        "calibration",
        "a posteriori": exact if variance == "prior" else posterior,
        "normal's ellipse": f"{ellipse}, cone {precision.cone:.2g} degrees; 95 %: "
        f"{precision.confidence_factor():.2f} ellipses",
        "band of 95 %": f"plane ± {center:.3g} at its center to ± {plane.max():.3g}{unit} at "
        f"its rim, a point ± {point.max():.3g}{unit}",
    }


def _form_rows(detector, unit):
    """What the points have in common beside the plane."""
    form = detector.form_
    if np.isnan(form.pvalue):
        return {}
    freedom = f"{form.dof} and {form.noise_dof} degrees of freedom"
    return {
        "lack of fit": f"F = {form.statistic:.3g} of {form.n_cells} cells ({freedom}), "
        f"p = {form.pvalue:.2g}",
        "bow": f"{form.bow:.3g}{unit} from its lowest to its highest place",
    }


def _test_rows(detector, unit):
    replaced = " in place of w, as sigma0 is estimated" if detector.test_ != detector.test else ""
    correction = "no" if detector.correction == "none" else detector.correction
    origin = "estimated" if detector.sigma0 == "auto" else "given"
    fitted = detector._fitted
    if fitted.is_rounding:
        origin = "float64's rounding: no noise to test against"
    elif detector.sigma0_ == fitted.least_scale:
        origin = f"that of coordinates in steps of {fitted.step:.3g}{unit}, at least"
    return {
        "test": f"{detector.test_}{replaced}, {correction} correction, alpha = {detector.alpha:g}",
        "alpha_0": f"{detector._level_of_one():.3g}, the level of one point",
        "critical value": f"{detector.critical_value_:.4f}",
        "sigma0": _row("sigma0", f"{detector.sigma0_:.4g}", unit, note=origin),
        "degrees of freedom": detector.dof_,
        **_variance_ratio(detector),
        "global test": _global_test(detector),
    }


def _range_rows(components, unit):
    """Whether instrument data hold, class by class of the range."""
    if not components:
        return {}
    ratios = ", ".join(f"{one.ratio:.2f}" for one in components)
    low, high = components[0].usual
    held = sum(one.usual[0] <= one.ratio <= one.usual[1] for one in components)
    return {
        "by range": f"{ratios} times the deviations that the instrument's errors tell, from "
        f"{components[0].low:.3g} to {components[-1].high:.3g}{unit}",
        "instrument": f"{held} of {len(components)} ranges are within {low:.2f} and "
        f"{high:.2f}, where 95 % are if these errors hold",
    }


def _variance_ratio(detector):
    """The variance factor over a given sigma0^2, and where 95 % of its values are."""
    f = detector.dof_  # the variance factor of the fuzzy test is of an adjustment of its own
    # 95 % of the values of chi-squared over f lie between its two quantiles over f.
    if not hasattr(detector, "elimination_step_"):
        f -= np.count_nonzero(detector.labels_ == -1)
    if detector.sigma0 == "auto" or detector._fitted.is_rounding or f < 1:
        return {}
    low, high = (chdtri(f, share) / f for share in (0.975, 0.025))
    # The square of the quotient, as sigma0 may be so large that its own square overflows.
    deviation = float(np.sqrt(detector.variance_factor_) / detector.sigma0_)
    ratio = deviation * deviation
    words = f"{ratio:.4g} = v'Pv / (f sigma0^2), without outliers; {low:.4g} to {high:.4g} is usual"
    return {"variance ratio": f"{words} (95 %)"}


def _global_test(detector):
    """p of the global test before and after the removal, or why there is none, in words."""
    if detector.sigma0 == "auto":
        return "none: sigma0 is estimated from these points, so it fits them at any noise"
    before, after = detector.global_test_pvalue_initial_, detector.global_test_pvalue_
    level = detector.alpha
    verdict = f"; rejected at the level {level:.3g}" if after < level else ""
    return f"p = {before:.2g} with all points, {after:.2g} without outliers{verdict}"


def _reliability_rows(reliability, unit):
    """Internal and external reliability."""
    if reliability is None:
        return {}
    bias = reliability.minimal_bias[np.isfinite(reliability.minimal_bias)]
    if len(bias) == 0:
        return {"detectable bias": "none: no point is controlled by others"}
    effect = f"{reliability.effect.max():.2g}{unit} at most"
    return {
        "alpha_0, 1 - beta": f"{reliability.level:.3g}, {reliability.power:g}; noncentrality "
        f"{reliability.noncentrality:.2f}",
        "detectable bias": f"{bias.min():.4g} to {bias.max():.4g}{unit} (MDB)",
        "effect of such a bias": f"moves the plane at its place by {effect}",
    }


def _comparison_rows(comparison, unit):
    """The verdict on two planes, and both differences with their tests."""
    if comparison is None:
        return {}
    place = _rounded(comparison.place, 100 * comparison.offset.error)[0]
    registration = f"± {comparison.registration_error:g}{unit} are in both errors"
    if not comparison.registration_error:
        registration = "not in the errors; what it is off looks like a movement"
    return {
        "against": comparison.verdict,
        "compared at": f"{place}{unit}",
        "registration": registration,
        "tilt between": _difference_row("tilt between", comparison.tilt, " degrees"),
        "offset": _difference_row("offset", comparison.offset, f"{unit} along the normal"),
    }


def _difference_row(name, difference, unit):
    note = f"{'' if difference.significant else 'not '}significant, p = {difference.pvalue:.2g}; "
    note += f"{difference.smallest:.2g} would be found with a power of {POWER:g}"
    return _row(name, difference.value, unit, error=difference.error, note=note)


def _flatness_rows(flat, unit):
    """Points against the tolerance, both zones and the verdict."""
    if flat is None:
        return {}
    cell, bump = (" x ".join(f"{side:.2g}" for side in one) for one in (flat.cell, flat.bump))
    outside = _share(flat.n_outside, flat.n_points, " points")
    decide = ""
    if flat.verdict == "undecided":
        decide = "; form and tolerance differ by less than that"
    return {
        "tolerance": f"{flat.tolerance:g}{unit} between two parallel planes",
        "outside": f"{outside}, {flat.n_significant} of them by more than their uncertainty of "
        f"{flat.uncertainty:.3g}{unit}",
        "zone": f"{flat.zone:.4g}{unit} by least squares, {flat.minimum_zone:.4g}{unit} at "
        "least; without outliers, with noise",
        "form": f"{flat.form:.3g} ± {flat.form_uncertainty:.2g}{unit} between two parallel "
        f"planes, by medians of {flat.n_cells} cells of {cell}{unit}; a bump of less than "
        f"{bump}{unit}, or {flat.bump_height:.2g}{unit} high, may be unseen",
        "flatness": f"{flat.verdict}, the uncertainty considered{decide}",
    }


def _residual_rows(detector, X, unit):
    side = "on the side of the normal" if detector.surface == "orthogonal" else "above the plane"
    residuals, inliers = detector.residuals(X), detector.labels_ == 1
    rms, without = (
        f"{_rms(part):.4g}{unit}" if len(part) else "none"
        for part in (residuals, residuals[inliers])
    )
    return {"residuals": f"rms {rms}, without outliers {without}; positive {side}"}


def _worst_table(detector, X, reliability, n_worst):
    """The points of the largest test statistics."""
    residuals, tests = detector.residuals(X), detector.test_statistic_
    kept = residuals[detector.labels_ == 1]
    typical = _rms(kept) if len(kept) else 0.0  # is shown with three digits
    length = f".{int(np.clip(2 - np.floor(np.log10(typical)), 0, 9)) if typical > 0 else 6}f"
    is_baarda = hasattr(detector, "elimination_step_")
    kind = detector.test_ if is_baarda else detector.test  # the fuzzy test turns t into w
    dof = detector.dof_ + ~detector.support_  # a point outside is tested as if it joined
    columns = {
        "residual": (residuals, length),
        "redundancy": (detector.redundancy_, ".6f"),
        "statistic": (tests, ".4g"),
        "p": (pvalue(tests, kind, dof), ".2g"),
    }
    if reliability is not None:
        columns |= {
            "MDB": (reliability.minimal_bias, length),
            "gross error": (reliability.gross_error, length),
            "deviation": (reliability.gross_error_deviation, length),
            "effect": (detector.leverage_ * reliability.gross_error, ".2g"),
        }
    rows = []
    for i in np.argsort(-tests, kind="stable")[:n_worst]:
        cells = [fixed(values[i], form) for values, form in columns.values()]
        verdict = "outlier" if detector.labels_[i] == -1 else "inlier"
        place = " ".join(fixed(value, ".6f") for value in X[i])
        rows.append((str(i), *cells, verdict, place))
    return Table(("row", *columns, "verdict", "coordinates"), rows)


def _rms(values):
    return np.sqrt(np.mean(values**2))
