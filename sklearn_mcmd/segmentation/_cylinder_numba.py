"""The least squares cylinder of ``_cylinder``, compiled: loops in the place of linear algebra.

Numba takes ten times as long to compile calls of BLAS and LAPACK.
"""

import numpy as np

from sklearn_mcmd.runtime._kernels import kernel

N = 5  # parameters of a cylinder


def fit(points, starts, limits):
    """Least sum of squares and cylinder (point, axis, radius) of centered points."""
    equations, model = np.empty((N, N + 1)), np.zeros(7)
    return _fit(points, starts, limits, equations, model), model


@kernel(cache=True)
def _fit(points, starts, limits, equations, model):
    """Fill the `model`; `equations` hold the normal equations and, last, their right side."""
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
                a, b = equations[0, N], equations[1, N]
                point = _moved(point, a, u, b, v)
                radius = np.sqrt(max(equations[2, N] + a * a + b * b, 0.0))
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
            point = _moved(point, equations[0, N], u, equations[1, N], v)
            axis = _moved(axis, equations[2, N], u, equations[3, N], v)
            axis = _scaled(axis, 1.0 / np.sqrt(_dot(axis, axis)))
            # Move the axis point back to the height of the points; any point of the axis will do.
            point = _moved(point, -_dot(point, axis), axis, 0.0, axis)
            radius = abs(radius + equations[4, N])
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
