"""Growth, division and cylinders of regions, compiled.

Loops are in the place of linear algebra: Numba takes ten times as long to compile calls of BLAS and
LAPACK. Python makes the arrays, as what makes them takes long to compile, and what copies one to
another takes seconds.
"""

from heapq import heappop, heappush

import numpy as np

from sklearn_mcmd.planes._explaining_numba import _root
from sklearn_mcmd.planes._moments_numba import eigh_3d
from sklearn_mcmd.runtime._kernels import kernel

# Parameters of a plane and of a cylinder, and points that a surface is fitted to; with plain
# numbers, what takes them is compiled for each.
N_PLANE, N_CYLINDER = np.int64(3), np.int64(5)
OTHER, FIRST, BOTH = np.int64(0), np.int64(1), np.int64(2)
NOTHING = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)  # to be added to a scatter


@kernel(cache=True)
def grow(links, seeds, waiting, labels):
    """Fill the labels of regions, -1 at first, as of `grow_regions`.

    `waiting` (n,) has room for the current seed list, S_c.
    """
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
            for a in range(links.shape[1]):
                j = links[i, a]
                if j < 0:
                    break
                if labels[j] < 0:
                    labels[j] = region
                    waiting[n_waiting] = j
                    n_waiting += 1
        region += 1


@kernel(cache=True)
def fit_cylinder(points, starts, limits, equations, model):
    """Fill the model (point, axis, radius) of centered points, and return the sum of squares.

    `equations` hold the normal equations, last their right side, and below them one to be added.
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
            _solve(equations, N_CYLINDER, ridge)
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
    new = equations[N_CYLINDER]
    new[2] = 1.0
    for i in range(len(points)):
        point = (points[i, 0], points[i, 1], points[i, 2])
        x, y = _dot(point, u), _dot(point, v)
        new[0], new[1], new[N_CYLINDER] = 2.0 * x, 2.0 * y, x * x + y * y
        _add(equations, N_CYLINDER)
    _solve(equations, N_CYLINDER, ridge)


@kernel
def _linearize(points, point, axis, u, v, radius, least, equations):
    """Sum of squared distances from a cylinder, and the normal equations of the next step."""
    equations[:] = 0.0
    new = equations[N_CYLINDER]
    new[4] = 1.0
    total = 0.0
    for i in range(len(points)):
        gap = (points[i, 0] - point[0], points[i, 1] - point[1], points[i, 2] - point[2])
        along, x, y = _dot(gap, axis), _dot(gap, u), _dot(gap, v)
        reach = np.sqrt(x * x + y * y)
        away = reach - radius
        total += away * away
        reach = max(reach, least)
        new[0], new[1], new[N_CYLINDER] = x / reach, y / reach, away
        new[2], new[3] = along * new[0], along * new[1]
        _add(equations, N_CYLINDER)
    return total


@kernel
def _add(equations, n):
    """Add the equation in row n to the lower triangle of the normal ones."""
    for i in range(n):
        for j in range(i + 1):
            equations[i, j] += equations[n, i] * equations[n, j]
        equations[i, n] += equations[n, i] * equations[n, n]


@kernel
def _solve(equations, n, ridge):
    """Solve the normal equations by Cholesky's method, into column n."""
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
def gather_cells(order, near, labels, members, starts, cell):
    """Fill cells of the nearest points of the same region that no cell has, around points in order.

    That is the members, cell after cell; where each cell starts; and the cell of each point, -1 at
    first. Returns the number of cells.
    """
    n_cells = n_members = 0
    starts[0] = 0
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
    return n_cells


@kernel(cache=True)
def join_cells(sizes, weights, means, scatters, edges, left, turn, root):
    """Join cells to patches, the most alike first: `root` becomes the first cell of each's patch.

    Points, weights, means and scatter (m, 6), in units of noise, become those of the patches. The
    loss is the growth of the sum of squares about planes, when one takes the place of two, over the
    variance factor of the two if that is above 1. The BIC charges the numbers of a plane.

    `left` has room for sums of squares. `turn` has 0 of each cell at first, and `root` its number.
    """
    m = len(sizes)
    for c in range(m):
        left[c] = eigh_3d(_scatter(scatters, c, NOTHING))[0][0]
    heap = [(0.0, 0, 0, 0) for _ in range(0)]
    for e in range(len(edges)):
        a, b = edges[e]
        _push(heap, a, b, sizes, weights, means, scatters, left, turn)
    while len(heap) > 0:
        _, a, b, stamp = heappop(heap)
        a, b = _root(root, a), _root(root, b)
        a, b = min(a, b), max(a, b)
        if a == b:
            continue
        if turn[a] + turn[b] != stamp:  # one has grown since
            _push(heap, a, b, sizes, weights, means, scatters, left, turn)
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


