"""Growth, division and cylinders of regions, compiled.

Loops are in the place of linear algebra: Numba takes ten times as long to compile calls of BLAS and
LAPACK. Python makes the arrays, as what makes them takes long to compile, and what copies one to
another takes seconds.
"""

from heapq import heappop, heappush

import numpy as np

from sklearn_mcmd.planes._creases_numba import (
    N_PLANE,
    N_QUADRIC,
    across,
    center,
    design_effect,
    fit_crease,
    fit_quadric,
    fit_sides,
    half_bic,
    mean_axes,
)
from sklearn_mcmd.planes._explaining_numba import _root
from sklearn_mcmd.planes._moments_numba import dot, eigh_3d, vector
from sklearn_mcmd.planes._quadrics_numba import TERMS, back_substitute, decompose
from sklearn_mcmd.runtime._kernels import kernel

# Parameters; with plain numbers, what takes them is compiled for each.
N_CIRCLE, N_CYLINDER = np.int64(3), np.int64(5)
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
                if j >= 0 and labels[j] < 0:
                    labels[j] = region
                    waiting[n_waiting] = j
                    n_waiting += 1
        region += 1


@kernel(cache=True)
def fit_cylinder(points, starts, limits, equations, model):
    """Fill the model (point, axis, radius) of centered points, and return the sum of squares.

    `equations` have room for the normal equations, their solution, and one to be added.
    """
    n = len(points)
    best = np.inf
    ridge, solution = limits.ridge * n, equations[2]
    for start in range(len(starts)):
        axis = (starts[start, 0], starts[start, 1], starts[start, 2])
        point, radius = (0.0, 0.0, 0.0), -1.0
        last = np.inf
        for step in range(limits.n_steps + 1):
            u, v = across(axis)
            if step == 0:
                _circle(points, u, v, ridge, equations)
                a, b = solution[0], solution[1]
                point = _moved(point, a, u, b, v)
                radius = np.sqrt(max(solution[2] + a * a + b * b, 0.0))
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
            point = _moved(point, solution[0], u, solution[1], v)
            axis = _moved(axis, solution[2], u, solution[3], v)
            axis = _scaled(axis, 1.0 / np.sqrt(dot(axis, axis)))
            # Move the axis point back to the height of the points; any point of the axis will do.
            point = _moved(point, -dot(point, axis), axis, 0.0, axis)
            radius = abs(radius + solution[4])
    return best


@kernel
def _scaled(a, factor):
    return a[0] * factor, a[1] * factor, a[2] * factor


@kernel
def _moved(a, s, u, t, v):
    """The point a + s u + t v."""
    return (a[0] + s * u[0] + t * v[0], a[1] + s * u[1] + t * v[1], a[2] + s * u[2] + t * v[2])


@kernel
def _circle(points, u, v, ridge, equations):
    """The algebraic circle of the points seen along the axis.

    x^2 + y^2 is linear in the center's coordinates and a constant.
    """
    lower, right, _, new = equations
    lower[:], right[:] = 0.0, 0.0
    new[2] = 1.0
    for i in range(len(points)):
        point = (points[i, 0], points[i, 1], points[i, 2])
        x, y = dot(point, u), dot(point, v)
        new[0], new[1] = 2.0 * x, 2.0 * y
        _add(lower, right, new, x * x + y * y, N_CIRCLE)
    _solve(equations, N_CIRCLE, ridge)


@kernel
def _linearize(points, point, axis, u, v, radius, least, equations):
    """Sum of squared distances from a cylinder, and the normal equations of the next step."""
    lower, right, _, new = equations
    lower[:], right[:] = 0.0, 0.0
    new[4] = 1.0
    total = 0.0
    for i in range(len(points)):
        gap = (points[i, 0] - point[0], points[i, 1] - point[1], points[i, 2] - point[2])
        along, x, y = dot(gap, axis), dot(gap, u), dot(gap, v)
        reach = np.sqrt(x * x + y * y)
        away = reach - radius
        total += away * away
        reach = max(reach, least)
        new[0], new[1] = x / reach, y / reach
        new[2], new[3] = along * new[0], along * new[1]
        _add(lower, right, new, away, N_CYLINDER)
    return total


@kernel
def _add(lower, right, new, value, n):
    """Add an equation to the lower triangle of the normal ones."""
    for i in range(n):
        for j in range(i + 1):
            lower[i, j] += new[i] * new[j]
        right[i] += new[i] * value


@kernel(fastmath=False)
def _solve(equations, n, ridge):
    """Solve the first normal equations."""
    lower, right, solution, _ = equations
    for i in range(TERMS):
        lower[i, i] += ridge if i < n else 1.0
    decompose(lower, right, solution, 0.0, 0.0)
    back_substitute(lower, solution)


