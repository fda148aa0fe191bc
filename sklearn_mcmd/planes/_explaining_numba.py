"""``explain`` of ``_explaining``, compiled; any dimension."""

import numpy as np

from sklearn_mcmd.runtime._kernels import kernel

__all__ = ["explain_queries"]


@kernel(cache=True)
def explain_queries(queries, candidates, planes, limits, usable, scales, owners, distances):
    """Fill owners and distances; `scales` are the least and the most of `explain`."""
    d = queries.shape[1]
    least, most = scales
    for i in range(len(queries)):
        owners[i], distances[i] = -1, np.inf
        least_cost, best_first = np.inf, False
        for j in range(candidates.sizes[i]):
            row = candidates.indices[i, j]
            if not usable[row] or (limits.likely and not planes.scale[row] > 0.0):
                continue
            height = reach = 0.0
            for axis in range(d):
                deviation = queries[i, axis] - planes.centroids[row, axis]
                height += deviation * planes.normals[row, axis]
                reach += deviation * deviation
            if not np.sqrt(reach) <= planes.radius[row]:
                continue
            variance = planes.scale[row] * planes.scale[row] + least[i] * least[i]
            distance = abs(height) / np.sqrt(variance)
            cost = distance
            if limits.likely:
                cost = 0.5 * (np.log(variance) + distance * distance)
                cost -= np.log(planes.kept[row])
            if not cost < np.inf:
                continue
            first = variance <= most[i] * most[i] and distance <= limits.explained
            less = cost < least_cost - limits.tie * (1.0 + abs(cost))
            if (first and not best_first) or (first == best_first and less):
                owners[i], distances[i] = row, distance
                least_cost, best_first = cost, first
