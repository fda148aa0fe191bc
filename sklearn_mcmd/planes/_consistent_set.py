"""Algorithm 1: the maximum consistent set of a neighborhood, in any dimension.

``_consistent_set_numba`` is its compiled form, for clouds of many points in 2D and 3D.
"""

from math import ceil, log1p
from typing import NamedTuple

import numpy as np
from sklearn.utils import check_random_state

from sklearn_mcmd.planes._principal_planes import fit_planes

# Distances to a trial plane that differ by less than this share of the neighborhood's median
# radius are tied (the nearer neighbor goes first), so that rounding does not decide.
DISTANCE_STEP = 2.0**-29
# Least eigenvalues that differ by less than this share of the squared median radius are tied (the
# earlier trial wins). Smaller eigenvalues are rounding errors, as on perfect planes.
EIGENVALUE_STEP = 1e-14
# A subset spans no plane when its second-least singular value is below this share of the
# largest: rounding would decide how such a plane lies.
RANK_TOLERANCE = 1e-6
MOST_TRIALS = 2**62  # what a 64-bit integer holds, and no more are ever made
CHUNK_ENTRIES = 2_000_000  # of the largest temporary array of maximum_consistent_sets


class Trials(NamedTuple):
    """What the compiled Algorithm 1 knows: it would not notice a constant that changes."""

    positions: np.ndarray  # int32 (T, k), the table of `draw_trials`
    n_support: np.ndarray  # int64 (k + 1,), the paper's h of each size
    d: int  # 2 or 3
    distance_step: float = DISTANCE_STEP
    eigenvalue_step: float = EIGENVALUE_STEP
    rank_tolerance: float = RANK_TOLERANCE


def n_trials_needed(max_outlier_rate, success_probability, n_features):
    """Number of trials after which one minimal subset is probably free of outliers (Eq. 13).

    In the paper, `max_outlier_rate`, the probability in [0, 1) that a point is an outlier, is
    epsilon; `success_probability`, in (0, 1), is P_r; and `n_features`, the points in a minimal
    subset, is h_0. The number is at least 1 and at most 2**62.
    """
    # 1 - (1 - clean)^n reaches P_r: Eq. 13 solved for n.
    clean = (1.0 - max_outlier_rate) ** n_features
    if clean >= 1.0:
        return 1
    if clean < 1e-15:
        return MOST_TRIALS
    return max(1, ceil(log1p(-success_probability) / log1p(-clean)))


def draw_trials(n_trials, n_neighbors, random_state=None, *, length=None):
    """Draw the table of trials that all neighborhoods share: int32 (n_trials, n_neighbors).

    Each row is a random order of the positions 0..k-1. A minimal subset is the start of a row.
    Where it spans no plane, more of the row is read, by half as many points again each time
    ("randomly add more points", Algorithm 1, step 1). Positions beyond a smaller neighborhood are
    skipped. A `length` limits the memory of a row for one neighborhood of a million points.
    """
    rng = check_random_state(random_state)
    length = n_neighbors if length is None else min(length, n_neighbors)
    table = np.empty((n_trials, length), dtype=np.int32)
    for row in table:
        row[:] = rng.permutation(n_neighbors)[:length]
    return table


def n_support_points(support_fraction, sizes, n_features):
    """Points in the consistent set, h = ceil(support_fraction * k) (section 4).

    At least n_features + 1, since fewer points fit some plane exactly; at most all points of
    the neighborhood.
    """
    # In floating point 0.8 * 50 is 40.000000000000004, whose ceiling would be 41.
    wanted = np.ceil(np.round(support_fraction * np.asarray(sizes), 9)).astype(np.int64)
    return np.minimum(np.maximum(wanted, n_features + 1), sizes)


