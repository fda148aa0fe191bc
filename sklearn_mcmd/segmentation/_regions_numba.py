"""Growth, division and cylinders of regions, compiled.

Loops are in the place of linear algebra: Numba takes ten times as long to compile calls of BLAS and
LAPACK.
"""

from heapq import heapify, heappop, heappush

import numpy as np

from sklearn_mcmd.planes._explaining_numba import _root
from sklearn_mcmd.planes._moments_numba import eigh_3d
from sklearn_mcmd.runtime._kernels import kernel

N_PLANE = 3  # parameters of a plane
N_CYLINDER = 5  # and of a cylinder
# The points that a surface is fitted to; with plain numbers, `_fitted` is compiled for each.
OTHER, FIRST, BOTH = np.int64(0), np.int64(1), np.int64(2)
NOTHING = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)  # to be added to a scatter


@kernel(cache=True)
def grow(links, seeds):
    """Labels of regions, as of `grow_regions`."""
    n, width = links.shape
    labels = np.full(n, -1, np.int32)
    waiting = np.empty(n, np.int32)  # the current seed list, S_c
    region = 0
    for seed in seeds:
        if labels[seed] >= 0:
            continue
        labels[seed] = region
        waiting[0] = seed
        n_waiting = 1
        while n_waiting > 0:
            n_waiting -= 1
            i = waiting[n_waiting]
            for a in range(width):
                j = links[i, a]
                if j < 0:
                    break
                if labels[j] < 0:
                    labels[j] = region
                    waiting[n_waiting] = j
                    n_waiting += 1
        region += 1
    return labels


@kernel(cache=True)
def fit_cylinder(points, starts, limits, equations, model):
    """Fill the model (point, axis, radius) of centered points, and return the sum of squares.

    `equations` hold the normal equations and, last, their right side.
    """
    n = len(points)
    best = np.inf
    ridge = limits.ridge * n
    for start in range(len(starts)):
        axis = (starts[start, 0], starts[start, 1], starts[start, 2])
        point, radius = (0.0, 0.0, 0.0), -1.0
        last = np.inf
        for step in range(limits.n_steps + 1):
            u, v = _across(axis)
            if step == 0:
                _circle(points, u, v, ridge, equations)
                a, b = equations[0, N_CYLINDER], equations[1, N_CYLINDER]
                point = _moved(point, a, u, b, v)
                radius = np.sqrt(max(equations[2, N_CYLINDER] + a * a + b * b, 0.0))
            total = _linearize(points, point, axis, u, v, radius, limits.ridge, equations)
            if total < best:
                best = total
                for i in range(3):
                    model[i], model[3 + i] = point[i], axis[i]
                model[6] = radius
            if not total < (1.0 - limits.least_gain) * last:
                break
            last = total
            _solve(equations, ridge)
            point = _moved(point, equations[0, N_CYLINDER], u, equations[1, N_CYLINDER], v)
            axis = _moved(axis, equations[2, N_CYLINDER], u, equations[3, N_CYLINDER], v)
            axis = _scaled(axis, 1.0 / np.sqrt(_dot(axis, axis)))
            # Move the axis point back to the height of the points; any point of the axis will do.
            point = _moved(point, -_dot(point, axis), axis, 0.0, axis)
            radius = abs(radius + equations[4, N_CYLINDER])
    return best


@kernel
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel
def _scaled(a, factor):
    return a[0] * factor, a[1] * factor, a[2] * factor


@kernel
def _moved(a, s, u, t, v):
    """The point a + s u + t v."""
    return (a[0] + s * u[0] + t * v[0], a[1] + s * u[1] + t * v[1], a[2] + s * u[2] + t * v[2])


@kernel
def _across(axis):
    """Two directions across the axis."""
    x, y, z = abs(axis[0]), abs(axis[1]), abs(axis[2])
    one = (0.0, 0.0, 1.0)
    if x <= y and x <= z:
        one = (1.0, 0.0, 0.0)
    elif y <= z:
        one = (0.0, 1.0, 0.0)
    u = _moved(one, -_dot(one, axis), axis, 0.0, axis)
    u = _scaled(u, 1.0 / np.sqrt(_dot(u, u)))
    v = (
        axis[1] * u[2] - axis[2] * u[1],
        axis[2] * u[0] - axis[0] * u[2],
        axis[0] * u[1] - axis[1] * u[0],
    )
    return u, v


