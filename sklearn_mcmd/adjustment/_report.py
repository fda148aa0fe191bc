"""A report of a fitted plane test that a surveyor can file: text and figure."""

import numpy as np
from sklearn.utils.validation import check_array, check_is_fitted

from sklearn_mcmd.adjustment._tests import local_level

__all__ = ["plot_report", "text_report"]

# A figure of more points shows no more, and takes minutes.
MAX_DRAWN = 50_000
BLUE, RED, GRAY = "#1f77b4", "#d62728", "#7f7f7f"


def text_report(detector, X, *, title="Plane test", unit="", n_worst=10):
    """Plane, quality figures and the worst points of a fitted detector, as text.

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
        Points to list, in the order of their test statistics.

    Returns
    -------
    str

    Raises
    ------
    ValueError
        If X isn't what the detector was fitted to.

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
    X = _check_points(detector, X)
    residuals = detector._plane.evaluate(X)[0]
    outliers = detector.labels_ == -1
    level = local_level(
        detector.alpha, int(np.count_nonzero(detector.support_)), detector.correction
    )
    suffix = f" {unit}" if unit else ""
    lines = [
        title,
        "=" * len(title),
        f"method                {_describe(detector)}",
        f"points                {len(X)}",
        f"outliers              {_share(outliers.sum(), len(X))}",
        "",
        "Plane",
        "-----",
        f"normal                {_row(detector.normal_)}",
        f"distance from origin  {detector.distance_:.6f}{suffix}",
    ]
    if detector.surface == "vertical":
        lines += [
            f"slopes                {_row(detector.coef_)}",
            f"intercept             {detector.intercept_:.6f}{suffix}",
        ]
    tilt = np.rad2deg(np.arccos(min(abs(detector.normal_[-1]), 1.0)))
    lines += [
        f"tilt from horizontal  {tilt:.4f} degrees",
        "",
        "Tests",
        "-----",
        f"test                  {detector.test}, {detector.correction} correction, "
        f"alpha = {detector.alpha:g}",
        f"level of one point    {level:.3g}",
        f"critical value        {detector.critical_value_:.4f}",
        f"sigma0                {detector.sigma0_:.6g}{suffix}"
        + (" (robust estimate)" if detector.sigma0 == "auto" else " (given)"),
        f"degrees of freedom    {detector.dof_}",
        f"variance factor       {detector.variance_factor_initial_:.6g} with all points, "
        f"{detector.variance_factor_:.6g} without outliers",
        f"global test           p = {detector.global_test_pvalue_:.4g}",
        *_details(detector),
        "",
        f"Residuals{suffix and f' ({unit})'}",
        "---------",
        f"{'':<12}{'points':>10}{'mean':>14}{'rms':>14}{'least':>14}{'largest':>14}",
        _residual_row("all", residuals),
        _residual_row("inliers", residuals[~outliers]),
        _residual_row("outliers", residuals[outliers]),
        "",
        f"{min(n_worst, len(X))} largest test statistics",
        f"{'row':>8}{'residual':>14}{'redundancy':>12}{'statistic':>12}  verdict   coordinates",
    ]
    for i in np.argsort(-detector.test_statistic_, kind="stable")[:n_worst]:
        verdict = "outlier" if outliers[i] else "inlier"
        lines.append(
            f"{i:>8}{residuals[i]:>14.6g}{detector.redundancy_[i]:>12.6f}"
            f"{detector.test_statistic_[i]:>12.4g}  {verdict:<10}{_row(X[i])}"
        )
    return "\n".join(lines) + "\n"


def plot_report(detector, X, *, title="Plane test", unit="", figure=None):
    """Residual map, histogram against the normal curve, and memberships or statistics.

    Parameters
    ----------
    detector : BaardaPlaneDetector or FuzzyPlaneDetector
        Fitted to X.
    X : array-like of shape (n_samples, n_features)
        The training points.
    title : str, default="Plane test"
    unit : str, default=""
        Unit of X, for example "m"; only printed.
    figure : matplotlib.figure.Figure, default=None
        Where to draw; a new figure that belongs to no window when None.

    Returns
    -------
    matplotlib.figure.Figure
        ``figure.savefig("report.png")`` files it.

    Raises
    ------
    ImportError
        If matplotlib is missing.
    """
    try:
        from matplotlib.figure import Figure
    except ImportError as error:
        raise ImportError(
            'plot_report needs matplotlib: pip install "sklearn-mcmd[plot]"'
        ) from error
    X = _check_points(detector, X)
    figure = figure or Figure(figsize=(15, 4.8), layout="constrained")
    left, middle, right = figure.subplots(1, 3)
    residuals = detector._plane.evaluate(X)[0]
    outliers = detector.labels_ == -1
    suffix = f" [{unit}]" if unit else ""
    figure.suptitle(f"{title}: {_share(outliers.sum(), len(X))} outliers")
    _draw_map(left, detector, X, residuals, outliers, suffix)
    _draw_histogram(middle, residuals, outliers, suffix)
    if hasattr(detector, "membership_residual_"):
        _draw_memberships(right, detector)
    else:
        _draw_statistics(right, detector, outliers)
    return figure


def _check_points(detector, X):
    check_is_fitted(detector)
    X = check_array(X, dtype=np.float64)
    if X.shape != (len(detector.labels_), detector.n_features_in_):
        raise ValueError(
            f"X has shape {X.shape}, but the detector was fitted to "
            f"{(len(detector.labels_), detector.n_features_in_)}; pass the training points."
        )
    return X


def _describe(detector):
    if hasattr(detector, "elimination_step_"):
        how = "one at a time" if detector.elimination == "single" else "all rejected at once"
        how += ", robust start" if detector.robust_start else ""
        name = f"Baarda's data snooping, {how}"
    else:
        name = f"fuzzy memberships, width {detector.width:g}, weighting {detector.weighting}"
    return f"{name}; {detector.surface} surface, estimator {detector.estimator}"


def _details(detector):
    if hasattr(detector, "elimination_step_"):
        removed = np.count_nonzero(detector.elimination_step_)
        back = np.count_nonzero((detector.elimination_step_ > 0) & (detector.labels_ == 1))
        return [f"removed               {removed} in {detector.n_iter_} rounds, {back} came back"]
    if np.isnan(detector.defuzzification_limit_):
        return ["limit                 none: no residual is abnormal"]
    return [f"limit                 1 - C_H = {detector.defuzzification_complement_:.6g}"]


def _residual_row(name, residuals):
    if len(residuals) == 0:
        return f"{name:<12}{0:>10}"
    values = residuals.mean(), np.sqrt(np.mean(residuals**2)), residuals.min(), residuals.max()
    return f"{name:<12}{len(residuals):>10}" + "".join(f"{value:>14.6g}" for value in values)


def _share(part, total):
    return f"{part} of {total} ({100 * part / total:.2f} %)"


def _row(values):
    return " ".join(f"{value:.6f}" for value in values)


def _thinned(rows):
    """At most `MAX_DRAWN` of the rows, evenly picked."""
    return rows[:: len(rows) // MAX_DRAWN + 1]


def _draw_map(axes, detector, X, residuals, outliers, suffix):
    """Where the residuals are: seen along the residuals' direction."""
    good, bad = (_thinned(np.flatnonzero(mask)) for mask in (~outliers, outliers))
    if detector.surface == "vertical":
        plan, names = X[:, :-1], [f"x{suffix}", f"y{suffix}"]
    else:
        plan = detector._plane.whiten(X)[0] / np.linalg.norm(detector._plane.axes, axis=0)
        names = [f"along the plane{suffix}", f"across{suffix}"]
    if plan.shape[1] >= 2:
        reach = np.abs(residuals[good]).max(initial=0.0) or 1.0
        shown = axes.scatter(
            *plan[good, :2].T, c=residuals[good], s=4, cmap="coolwarm", vmin=-reach, vmax=reach,
            rasterized=True,
        )  # fmt: skip
        axes.figure.colorbar(shown, ax=axes, label=f"residual of inliers{suffix}")
        axes.scatter(*plan[bad, :2].T, s=14, marker="x", c="k", label="outlier", rasterized=True)
        axes.set_aspect("equal", adjustable="datalim")
    else:
        along = plan[:, 0] if plan.shape[1] else np.zeros(len(X))
        axes.scatter(along[good], residuals[good], s=4, c=BLUE, rasterized=True)
        axes.scatter(along[bad], residuals[bad], s=14, marker="x", c="k", label="outlier")
        names[1] = f"residual{suffix}"
    axes.set(title="Residual map", xlabel=names[0], ylabel=names[1])
    if len(bad):
        axes.legend(loc="upper right")


