"""Do the points determine a plane, with something left over to test it?"""

import numpy as np

__all__ = ["AS_THICK_AS_WIDE", "check_distinct", "check_rank", "normal_pvalue"]

# So many points nearly always hold enough distinct ones, and are looked at in no time.
N_FIRST = 1024
# How the message starts for points whose `normal_pvalue` is large.
AS_THICK_AS_WIDE = "The points that pass are as thick as they are wide, as those about a line are"


def check_distinct(X, n_samples):
    """Raise where X, the points of positive weight, has no more distinct points than columns.

    A plane in d dimensions goes through any d points: a test needs one more.
    """
    d = X.shape[1]
    n_distinct = _count_distinct(X[:N_FIRST], d + 1)
    if n_distinct <= d < len(X):
        n_distinct = _count_distinct(X, d + 1)
    if n_distinct > d:
        return
    if len(X) <= d:
        found = f"n_samples={n_samples}"
        if n_samples > len(X):
            found += f", of which {len(X)} of positive weight,"
    else:
        found = f"X has {n_distinct} distinct point(s) in n_samples={n_samples}, which"
    raise ValueError(
        f"{found} is too few to test a plane in {d}D: at least {d + 1} distinct points are "
        f"needed, because {d} determine a plane and leave no redundancy."
    )


def check_rank(plane, d, which="X"):
    """Raise where the points of a plane lie on one line or at one place.

    Parameters
    ----------
    plane : PlaneAdjustment
    d : int
        Number of columns.
    which : str, default="X"
        Whose points they are, for the message.

    Notes
    -----
    For points in space that is every plane that isn't determined. With more columns one may
    depend on others, as a sum does on its parts. Residuals and tests are then what they are
    without it, and slopes are those of minimum norm: that is no error.
    """
    if plane.rank >= min(d, 3):
        return
    place = "at one place" if plane.rank == 1 else "on one line"
    which = f"{plane.n_observations} points of {which}"
    if plane.surface == "orthogonal":
        raise ValueError(
            f"The {which} lie {place}, which does not determine a plane in {d}D: add points beside "
            "it."
        )
    columns = "first column" if d == 2 else f"first {d - 1} columns"
    remedy = (
        f"replace the {d - 1} by the distance along it, or " if d > 2 and plane.rank == 2 else ""
    )
    raise ValueError(
        f"By their {columns} the {which} lie {place}, which does not determine the slopes of "
        f"surface='vertical' in {d}D: add points beside it, {remedy}take surface='orthogonal' for "
        "an upright wall."
    )


def normal_pvalue(plane, rounding=0.0):
    """Probability that points about a line are at least as flat as those of the plane.

    Parameters
    ----------
    plane : PlaneAdjustment
        Of an orthogonal surface.
    rounding : float, default=0.0
        How far a point may have been moved before the plane was adjusted: points are at least
        as thick as that.

    Returns
    -------
    float
        Near 0 where the points are wider than thick, so that they determine a normal. It is
        uniform in (0, 1) where they lie about a line, with equal normal noise across it: their
        normal then points anywhere across.

    Notes
    -----
    Mauchly's test of sphericity, of the least two principal variances. For two variables with
    f degrees of freedom the ratio L of their geometric to their arithmetic mean has the
    distribution ``P(L <= x) = x^(f - 1)``; the plane's other directions cost d - 2 of the
    n - 1 degrees of freedom.
    """
    narrow = 1 / np.linalg.norm(plane.axes, 2)
    thick = max(np.sqrt(plane.sum_of_squares), rounding * np.sqrt(plane.sum_weights))
    ratio = min(thick / narrow, 1.0)
    d = len(plane.direction)
    return float((2 * ratio / (1 + ratio**2)) ** max(plane.n_observations - d, 1))


def _count_distinct(X, enough):
    """Number of distinct rows, or `enough` if there are no fewer."""
    n_distinct = 0
    while len(X) and n_distinct < enough:
        n_distinct += 1
        X = X[np.any(X[:1] != X, axis=1)]
    return n_distinct