@kernel
def _circle(points, u, v, ridge, equations):
    """The algebraic circle of the points seen along the axis, to the last column.

    x^2 + y^2 is linear in the center's coordinates and a constant.
    """
    equations[:] = 0.0
    for i in range(len(points)):
        point = (points[i, 0], points[i, 1], points[i, 2])
        x, y = _dot(point, u), _dot(point, v)
        _add(equations, (2.0 * x, 2.0 * y, 1.0, 0.0, 0.0), x * x + y * y)
    _solve(equations, ridge)


@kernel
def _linearize(points, point, axis, u, v, radius, least, equations):
    """Sum of squared distances from a cylinder, and the normal equations of the next step."""
    equations[:] = 0.0
    total = 0.0
    for i in range(len(points)):
        gap = (points[i, 0] - point[0], points[i, 1] - point[1], points[i, 2] - point[2])
        along, x, y = _dot(gap, axis), _dot(gap, u), _dot(gap, v)
        reach = np.sqrt(x * x + y * y)
        away = reach - radius
        total += away * away
        reach = max(reach, least)
        x, y = x / reach, y / reach
        _add(equations, (x, y, along * x, along * y, 1.0), away)
    return total


@kernel
def _add(equations, row, right):
    """Add one equation, the first terms of a row, to the lower triangle of the normal ones."""
    n = len(equations)
    for i in range(n):
        for j in range(i + 1):
            equations[i, j] += row[i] * row[j]
        equations[i, n] += row[i] * right


@kernel
def _solve(equations, ridge):
    """Solve the normal equations by Cholesky's method, into the last column."""
    n = len(equations)
    for i in range(n):
        equations[i, i] += ridge
        for j in range(i):
            value = equations[i, j]
            for m in range(j):
                value -= equations[i, m] * equations[j, m]
            equations[i, j] = value / equations[j, j]
        pivot, value = equations[i, i], equations[i, n]
        for m in range(i):
            pivot -= equations[i, m] * equations[i, m]
            value -= equations[i, m] * equations[m, n]
        equations[i, i] = np.sqrt(pivot)
        equations[i, n] = value / equations[i, i]
    for i in range(n - 1, -1, -1):
        value = equations[i, n]
        for m in range(i + 1, n):
            value -= equations[m, i] * equations[m, n]
        equations[i, n] = value / equations[i, i]


@kernel(cache=True)
def gather_cells(order, near, labels):
    """Cells of the nearest points of the same region that no cell has, around points in order.

    Returns the members, cell after cell; where each cell starts; and the cell of each point.
    """
    cell = np.full(len(labels), -1, np.int32)
    members, starts = np.empty(len(order), np.int32), np.zeros(len(order) + 1, np.int64)
    n_cells = n_members = 0
    for i in order:
        if cell[i] >= 0:
            continue
        for a in range(near.shape[1]):
            j = near[i, a]
            if cell[j] < 0 and labels[j] == labels[i]:
                cell[j] = n_cells
                members[n_members] = j
                n_members += 1
        n_cells += 1
        starts[n_cells] = n_members
    return members, starts[: n_cells + 1].copy(), cell