@kernel(cache=True)
def gather(order, starts, near, labels, group, begins):
    """Fill the group of each node, -1 at first, and the node at which each begins, as of
    `gathered`; how many groups there are."""
    n = 0
    for i in order:
        if group[i] >= 0:
            continue
        group[i] = n
        begins[n] = i
        for a in range(starts[i], starts[i + 1]):
            j = near[a]
            if group[j] < 0 and labels[j] == labels[i]:
                group[j] = n
        n += 1
    return n


@kernel(cache=True, allocates=True)
def join_cells(sums, edges, left, turn, root):
    """Join cells to patches, the most alike first: `root` becomes the first cell of each's patch.

    Points, weights, means and scatter (m, 6), in units of noise, become those of the patches. The
    loss is the growth of the sum of squares about planes, when one takes the place of two, over the
    variance factor of the two if that is above 1. The BIC charges the numbers of a plane.

    `left` has room for sums of squares. `turn` has 0 of each cell at first, and `root` its number.
    """
    sizes, weights, means, scatters = sums
    m = len(sizes)
    for c in range(m):
        left[c] = eigh_3d(_scatter(scatters, c, NOTHING))[0][0]
    heap = [(0.0, 0, 0, 0) for _ in range(0)]
    for e in range(len(edges)):
        a, b = edges[e]
        _push(heap, a, b, sums, left, turn)
    while len(heap) > 0:
        _, a, b, stamp = heappop(heap)
        a, b = _root(root, a), _root(root, b)
        a, b = min(a, b), max(a, b)
        if a == b:
            continue
        # Turns only grow, and their sum tells whether one of the two has since its loss was told.
        if turn[a] + turn[b] != stamp:
            _push(heap, a, b, sums, left, turn)
            continue
        total, moved = _pooled(a, b, sums)
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


@kernel(allocates=True)
def _push(heap, a, b, sums, left, turn):
    """Let two patches wait for each other if the BIC's charge for a plane is not less than what is
    lost if one plane explains both."""
    apart, n = left[a] + left[b], sums.sizes[a] + sums.sizes[b]
    _, pooled = _pooled(a, b, sums)
    factor = max(1.0, apart / max(n - 2 * N_PLANE, 1.0))
    loss = (eigh_3d(pooled)[0][0] - apart) / factor
    if loss <= N_PLANE * np.log(n):
        heappush(heap, (loss, a, b, turn[a] + turn[b]))


@kernel
def _pooled(a, b, sums):
    """Weight and scatter of two patches together: those of both about their means, and w_a w_b /
    (w_a + w_b) times the product of the means' difference with itself."""
    weights, means, scatters = sums.weights, sums.means, sums.scatters
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
def vote(local, weights, cells, normals, limits, most_noise, blunt, room, equations, sides):
    """Is a border no crease? Half the difference of BIC, above 0 for one smooth surface.

    One surface is a quadric over the mean of both planes, the other model two planes that meet in
    their line; both have six numbers, and the second region costs those of a plane. If sides are
    told by labels all the same, for a step, the rest must be smaller by `most_noise`. A `blunt`
    crease is one surface as well, so that only a step parts it. Points of one cell whose deviations
    have the same sign count as fewer.

    Points (3, n) are near the origin, and are centered. Weights (n,) are inverse variances, cells
    ascend on each side, and normals (2, 3) are those of both patches. All rows of `sides` (3, n)
    are the points of one side by labels; the last becomes those as the better model of two
    surfaces tells them.
    """
    smooth, crease, shares, heights, mean = room[0], room[1], room[2], room[3:5], room[5]
    labelled, _, told = sides
    n = len(labelled)
    center(local, n, 3, mean)
    axes = mean_axes(vector(normals[0]), vector(normals[1]))
    square = 0.0
    for i in range(n):
        square += local[0, i] ** 2 + local[1, i] ** 2 + local[2, i] ** 2
    extent = max(np.sqrt(square / n), limits.ridge)
    members = local, n, 3, axes, extent, weights
    if not fit_sides(*members, labelled, shares, heights):
        return limits.ridge  # too few to tell
    step = 0.0
    for i in range(n):
        off = heights[1, i] if labelled[i] else heights[0, i]
        step += weights[i] * off * off
    smooth_left = 0.0
    fit_quadric(*members, smooth, equations)
    for i in range(n):
        smooth_left += weights[i] * smooth[i] * smooth[i]
    by_line = left = fit_crease(members, sides, shares, heights, crease)
    if blunt and left < smooth_left:
        smooth, smooth_left = crease, left
    if blunt or most_noise**2 * step < left:
        left = most_noise**2 * step
        for i in range(n):
            told[i] = labelled[i]
    bends = smooth_left <= left or by_line == np.inf
    size = max(n / design_effect(smooth if bends else crease, weights, cells), 2.0)
    surface = half_bic(smooth_left * extent**2 / n + limits.ridge, size, N_QUADRIC)
    return half_bic(left * extent**2 / n + limits.ridge, size, N_QUADRIC + N_PLANE) - surface