def _draw_histogram(axes, residuals, outliers, suffix):
    """Residuals against the normal curve of the inliers' scale."""
    inliers = residuals[~outliers]
    scale = inliers.std() if len(inliers) else 0.0
    if scale == 0:
        scale = max(np.abs(residuals).max(), 1.0)
    reach = 6 * scale
    bins = np.linspace(-reach, reach, 61)
    # What lies beyond is counted in the last bins, so that nothing goes unseen.
    axes.hist(np.clip(inliers, -reach, reach), bins, color=BLUE, alpha=0.7, label="inliers")
    if outliers.any():
        axes.hist(
            np.clip(residuals[outliers], -reach, reach),
            bins,
            color=RED,
            alpha=0.7,
            label="outliers",
        )
    curve = np.linspace(-reach, reach, 400)
    density = np.exp(-0.5 * (curve / scale) ** 2) / (scale * np.sqrt(2 * np.pi))
    axes.plot(curve, density * len(inliers) * (bins[1] - bins[0]), color="k", label="normal curve")
    axes.set(
        title="Residuals", xlabel=f"residual{suffix}, beyond 6 deviations in the last bin",
        ylabel="points", yscale="log", ylim=(0.5, None),
    )  # fmt: skip
    axes.legend(loc="upper left")


def _draw_memberships(axes, detector):
    """m_M and the verdict over the test statistic."""
    outliers = detector.labels_ == -1
    for mask, color, name in ((~outliers, BLUE, "inlier"), (outliers, RED, "outlier")):
        rows = _thinned(np.flatnonzero(mask))
        if len(rows):
            axes.scatter(
                detector.test_statistic_[rows], detector.membership_residual_[rows],
                s=8, c=color, label=f"m$_M$, {name}", rasterized=True,
            )  # fmt: skip
    rows = _thinned(np.arange(len(outliers)))
    axes.scatter(
        detector.test_statistic_[rows], detector.membership_[rows],
        s=3, c=GRAY, label="m$_H$", zorder=0, rasterized=True,
    )  # fmt: skip
    axes.axvline(detector.critical_value_, color="k", linestyle="--", label="critical value")
    axes.set(title="Memberships", xlabel=f"test statistic {detector.test}", ylabel="membership")
    axes.legend(loc="center right")


def _draw_statistics(axes, detector, outliers):
    """Test statistics in ascending order."""
    order = np.argsort(detector.test_statistic_, kind="stable")
    rank = np.arange(1, len(order) + 1)
    for mask, color, name in ((~outliers, BLUE, "inlier"), (outliers, RED, "outlier")):
        rows = _thinned(np.flatnonzero(mask[order]))
        if len(rows):
            axes.scatter(
                rank[rows], detector.test_statistic_[order[rows]], s=6, c=color, label=name,
                rasterized=True,
            )  # fmt: skip
    axes.axhline(detector.critical_value_, color="k", linestyle="--", label="critical value")
    axes.set(
        title="Test statistics", xlabel="points, in ascending order",
        ylabel=f"test statistic {detector.test}", yscale="symlog",
    )  # fmt: skip
    axes.legend(loc="upper left")