@kernel(cache=True)
def join_cells(sizes, weights, means, scatters, edges):
    """Join cells to patches, the most alike first: the first cell of each one's patch.

    Points, weights, means and scatter (m, 6), in units of noise, become those of the patches. The
    loss is the growth of the sum of squares about planes, when one takes the place of two, over the
    variance factor of the two if that is above 1. The BIC charges the numbers of a plane.
    """
    m = len(sizes)
    left, turn, root = np.empty(m), np.zeros(m, np.int64), np.arange(m)
    for c in range(m):
        left[c] = eigh_3d(_scatter(scatters, c, NOTHING))[0][0]
    heap = [(0.0, 0, 0, 0) for _ in range(0)]
    for e in range(len(edges)):
        a, b = edges[e]
        loss, charge = _loss(a, b, sizes, weights, means, scatters, left)
        if loss <= charge:
            heap.append((loss, a, b, np.int64(0)))
    heapify(heap)
    while len(heap) > 0:
        _, a, b, stamp = heappop(heap)
        a, b = _root(root, a), _root(root, b)
        a, b = min(a, b), max(a, b)
        if a == b:
            continue
        if turn[a] + turn[b] != stamp:  # one has grown since
            loss, charge = _loss(a, b, sizes, weights, means, scatters, left)
            if loss <= charge:
                heappush(heap, (loss, a, b, turn[a] + turn[b]))
            continue
        total, moved = _pooled(a, b, weights, means, scatters)
        share = weights[b] / total
        for axis in range(3):
            means[a, axis] += share * (means[b, axis] - means[a, axis])
        for place in range(6):
            scatters[a, place] = moved[place]
        weights[a] = total
        sizes[a] += sizes[b]
        left[a] = eigh_3d(moved)[0][0]
        root[b] = a
        turn[a] += turn[b] + 1
    for c in range(m):
        root[c] = _root(root, c)
    return root


@kernel
def _loss(a, b, sizes, weights, means, scatters, left):
    """What is lost if one plane explains two patches, and the BIC's charge for a plane."""
    apart, n = left[a] + left[b], sizes[a] + sizes[b]
    _, pooled = _pooled(a, b, weights, means, scatters)
    factor = max(1.0, apart / max(n - 2 * N_PLANE, 1.0))
    return (eigh_3d(pooled)[0][0] - apart) / factor, N_PLANE * np.log(n)


@kernel
def _pooled(a, b, weights, means, scatters):
    """Weight and scatter of two patches together."""
    total = weights[a] + weights[b]
    f = weights[a] * weights[b] / total
    x, y, z = means[b, 0] - means[a, 0], means[b, 1] - means[a, 1], means[b, 2] - means[a, 2]
    apart = (f * x * x, f * x * y, f * x * z, f * y * y, f * y * z, f * z * z)
    return total, _scatter(scatters, b, _scatter(scatters, a, apart))


@kernel
def _scatter(scatters, c, more):
    s = scatters[c]
    low = s[0] + more[0], s[1] + more[1], s[2] + more[2]
    return (*low, s[3] + more[3], s[4] + more[4], s[5] + more[5])


@kernel(cache=True)
def vote(points, weights, cells, first, normals, limits, most_noise, sides):
    """Is a border no crease? Half the difference of BIC, above 0 for one smooth surface.

    One surface is a quadric over the mean of both planes, with six numbers. The other model are two
    planes that meet in their line of intersection, six as well. The line tells the sides, since
    sides as labels tell them are sorted by the noise. If they are told by labels all the same, for
    a step, the rest must be smaller by `most_noise`. The second region costs the numbers of a
    plane. Points of one cell whose deviations have the same sign count as fewer.

    Points (n, 3) are near the origin, weights (n,) inverse standard deviations, cells ascend on
    each side, `first` (n,) are the points of one side by labels, normals (2, 3) of both patches.
    `sides` (n,) becomes those points as the better model of two surfaces tells them.
    """
    local = _over_mean_plane(points, normals)
    one = _fitted(local, weights, first, BOTH, limits.ridge)
    smooth = _rest(local, weights, first, one, one)
    side, left, crease, sign = first, np.inf, smooth, 0.0
    step = smooth
    for turn in range(limits.n_steps + 1):
        n_first = 0
        for inside in side:
            n_first += inside
        if min(n_first, len(side) - n_first) <= N_PLANE:
            break
        one = _fitted(local, weights, side, FIRST, limits.ridge)
        other = _fitted(local, weights, side, OTHER, limits.ridge)
        if turn == 0:  # is it a ridge or a valley?
            step = _rest(local, weights, side, one, other)
            below = 0
            for i in range(len(side)):
                below += side[i] == (one[i] < other[i])
            sign = 1.0 if 2 * below > len(side) else -1.0
        found, same = np.empty_like(side), True
        for i in range(len(side)):
            found[i] = sign * (one[i] - other[i]) < 0
            same &= found[i] == side[i]
        rest = _rest(local, weights, found, one, other)
        if turn > 0 and _squares(rest) < left:
            left, crease = _squares(rest), rest
            sides[:] = found
        if turn > 0 and same:
            break
        side = found
    if sign == 0.0:
        return limits.ridge  # too few to tell
    smooth_left = _squares(smooth)
    step_left = most_noise**2 * _squares(step)
    if step_left < left:
        left = step_left
        sides[:] = first
    size = len(first) / _design_effect(smooth if smooth_left <= left else crease, cells)
    least, size = limits.ridge * len(first), max(size, 2.0)
    gain = np.log(left + least) - np.log(smooth_left + least)
    return 0.5 * (size * gain + N_PLANE * np.log(size))


