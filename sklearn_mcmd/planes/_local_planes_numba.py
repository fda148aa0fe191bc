"""The rules of ``_rules`` and Algorithm 4 around them in three dimensions, compiled."""

import numpy as np

from sklearn_mcmd.planes._consistent_set_numba import NO_FIT, WorkArrays, consistent_set_3d
from sklearn_mcmd.planes._moments_numba import (
    FASTMATH,
    eigh_3d,
    kth_smallest,
    variance_along,
    weighted_covariance,
)
from sklearn_mcmd.runtime._kernels import kernel

MAGNITUDE = np.int64(2**63 - 1)  # all bits but the sign
# Of each rule of `METHODS`: whether it needs the consistent set, and True if distances within the
# plane count too, else None. Numba drops the branches of arguments that are None, but not of
# others, before it compiles. So the default does not compile "mcmd_md".
FORMS = {"pca": (False, None), "mcmd_z": (True, None), "mcmd_md": (True, True)}


def fit_neighborhoods_3d(points, around, queries, trials, method, rule, out):
    """Apply a rule to each neighborhood (Algorithm 4), one row at a time.

    What is filled, `out`, are planes, except for extents and errors, directions (m, 3), the axes of
    the largest eigenvalues, and robust distances (m,) of the queries.
    """
    arrays = WorkArrays.of(len(trials.positions), around.indices.shape[1])
    _fit_neighborhoods(points, around, queries, trials, rule, *FORMS[method], arrays, *out)


@kernel(cache=True)
def _fit_neighborhoods(
    points,
    around,
    queries,
    trials,
    rule,
    robust,
    within,
    arrays,
    planes,
    directions,
    distance,
):
    local, member, query = arrays.local, arrays.member, arrays.query
    for i in range(len(queries)):
        size, row = around.sizes[i], around.indices[i]
        radius = _localize(points, row, size, local, arrays)
        magnitude = 0.0
        for axis in range(3):
            first = points[row[0], axis]
            query[axis] = (queries[i, axis] - first) / radius
            magnitude = max(magnitude, abs(first))
        floor = max(rule.rounding * (magnitude / radius + 1.0), rule.least_scale / radius)

        degenerate, fit = False, NO_FIT
        if robust:
            least, fit = consistent_set_3d(size, trials, arrays)
            degenerate = least < 0.0
        if degenerate or not robust:
            for j in range(size):
                member[j] = 1.0
            distance[i], scale = _pca(local, size, member, query, floor)
            if degenerate:
                distance[i], scale = 0.0, -1.0  # the caller decides
        elif within is None:
            distance[i], scale = _mcmd_z(local, size, member, fit, query, rule, floor, arrays)
        else:
            distance[i], scale = _mcmd_md(local, size, member, fit, query, rule, floor, arrays)
        planes.scale[i] = scale * radius

        n_kept = 0.0
        for j in range(size):
            n_kept += member[j]
        planes.kept[i] = n_kept / size
        mean, covariance = weighted_covariance(local, size, member)
        values, axes = eigh_3d(covariance)
        for axis in range(3):
            planes.centroids[i, axis] = points[row[0], axis] + radius * mean[axis]
            planes.eigenvalues[i, axis] = values[axis] * radius * radius
            planes.normals[i, axis] = axes[0][axis]
            directions[i, axis] = axes[2][axis]


