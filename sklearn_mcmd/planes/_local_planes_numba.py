"""The rules of ``_rules`` and Algorithm 4 around them in three dimensions, compiled."""

import numpy as np

from sklearn_mcmd.planes._consistent_set_numba import NO_FIT, ZEROS, WorkArrays, consistent_set
from sklearn_mcmd.planes._moments_numba import (
    FASTMATH,
    kth_smallest,
    principal_axes,
    variance_along,
    vector,
    weighted_covariance,
)
from sklearn_mcmd.runtime._kernels import kernel

TIED = 1e-9  # share by which robust scales may differ by rounding
MAGNITUDE = np.int64(2**63 - 1)  # all bits but the sign
# What takes plain numbers and truth values is compiled for each.
NONE, BY_MEDIAN, BY_EXTENT = np.int64(0), np.bool_(True), np.bool_(False)
FITTED, UNFITTED = np.bool_(True), np.bool_(False)
# Of each rule of `METHODS`: whether it needs the consistent set, and True if distances within the
# plane count too, else None. Numba drops the branches of arguments that are None, but not of
# others, before it compiles. So the default does not compile "mcmd_md".
FORMS = {"pca": (False, None), "mcmd_z": (True, None), "mcmd_md": (True, True)}


def fit_neighborhoods(points, around, queries, trials, method, rule, out):
    """Apply a rule to each neighborhood (Algorithm 4), one row at a time.

    What is filled, `out`, are `RobustPlanes`.
    """
    arrays = WorkArrays.of(len(trials.positions), around.indices.shape[1])
    robust, within = FORMS[method]
    _fit_neighborhoods(points, around, queries, trials, rule, robust, within, arrays, out)


def ask_neighbors(points, around, queries, offers, method, rule, out):
    """Apply a rule to each neighborhood, from the best of the planes that its members offer.

    Else as `fit_neighborhoods`.
    """
    arrays = WorkArrays.of(1, around.indices.shape[1])
    _, within = FORMS[method]
    _ask_neighbors(points, around, queries, offers, rule, within, arrays, out)


@kernel(cache=True)
def _fit_neighborhoods(points, around, queries, trials, rule, robust, within, arrays, out):
    planes, _, distance = out
    for i in range(len(queries)):
        size, row = around.sizes[i], around.indices[i]
        radius, floor = _localize(points, row, size, queries[i], rule, arrays, BY_MEDIAN)
        degenerate, fit = False, NO_FIT
        if robust:
            least, fit = consistent_set(size, trials, arrays)
            degenerate = least < 0.0
        if degenerate or not robust:
            distance[i], scale = _pca(size, rule, floor, arrays)
            if degenerate:
                distance[i], scale = 0.0, -1.0  # the caller decides
        else:
            distance[i], scale, _, _ = _judge(size, fit, 0.0, rule, within, floor, arrays)
        planes.scale[i] = scale * radius
        _store(points[row[0]], radius, size, rule, arrays, UNFITTED, NO_FIT, out, i)


@kernel(cache=True)
def _ask_neighbors(points, around, queries, offers, rule, within, arrays, out):
    planes, _, distance = out
    values = planes.eigenvalues
    for i in range(len(queries)):
        size, row = around.sizes[i], around.indices[i]
        radius, floor = _localize(points, row, size, queries[i], rule, arrays, BY_EXTENT)
        fit, first = _best_offer(points, row, size, radius, floor, offers, rule, arrays)
        flat = first < 0.0
        if not flat:
            distance[i], scale, fitted, fit = _judge(size, fit, first, rule, within, floor, arrays)
            planes.scale[i] = scale * radius
            _store(points[row[0]], radius, size, rule, arrays, fitted, fit, out, i)
            flat = values[i, 1] <= rule.rank_tolerance * values[i, rule.d - 1]
        if flat:
            distance[i], planes.scale[i] = 0.0, -1.0  # the caller decides
            arrays.member[:] = 1.0
            _store(points[row[0]], radius, size, rule, arrays, UNFITTED, NO_FIT, out, i)


