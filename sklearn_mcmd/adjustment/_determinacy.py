"""Do the points determine a plane, and is at least one left to test it?"""

import numpy as np

from sklearn_mcmd._errors import ParameterError, counted

N_FIRST = 1024  # points that are checked first, and nearly always hold enough distinct ones
# Begin of the message for points with a large `normal_pvalue`.
AS_THICK_AS_WIDE = "The points that pass are as thick as they are wide, as those about a line are"


def check_distinct(X, n_samples):
    """Raise if X, the points of positive weight, has no more distinct points than columns.

    A plane in d dimensions goes through any d points: a test needs one more.
    """
    d = X.shape[1]
    n_distinct = len(np.unique(X[:N_FIRST], axis=0))
    if n_distinct <= d < len(X):
        n_distinct = len(np.unique(X, axis=0))
    if n_distinct > d:
        return
    if len(X) <= d:
        few = "$n_samples"
        if n_samples > len(X):
            few += f", of which {len(X)} of positive weight,"
    else:
        few = f"$X has {counted(n_distinct, 'distinct point')} in $n_samples, which"
    raise ParameterError(
        f"{few} is too few to test a plane in {d}D: at least {d + 1} distinct points are "
        f"needed, because {d} determine a plane and leave no redundancy.",
        n_samples=n_samples,
    )


def check_rank(plane, d, which="$X"):
    """Raise if the points of a plane, `which` in words, lie on one line or at one place.

    For points in space these are all planes that are not determined. With more columns, one may
    depend on others, as a sum depends on its parts. That is no error: residuals and tests are the
    same as without that column, and slopes are those of minimum norm.
    """
    if plane.rank >= min(d, 3):
        return
    place = "at one place" if plane.rank == 1 else "on one line"
    which = f"{plane.n_observations} points of {which}"
    if plane.surface == "orthogonal":
        raise ParameterError(
            f"The {which} lie {place}, which does not determine a plane in {d}D: add points beside "
            "it."
        )
    columns = "first column" if d == 2 else f"first {d - 1} columns"
    remedy = (
        f"replace the {d - 1} by the distance along it, or " if d > 2 and plane.rank == 2 else ""
    )
    raise ParameterError(
        f"By their {columns} the {which} lie {place}, which does not determine the slopes of "
        f"$surface='vertical' in {d}D: add points beside it, {remedy}take $surface='orthogonal' "
        "for an upright wall."
    )


def normal_pvalue(plane, rounding=0.0):
    """Probability that points around a line are at least as flat as the points of the plane.

    The plane is of an orthogonal surface; `rounding` is the least thickness of its points. The
    probability is near 0 if they determine a normal. It is uniform in (0, 1) if they lie around a
    line, with equal normal noise across it: their normal is then any direction across the line.

    This is Mauchly's test of sphericity of the two least principal variances. For two variables
    with f degrees of freedom the ratio L of their geometric to their arithmetic mean has the
    distribution ``P(L <= x) = x^(f - 1)``. The plane's other directions take d - 2 of the n - 1
    degrees of freedom.
    """
    narrow = 1 / np.linalg.norm(plane.axes, 2)
    thick = max(np.sqrt(plane.sum_of_squares), rounding * np.sqrt(plane.sum_weights))
    ratio = min(thick / narrow, 1.0)
    d = len(plane.direction)
    return float((2 * ratio / (1 + ratio**2)) ** max(plane.n_observations - d, 1))