@kernel
def _push(heap, a, b, sizes, weights, means, scatters, left, turn):
    """Let two patches wait for each other if the BIC's charge for a plane is not less than what is
    lost if one plane explains both."""
    apart, n = left[a] + left[b], sizes[a] + sizes[b]
    _, pooled = _pooled(a, b, weights, means, scatters)
    factor = max(1.0, apart / max(n - 2 * N_PLANE, 1.0))
    loss = (eigh_3d(pooled)[0][0] - apart) / factor
    if loss <= N_PLANE * np.log(n):
        heappush(heap, (loss, a, b, turn[a] + turn[b]))


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
def vote(points, weights, cells, first, normals, limits, most_noise, blunt, room, equations, sides):
    """Is a border no crease? Half the difference of BIC, above 0 for one smooth surface.

    One surface is a quadric over the mean of both planes, with six numbers. The other model are two
    planes that meet in their line of intersection, six as well. The line tells the sides, since
    sides as labels tell them are sorted by the noise. If they are told by labels all the same, for
    a step, the rest must be smaller by `most_noise`; a `blunt` crease is none, but may be a step.
    The second region costs the numbers of a plane. Points of one cell whose deviations have the
    same sign count as fewer.

    Points (n, 3) are near the origin, weights (n,) inverse standard deviations, cells ascend on
    each side, `first` (n,) are the points of one side by labels, normals (2, 3) of both patches.
    Points, `room` (5, n) and `equations` (7, 7) are overwritten. Of `sides` (2, n), both `first`,
    the second becomes those points as the better model of two surfaces tells them.
    """
    n, side, ridge, one, other = len(points), sides[0], limits.ridge, room[0], room[1]
    smooth = crease = 2  # rows of the room with what the models leave
    _over_mean_plane(points, normals)
    _fit(points, weights, first, BOTH, ridge, equations, one)
    smooth_left = _squares(points, weights, first, one, one, room[smooth])
    left, step, sign = np.inf, np.inf, 0.0
    for turn in range(limits.n_steps + 1):
        n_first = 0
        for i in range(n):
            n_first += side[i]
        if min(n_first, n - n_first) <= N_PLANE:
            break
        _fit(points, weights, side, FIRST, ridge, equations, one)
        _fit(points, weights, side, OTHER, ridge, equations, other)
        if turn == 0:  # is it a ridge or a valley?
            step = _squares(points, weights, side, one, other, room[3])
            below = 0
            for i in range(n):
                below += side[i] == (one[i] < other[i])
            sign = 1.0 if 2 * below > n else -1.0
        same = True
        for i in range(n):
            found = sign * (one[i] - other[i]) < 0
            same &= found == side[i]
            side[i] = found
        rest = 3 if crease != 3 else 4
        squares = _squares(points, weights, side, one, other, room[rest])
        if turn > 0 and squares < left:
            left, crease = squares, rest
            for i in range(n):
                sides[1, i] = side[i]
        if turn > 0 and same:
            break
    if sign == 0.0:
        return ridge  # too few to tell
    if blunt or most_noise**2 * step < left:
        left = most_noise**2 * step
        for i in range(n):
            sides[1, i] = first[i]
    size = n / _design_effect(room[smooth if smooth_left <= left else crease], cells)
    least, size = ridge * n, max(size, 2.0)
    gain = np.log(left + least) - np.log(smooth_left + least)
    return 0.5 * (size * gain + N_PLANE * np.log(size))


@kernel
def _squares(local, weights, first, one, other, rest):
    """Fill the weighted heights of points above one surface, or for those that are not first the
    other; the sum of their squares."""
    total = 0.0
    for i in range(len(local)):
        rest[i] = (local[i, 2] - (one[i] if first[i] else other[i])) * weights[i]
        total += rest[i] * rest[i]
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
    """Turn points to coordinates in and over the mean of two planes; those in it are near 1."""
    a = (normals[0, 0], normals[0, 1], normals[0, 2])
    b = (normals[1, 0], normals[1, 1], normals[1, 2])
    up = _moved(a, 1.0 if _dot(a, b) >= 0.0 else -1.0, b, 0.0, b)
    up = _scaled(up, 1.0 / np.sqrt(_dot(up, up)))
    u, v = _across(up)
    for i in range(len(points)):
        point = (points[i, 0], points[i, 1], points[i, 2])
        points[i, 0], points[i, 1], points[i, 2] = _dot(point, u), _dot(point, v), _dot(point, up)
    for axis in range(3):
        total = 0.0
        for i in range(len(points)):
            total += points[i, axis]
        for i in range(len(points)):
            points[i, axis] -= total / len(points)
    square = 0.0
    for i in range(len(points)):
        square += points[i, 0] * points[i, 0] + points[i, 1] * points[i, 1]
    size = np.sqrt(square / len(points))
    for i in range(len(points) if size > 0.0 else 0):
        points[i, 0], points[i, 1] = points[i, 0] / size, points[i, 1] / size


@kernel
def _fit(local, weights, side, wanted, ridge, equations, heights):
    """Fill the heights of the plane that fits one side best, or of the quadric that fits both."""
    order, total = 6 if wanted == BOTH else N_PLANE, 0.0
    equations[:] = 0.0
    c = equations[order]
    for i in range(len(local)):
        if wanted == BOTH or side[i] == wanted:
            x, y, w = local[i, 0], local[i, 1], weights[i]
            c[3], c[4], c[5] = w * x * x, w * x * y, w * y * y
            c[0], c[1], c[2], c[order] = w, w * x, w * y, w * local[i, 2]
            _add(equations, order)
            total += w * w
    _solve(equations, order, ridge * total)
    for i in range(order):
        c[i] = equations[i, order]
    for i in range(len(local)):
        x, y = local[i, 0], local[i, 1]
        heights[i] = c[0] + c[1] * x + c[2] * y
        if order > N_PLANE:
            heights[i] += c[3] * x * x + c[4] * x * y + c[5] * y * y
