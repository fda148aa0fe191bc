"""The quadrics of ``_curvature``, compiled."""

import numpy as np

from sklearn_mcmd.normals._quadrics_numba import (
    ORIGIN,
    TERMS,
    back_substitute,
    decompose,
    deviate,
    frame,
    localize,
    quadric_moments,
)
from sklearn_mcmd.runtime._kernels import kernel


@kernel(cache=True)
def fit_jets(points, around, queries, tangents, planes, floor, limits, room, jets):
    """Fill `Jets` that are undetermined with quadrics of the members that belong to surfaces.

    `floor` (m,) is the least standard deviation of the noise, in units of the points.
    """
    indices, sizes = around.indices, around.sizes
    local, chosen, deviations, heights, used, lower, right, solution = room
    for i in range(len(indices)):
        size, radius = sizes[i], planes.radius[i]
        if not (planes.scale[i] > 0.0 and radius > 0.0):
            continue
        localize(points, indices[i], size, queries[i], local)
        axes = frame(planes.normals[i], tangents[i])
        solution[:] = 0.0
        for axis in range(3):
            solution[0] += axes[0][axis] * (planes.centroids[i, axis] - queries[i, axis]) / radius
        deviate(local, size, axes, radius, solution, deviations)
        noise = planes.scale[i] / radius
        used[:] = False
        for _ in range(1 + limits.rounds):
            n_used, changed = _choose(
                local, size, deviations, limits.explained * noise, used, chosen
            )
            if not changed:
                break
            jets.n_used[i] = 0
            if n_used < limits.least_members:
                break
            quadric_moments(chosen, n_used, 3, ORIGIN, axes, radius, lower, right, heights)
            _, determined = decompose(lower, right, solution, 0.0, limits.pivot)
            if not determined:
                break
            jets.n_used[i] = n_used
            back_substitute(lower, solution)
            deviate(local, size, axes, radius, solution, deviations)
            squares = 0.0
            for j in range(size):
                if used[j]:
                    squares += deviations[j] * deviations[j]
            noise = limits.truncation * np.sqrt(squares / (n_used - TERMS))
            noise = max(noise, floor[i] / radius)
            _store(jets, i, solution, lower, noise)


@kernel
def _choose(local, size, deviations, most, used, chosen):
    """Copy the members within the largest deviation; their number, and whether any is new."""
    n_used, changed = 0, False
    for j in range(size):
        inside = abs(deviations[j]) <= most
        changed |= inside != used[j]
        used[j] = inside
        if inside:
            for axis in range(3):
                chosen[axis, n_used] = local[axis, j]
            n_used += 1
    return n_used, changed


@kernel
def _store(jets, i, solution, lower, noise):
    jets.noise[i] = noise
    jets.slopes[i, 0], jets.slopes[i, 1] = solution[1], solution[2]
    place = 0
    for row in range(3):
        jets.bends[i, row] = solution[3 + row]
        for column in range(row + 1):
            jets.factors[i, place] = lower[3 + row, 3 + column]
            place += 1
