"""The plane that explains a point best, of those of its neighbors, compiled."""

import numpy as np
from numba import njit

from sklearn_mcmd.planes._explaining import EXPLAINED, KEPT_WEIGHT

__all__ = ["best_planes"]


@njit(cache=True, nogil=True, error_model="numpy")
def best_planes(
    queries, points, indices, sizes, centroids, normals, scale, kept, most, least_noise, best
):  # fmt: skip
    """Fill the row of the best plane, -1 for none; in any dimension.

    See the NumPy form, ``SurfacePlanes._best_planes``.
    """
    d = queries.shape[1]
    for i in range(len(queries)):
        square = 0.0
        for j in range(sizes[i]):
            total = 0.0
            for axis in range(d):
                gap = points[indices[i, j], axis] - queries[i, axis]
                total += gap * gap
            square = max(square, total)
        least = least_noise * least_noise * square
        best[i], least_cost, best_is_usual = -1, np.inf, False
        for j in range(sizes[i]):
            row = indices[i, j]
            height = reach = 0.0
            for axis in range(d):
                deviation = queries[i, axis] - centroids[row, axis]
                height += deviation * normals[row, axis]
                reach += deviation * deviation
            if reach > square or scale[row] <= 0.0:
                continue
            variance = scale[row] * scale[row] + least
            cost = 0.5 * (np.log(variance) + height * height / variance)
            cost -= KEPT_WEIGHT * np.log(kept[row])
            usual = variance <= most[i] * most[i] and height * height <= EXPLAINED**2 * variance
            if (usual and not best_is_usual) or (usual == best_is_usual and cost < least_cost):
                best[i], least_cost, best_is_usual = row, cost, usual