@kernel
def _localize(points, row, size, local, arrays):
    """Shift a neighborhood to its first point and scale its median radius to one."""
    work, keys = arrays.numbers, arrays.keys
    extent = 0.0
    first = row[0]
    for j in range(size):
        for axis in range(3):
            value = points[row[j], axis] - points[first, axis]
            local[axis, j] = value
            extent = max(extent, abs(value))
    if extent == 0.0:
        return 1.0
    for j in range(size):
        norm = 0.0
        for axis in range(3):
            value = local[axis, j] / extent
            norm += value * value
        work[j] = np.sqrt(norm)
    _order_keys(size, arrays)
    middle = kth_smallest(keys, size, size // 2 + 1)
    if middle == 0:
        middle = kth_smallest(keys, size, size)
    radius = _decode(middle, arrays) * extent
    for axis in range(3):
        for j in range(size):
            local[axis, j] /= radius
    return radius


@kernel
def _pca(local, size, member, query, floor):
    mean, covariance = weighted_covariance(local, size, member)
    _, axes = eigh_3d(covariance)
    variance = variance_along(local, size, member, mean, axes[0])
    scale = max(np.sqrt(variance * size / max(size - 3, 1)), floor)
    return abs(_project(query, mean, axes[0])) / scale, scale


@kernel
def _mcmd_z(local, size, member, fit, query, rule, floor, arrays):
    work = arrays.numbers
    center = 0.0
    if rule.reweight:
        mean, _, axes, scale, _ = _reweighted_plane(local, size, member, fit, rule, floor, arrays)
        _signed_distances(local, size, mean, axes[0], work)
    else:
        mean, _, axes = fit
        _signed_distances(local, size, mean, axes[0], work)
        center = _median(size, arrays)
        for j in range(size):
            work[j] = abs(work[j] - center)
        scale = max(rule.mad_to_sd * _median(size, arrays), floor)
        _signed_distances(local, size, mean, axes[0], work)
    limit = rule.cutoff * scale
    for j in range(size):
        member[j] = 1.0 if abs(work[j] - center) < limit else 0.0
    return abs(_project(query, mean, axes[0]) - center) / scale, scale


@kernel
def _mcmd_md(local, size, member, fit, query, rule, floor, arrays):
    work = arrays.numbers
    if rule.reweight:
        mean, values, axes, scale, n_used = _reweighted_plane(
            local, size, member, fit, rule, floor, arrays
        )
    else:
        mean, values, axes = fit
        n_used = 0.0
        for j in range(size):
            n_used += member[j]
        variance = variance_along(local, size, member, mean, axes[0])
        scale = max(np.sqrt(variance * n_used / max(n_used - 1.0, 1.0)), floor)
    correction = n_used / max(n_used - 1.0, 1.0)
    middle = max(np.sqrt(values[1] * correction), floor)
    most = max(np.sqrt(values[2] * correction), floor)
    for j in range(size):
        work[j] = 0.0
    own = 0.0
    for axis, deviation in zip(axes, (scale, middle, most)):  # noqa: B905
        _add_squared(local, size, mean, axis, deviation, work)
        own += (_project(query, mean, axis) / deviation) ** 2
    for j in range(size):
        member[j] = 1.0 if work[j] < rule.cutoff * rule.cutoff else 0.0
    return np.sqrt(own), scale


@kernel(fastmath=FASTMATH)
def _add_squared(local, size, mean, axis, deviation, out):
    x, y, z = local[0], local[1], local[2]
    ax, ay, az = axis
    mx, my, mz = mean
    weight = 1.0 / deviation
    for j in range(size):
        projection = (ax * (x[j] - mx) + ay * (y[j] - my) + az * (z[j] - mz)) * weight
        out[j] += projection * projection


@kernel
def _reweighted_plane(local, size, member, fit, rule, floor, arrays):
    """As in ``_rules``; `member` then holds the members that were kept."""
    work = arrays.numbers
    mean, values, axes = fit
    _signed_distances(local, size, mean, axes[0], work)
    for j in range(size):
        work[j] = abs(work[j])
    factor = rule.mad_to_sd * (1.0 + 5.0 / max(size - 3, 1))
    scale = max(factor * _median(size, arrays), floor)
    n_kept = 0.0
    for step in range(rule.reweight_steps):
        if step > 0:
            _signed_distances(local, size, mean, axes[0], work)
        n_kept = 0.0
        for j in range(size):
            member[j] = 1.0 if abs(work[j]) < rule.reweight_cutoff * scale else 0.0
            n_kept += member[j]
        mean, covariance = weighted_covariance(local, size, member)
        values, axes = eigh_3d(covariance)
        variance = variance_along(local, size, member, mean, axes[0])
        variance *= n_kept / max(n_kept - 3.0, 1.0) / rule.truncated_variance
        scale = max(np.sqrt(variance), floor)
    return mean, values, axes, scale, n_kept


@kernel
def _project(query, mean, axis):
    return (
        axis[0] * (query[0] - mean[0])
        + axis[1] * (query[1] - mean[1])
        + axis[2] * (query[2] - mean[2])
    )


@kernel(fastmath=FASTMATH)
def _signed_distances(local, size, mean, normal, out):
    x, y, z = local[0], local[1], local[2]
    nx, ny, nz = normal[0], normal[1], normal[2]
    mx, my, mz = mean
    for j in range(size):
        out[j] = nx * (x[j] - mx) + ny * (y[j] - my) + nz * (z[j] - mz)


@kernel
def _median(size, arrays):
    """The median of the first `size` numbers."""
    _order_keys(size, arrays)
    keys = arrays.keys
    lower = upper = kth_smallest(keys, size, (size + 1) // 2)
    if size % 2 == 0:
        upper, n_lower = MAGNITUDE, 0  # the smallest key above, and the keys up to it
        for j in range(size):
            inside = keys[j] <= lower
            n_lower += 1 if inside else 0
            upper = upper if inside else min(upper, keys[j])
        upper = lower if n_lower > size // 2 else upper
    return 0.5 * (_decode(lower, arrays) + _decode(upper, arrays))


@kernel
def _order_keys(size, arrays):
    """Integers that sort like the numbers: their bits, negated below zero."""
    bits, keys = arrays.bits, arrays.keys
    for j in range(size):
        keys[j] = bits[j] if bits[j] >= 0 else -(bits[j] & MAGNITUDE)


@kernel
def _decode(key, arrays):
    """The number of a key; overwrites the first of the keys."""
    arrays.keys[0] = abs(key)
    value = arrays.key_numbers[0]
    return value if key >= 0 else -value