@kernel
def _best_offer(points, row, size, radius, floor, offers, rule, arrays):
    """The offered plane about which the members have the least robust scale, an S-estimate.

    It is where squared distances in its units, each at most one, have the mean that as many
    outliers as may be would reach alone. Returns the plane and the scale that a refit begins
    with: the robust one, or the usual one of the planes offered; negative if no plane is offered.
    """
    # Step 1: the usual scale of the planes offered.
    local, distances, origin, n_offers = arrays.local, arrays.numbers, vector(points[row[0]]), NONE
    for j in range(size):
        if offers.scale[row[j]] >= 0.0:  # else there is no plane
            distances[n_offers] = offers.scale[row[j]]
            n_offers += 1
    if n_offers == 0:
        return NO_FIT, -1.0
    arrays.keys[0] = kth_smallest(arrays.bits, n_offers, (n_offers + 1) // 2)
    usual = arrays.key_numbers[0] / radius
    # Step 2: the plane of the least robust scale. A plane whose squares at the best scale so far
    # sum up to more is no better, and most are left at that sum.
    wanted = max(rule.outliers * size, 1.0)
    most, reached, fit = np.inf, wanted, NO_FIT
    for j in range(size):
        neighbor = row[j]
        if offers.scale[neighbor] < 0.0:
            continue
        axes, centroid = vector(offers.normals[neighbor]), vector(offers.centroids[neighbor])
        height = axes[0] * (origin[0] - centroid[0]) + axes[1] * (origin[1] - centroid[1])
        height = (height + axes[2] * (origin[2] - centroid[2])) / radius
        # Of planes that are equal but for rounding, the nearest point's is taken.
        if _limited(local, size, axes, height, 1.0 / most) < reached * (1.0 - TIED):
            mean = -height * axes[0], -height * axes[1], -height * axes[2]
            fit = mean, ZEROS, (axes, ZEROS, ZEROS)
            _signed_distances(local, size, mean, axes, distances)
            most, reached = _robust_square(distances, size, wanted, most, floor * floor)
    # Step 3: the least of many scales is too small, by the factor of least median of squares. Where
    # the usual one is smaller, it tells what is near, if that may be a face.
    scale = (1.0 + 5.0 / max(size - rule.d, 1)) * np.sqrt(most)
    if usual < scale:
        near = rule.reweight_cutoff * usual
        _, off = _sums_within(distances, size, near * near)
        if size - off >= rule.least_face * size:
            return fit, usual
    return fit, scale


@kernel(fastmath=FASTMATH)
def _limited(local, size, normal, height, scale):
    """Sum of the members' squared distances from a plane, times a scale, each at most one."""
    x, y, z = local[0], local[1], local[2]
    nx, ny, nz = normal
    total = 0.0
    for j in range(size):
        distance = nx * x[j] + ny * y[j] + nz * z[j] + height
        square = distance * distance * scale
        total += square if square < 1.0 else 1.0
    return total


@kernel
def _robust_square(distances, size, wanted, most, least):
    """The square of the robust scale of distances, `least` at least, and the sum there.

    Newton's method falls from `most` to the root, since the sum is concave in the scale's inverse.
    """
    reached = 0.0
    for _ in range(size):
        inside, off = _sums_within(distances, size, most)
        reached = inside / most + off
        if reached >= wanted * (1.0 - TIED) or most <= least:
            break
        # The scale at which what is inside makes up for the others, each of which counts one.
        most = max(inside / (wanted - off), least)
    return most, reached


@kernel(fastmath=FASTMATH)
def _sums_within(distances, size, most):
    """Sum of the squares that are no larger than `most`, and number of the others."""
    total = n_inside = 0.0
    for j in range(size):
        square = distances[j] * distances[j]
        inside = 1.0 if square < most else 0.0
        total += inside * square
        n_inside += inside
    return total, size - n_inside


@kernel
def _judge(size, fit, first, rule, within, floor, arrays):
    """Apply a rule from a first plane: distance of the query, scale, and members that are kept.

    `first` is the scale to begin with, 0 if that is not known. The plane fitted last comes too, and
    before it whether it is fitted to the members that are kept.
    """
    if within is None:
        return _mcmd_z(size, fit, first, rule, floor, arrays)
    return _mcmd_md(size, fit, first, rule, floor, arrays)


@kernel
def _store(origin, radius, size, rule, arrays, fitted, fit, out, i):
    """Fill the plane of the members that are kept: `fit`, if it is `fitted` to them."""
    planes, directions, _ = out
    member, n_kept = arrays.member, 0.0
    for j in range(size):
        n_kept += member[j]
    planes.kept[i] = n_kept / size
    mean, values, axes = fit
    if not fitted:
        mean, covariance = weighted_covariance(arrays.local, size, member)
        values, axes = principal_axes(covariance, rule.d)
    for axis in range(rule.d):
        planes.centroids[i, axis] = origin[axis] + radius * mean[axis]
        planes.eigenvalues[i, axis] = values[axis] * radius * radius
        planes.normals[i, axis] = axes[0][axis]
        directions[i, axis] = axes[rule.d - 1][axis]


@kernel
def _localize(points, row, size, query, rule, arrays, by_median):
    """Shift a neighborhood to its first point and scale its median radius, or its extent, to one.

    Fills the coordinates of members and query, and takes all members. Returns the radius and the
    least scale, in radii.
    """
    local, work, keys = arrays.local, arrays.numbers, arrays.keys
    extent = magnitude = 0.0
    radius, first, at_query = 1.0, vector(points[row[0]]), vector(query)
    for j in range(size):
        point = vector(points[row[j]])
        for axis in range(3):
            value = point[axis] - first[axis]
            local[axis, j] = value
            extent = max(extent, abs(value))
    if extent > 0.0:
        radius = extent
        if by_median:  # of distances over the extent: squares of 1e-200 would vanish
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
    for axis in range(3):
        arrays.query[axis] = (at_query[axis] - first[axis]) / radius
        magnitude = max(magnitude, abs(first[axis]))
    arrays.member[:] = 1.0
    return radius, max(rule.rounding * (magnitude / radius + 1.0), rule.least_scale / radius)


@kernel
def _pca(size, rule, floor, arrays):
    local, member, query = arrays.local, arrays.member, arrays.query
    mean, covariance = weighted_covariance(local, size, member)
    _, axes = principal_axes(covariance, rule.d)
    variance = variance_along(local, size, member, mean, axes[0])
    # The plane has d numbers, so many degrees of freedom fewer are left.
    scale = max(np.sqrt(variance * size / max(size - rule.d, 1)), floor)
    return abs(_project(query, mean, axes[0])) / scale, scale


@kernel
def _mcmd_z(size, fit, first, rule, floor, arrays):
    local, member, query, work = arrays.local, arrays.member, arrays.query, arrays.numbers
    center = 0.0
    if rule.reweight:
        mean, values, axes, scale, _ = _reweighted_plane(size, fit, first, rule, floor, arrays)
        _signed_distances(local, size, mean, axes[0], work)
    else:
        mean, values, axes = fit
        _signed_distances(local, size, mean, axes[0], work)
        # Median and MAD of the distances (Eq. 17).
        center = _median(size, arrays)
        for j in range(size):
            work[j] = abs(work[j] - center)
        scale = max(rule.mad_to_sd * _median(size, arrays), floor)
        _signed_distances(local, size, mean, axes[0], work)
    limit, n_changed = rule.cutoff * scale, 0.0
    for j in range(size):
        kept = 1.0 if abs(work[j] - center) < limit else 0.0
        n_changed += abs(kept - member[j])
        member[j] = kept
    fitted = FITTED if rule.reweight and n_changed == 0.0 else UNFITTED
    return abs(_project(query, mean, axes[0]) - center) / scale, scale, fitted, (mean, values, axes)


@kernel
def _mcmd_md(size, fit, first, rule, floor, arrays):
    local, member, query, work = arrays.local, arrays.member, arrays.query, arrays.numbers
    if rule.reweight:
        mean, values, axes, scale, n_used = _reweighted_plane(size, fit, first, rule, floor, arrays)
    else:
        mean, values, axes = fit
        n_used = 0.0
        for j in range(size):
            n_used += member[j]
        variance = variance_along(local, size, member, mean, axes[0])
        scale = max(np.sqrt(variance * n_used / max(n_used - 1.0, 1.0)), floor)
    # Eq. 18; eigenvalues have the divisor n, covariances n - 1.
    correction = n_used / max(n_used - 1.0, 1.0)
    middle = max(np.sqrt(values[1] * correction), floor)
    most = max(np.sqrt(values[2] * correction), floor)
    for j in range(size):
        work[j] = 0.0
    square = 0.0
    for axis, deviation in zip(axes, (scale, middle, most)):  # noqa: B905
        _add_squared(local, size, mean, axis, deviation, work)
        square += (_project(query, mean, axis) / deviation) ** 2
    for j in range(size):
        member[j] = 1.0 if work[j] < rule.cutoff * rule.cutoff else 0.0
    return np.sqrt(square), scale, UNFITTED, (mean, values, axes)


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
def _reweighted_plane(size, fit, first, rule, floor, arrays):
    """As in ``_rules``, but for the first scale if it is known; takes the members that are kept."""
    local, member, work = arrays.local, arrays.member, arrays.numbers
    mean, values, axes = fit
    _signed_distances(local, size, mean, axes[0], work)
    for j in range(size):
        work[j] = abs(work[j])
    # As of least median of squares (Rousseeuw and Leroy, 1987, chapter 5).
    factor = rule.mad_to_sd * (1.0 + 5.0 / max(size - rule.d, 1))
    scale = max(first if first > 0.0 else factor * _median(size, arrays), floor)
    n_kept = 0.0
    for step in range(rule.reweight_steps):
        if step > 0:
            _signed_distances(local, size, mean, axes[0], work)
        n_kept = n_changed = 0.0
        for j in range(size):
            kept = 1.0 if abs(work[j]) < rule.reweight_cutoff * scale else 0.0
            n_changed += abs(kept - member[j])
            n_kept += kept
            member[j] = kept
        if step > 0 and n_changed == 0.0:
            break
        mean, covariance = weighted_covariance(local, size, member)
        values, axes = principal_axes(covariance, rule.d)
        variance = variance_along(local, size, member, mean, axes[0])
        # What was cut off would have made the variance larger.
        variance *= n_kept / max(n_kept - rule.d, 1.0) / rule.truncated_variance
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