def localize(neighborhoods, sizes=None):
    """Shift each neighborhood (k, d) to its first point and scale its median radius to one.

    It is the median, because one gross outlier would make all other distances vanish. Where half of
    the points coincide with the first, the radius is the largest distance, and 1 where all do.
    Returns the shifted members (B, k, d), those beyond `sizes` at the origin, and the radii (B,).
    """
    local = neighborhoods - neighborhoods[:, :1]
    n_sets, k, _ = local.shape
    sizes = np.full(n_sets, k) if sizes is None else sizes
    inside = np.arange(k) < sizes[:, None]
    local[~inside] = 0.0
    # Divide by the largest coordinate first: squares of 1e-200 would vanish.
    extent = np.abs(local).max(axis=(1, 2))
    extent[extent == 0] = 1.0
    local /= extent[:, None, None]
    distances = np.sqrt(np.einsum("bkd,bkd->bk", local, local))
    distances[~inside] = np.inf
    distances.sort(axis=1)
    rows = np.arange(n_sets)
    radius = distances[rows, sizes // 2]
    radius = np.where(radius > 0, radius, distances[rows, sizes - 1])
    radius[radius == 0] = 1.0
    local /= radius[:, None, None]
    return local, extent * radius


def maximum_consistent_sets(neighborhoods, trials, n_support, sizes=None):
    """Find the maximum consistent set of each neighborhood (Algorithm 1).

    Each random minimal subset gives a plane, and the h points nearest to it are a candidate. The
    candidate whose own plane fits best, by the smallest least eigenvalue, is the set.

    Neighborhoods are (B, k, d), of which the first `sizes` (B,) members are in use, or all. Trials
    are a table of `draw_trials`, and `n_support`, the paper's h, is one number or (B,).

    Returns the sets, bool (B, k); the least eigenvalue (B,) of each set's covariance (divisor h),
    in squared units of the points; and whether no trial found a set that spans a plane, bool (B,),
    since points are collinear or coincident. The set is then the first h members. Ties are as
    `DISTANCE_STEP` and `EIGENVALUE_STEP` say.
    """
    n_sets, k, d = neighborhoods.shape
    sizes = np.full(n_sets, k) if sizes is None else np.asarray(sizes)
    n_support = np.broadcast_to(n_support, n_sets)
    local, radius = localize(neighborhoods, sizes)
    eigenvalues, offsets = np.empty((2, n_sets, len(trials)))
    normals = np.empty((n_sets, len(trials), d))
    # Steps 1 to 3 for all trials, in blocks that bound the memory.
    step = max(1, CHUNK_ENTRIES // (n_sets * k))
    for start in range(0, len(trials), step):
        block = slice(start, start + step)
        normals[:, block], offsets[:, block], no_plane = _trial_planes(local, trials[block], sizes)
        support = _nearest_members(
            local, normals[:, block], offsets[:, block], n_support=n_support, sizes=sizes
        )
        least = _least_eigenvalues(local, support, n_support)
        eigenvalues[:, block] = np.where(no_plane, np.inf, least)
    # Step 4: the first trial among the best, so that rounding does not decide.
    best = eigenvalues.min(axis=1, keepdims=True) + EIGENVALUE_STEP
    winner = np.arange(n_sets), np.argmax(eigenvalues <= best, axis=1)
    support = _nearest_members(
        local, normals[winner][:, None], offsets[winner][:, None], n_support=n_support, sizes=sizes
    )[:, 0]
    least = eigenvalues[winner]
    degenerate = np.isinf(least)
    support[degenerate] = (np.arange(k) < n_support[:, None])[degenerate]
    return support, least * radius**2, degenerate


def _trial_planes(local, trials, sizes):
    """Planes through the minimal subsets, completed where they span none (steps 1 and 2).

    Returns normals (B, T, d), offsets (B, T) and whether not even all points span a plane.
    """
    n_sets, k, d = local.shape
    rows = np.arange(n_sets)[:, None, None]
    order = np.broadcast_to(trials, (n_sets, *trials.shape))
    if (sizes < trials.shape[1]).any():
        # Positions beyond the neighborhood go to the end of the row; the others keep their order.
        behind = np.argsort(order >= sizes[:, None, None], axis=-1, kind="stable")
        order = np.take_along_axis(order, behind, axis=-1)
    normals, offsets, degenerate = planes_through(local[rows, order[..., :d]])
    rows, trial = np.nonzero(degenerate)
    # Where all points together span no plane, no subset does.
    members = np.arange(k) < sizes[:, None]
    hopeless = np.zeros(n_sets, dtype=bool)
    sets = np.unique(rows)
    _, spread, _ = fit_planes(local[sets], members[sets])
    hopeless[sets] = _spans_no_plane(spread)
    inside = ~hopeless[rows]
    rows, trial = rows[inside], trial[inside]
    n_used = d
    while rows.size and n_used < order.shape[-1]:
        n_used = min(n_used + max(1, n_used // 2), order.shape[-1])
        # In a smaller neighborhood the last subset is all its points.
        for size in np.unique(np.minimum(n_used, sizes[rows])):
            group = np.minimum(n_used, sizes[rows]) == size
            at = rows[group], trial[group]
            points = local[at[0][:, None], order[at[0], at[1], :size]]
            normals[at], offsets[at], degenerate[at] = planes_through(points)
        inside = degenerate[rows, trial] & (sizes[rows] > n_used)
        rows, trial = rows[inside], trial[inside]
    return normals, offsets, degenerate


def planes_through(points):
    """Unit normals, offsets and rank deficiency of the planes of subsets (..., m, d)."""
    m, d = points.shape[-2:]
    if m == d == 3:
        first, second = points[..., 1, :] - points[..., 0, :], points[..., 2, :] - points[..., 0, :]
        third = second - first
        normals = np.cross(first, second)
        area2 = np.einsum("...i,...i", normals, normals)
        # The squared singular values of three points have the sum `spread` and the product
        # `area2 / 3`. The cross product is accurate where a decomposition is not.
        spread = sum(np.einsum("...i,...i", side, side) for side in (first, second, third)) / 3
        degenerate = area2 / 3 <= (RANK_TOLERANCE * spread) ** 2
        length = np.sqrt(area2)
        normals /= np.where(length > 0, length, 1.0)[..., None]
        anchors = points[..., 0, :]
    else:
        anchors = points.mean(axis=-2)
        _, singular, axes = np.linalg.svd(points - anchors[..., None, :], full_matrices=m < d)
        normals = axes[..., -1, :].copy()
        degenerate = singular[..., d - 2] <= RANK_TOLERANCE * singular[..., 0]
    offsets = -np.einsum("...i,...i", normals, anchors)
    return normals, offsets, degenerate


def _nearest_members(local, normals, offsets, n_support, sizes):
    """Mask (B, T, k) of the h members nearest to each plane (step 2)."""
    k = local.shape[1]
    distances = np.abs(normals @ np.swapaxes(local, 1, 2) + offsets[..., None])
    # One integer-valued key holds the distance in steps and, in its last digits, the position.
    key = np.rint(distances / DISTANCE_STEP) * k + np.arange(k)
    key[np.broadcast_to((np.arange(k) >= sizes[:, None])[:, None], key.shape)] = np.inf
    support = np.empty(key.shape, dtype=bool)
    for h in np.unique(n_support):
        same = n_support == h
        limit = np.partition(key[same], h - 1, axis=-1)[..., h - 1]
        support[same] = key[same] <= limit[..., None]
    return support


def _least_eigenvalues(local, support, n_support):
    """Least eigenvalue of the covariance of each subset (step 3), in squared radii.

    It is infinite where the subset itself spans no plane: points of one line have the least
    eigenvalue zero, and no normal.
    """
    d = local.shape[-1]
    upper = np.triu_indices(d)
    products = local[..., upper[0]] * local[..., upper[1]]
    # Means and second moments of all subsets in one product of matrices.
    moments = support.astype(float) @ np.concatenate([local, products], axis=-1)
    moments /= n_support[:, None, None]
    mean, second = moments[..., :d], moments[..., d:]
    covariance = np.empty((*mean.shape, d))
    covariance[..., upper[0], upper[1]] = second
    covariance[..., upper[1], upper[0]] = second
    covariance -= mean[..., :, None] * mean[..., None, :]
    spread, axes = np.linalg.eigh(covariance)
    # The variance of the members along the axis, not the eigenvalue: far members within the plane
    # make the matrix so large that rounding could make any plane look perfect.
    along = (
        np.matmul(local[:, None], axes[..., :1])[..., 0]
        - np.matmul(mean[..., None, :], axes[..., :1])[..., 0]
    )
    least = np.einsum("btk,btk->bt", support, np.square(along)) / n_support[:, None]
    return np.where(_spans_no_plane(spread), np.inf, least)


def _spans_no_plane(eigenvalues):
    """Whether points with these eigenvalues (..., d), ascending, span no hyperplane."""
    if eigenvalues.shape[-1] == 1:  # in one dimension a point is a hyperplane
        return np.zeros(eigenvalues.shape[:-1], dtype=bool)
    return eigenvalues[..., 1] <= RANK_TOLERANCE**2 * eigenvalues[..., -1]