@kernel
def _rest(local, weights, first, one, other):
    """Weighted heights of points above one surface, or for those that are not first the other."""
    rest = np.empty(len(local))
    for i in range(len(local)):
        rest[i] = (local[i, 2] - (one[i] if first[i] else other[i])) * weights[i]
    return rest


@kernel
def _squares(rest):
    total = 0.0
    for value in rest:
        total += value * value
    return total


@kernel
def _design_effect(rest, cells):
    """By what factor the sums of cells vary more than those of independent deviations do."""
    squares = total = sums = 0.0
    for i in range(len(rest)):
        if i > 0 and cells[i] != cells[i - 1]:
            sums += total * total
            total = 0.0
        total += rest[i]
        squares += rest[i] * rest[i]
    sums += total * total
    return max(sums / squares, 1.0) if squares > 0.0 else 1.0


@kernel
def _over_mean_plane(points, normals):
    """Coordinates (n, 3) in and over the mean of two planes; those in it are near 1."""
    a = (normals[0, 0], normals[0, 1], normals[0, 2])
    b = (normals[1, 0], normals[1, 1], normals[1, 2])
    up = _moved(a, 1.0 if _dot(a, b) >= 0.0 else -1.0, b, 0.0, b)
    up = _scaled(up, 1.0 / np.sqrt(_dot(up, up)))
    u, v = _across(up)
    local = np.empty_like(points)
    for i in range(len(points)):
        point = (points[i, 0], points[i, 1], points[i, 2])
        local[i, 0], local[i, 1], local[i, 2] = _dot(point, u), _dot(point, v), _dot(point, up)
    for axis in range(3):
        total = 0.0
        for i in range(len(points)):
            total += local[i, axis]
        for i in range(len(points)):
            local[i, axis] -= total / len(points)
    square = 0.0
    for i in range(len(points)):
        square += local[i, 0] * local[i, 0] + local[i, 1] * local[i, 1]
    size = np.sqrt(square / len(points))
    for i in range(len(points) if size > 0.0 else 0):
        local[i, 0], local[i, 1] = local[i, 0] / size, local[i, 1] / size
    return local


@kernel
def _fitted(local, weights, side, wanted, ridge):
    """Heights (n,) of the plane that fits one side best, or of the quadric that fits both."""
    order = 6 if wanted == BOTH else N_PLANE
    equations, heights, total = np.zeros((order, order + 1)), np.empty(len(local)), 0.0
    for i in range(len(local)):
        if wanted == BOTH or side[i] == wanted:
            x, y, w = local[i, 0], local[i, 1], weights[i]
            terms = (w, w * x, w * y, w * x * x, w * x * y, w * y * y)
            _add(equations, terms, w * local[i, 2])
            total += w * w
    _solve(equations, ridge * total)
    c = equations[:, order]
    for i in range(len(local)):
        x, y = local[i, 0], local[i, 1]
        heights[i] = c[0] + c[1] * x + c[2] * y
        if order > N_PLANE:
            heights[i] += c[3] * x * x + c[4] * x * y + c[5] * y * y
    return heights
