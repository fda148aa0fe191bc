"""``explain`` of ``_explaining``, compiled; any dimension."""

import numpy as np

from sklearn_mcmd.runtime._kernels import kernel

__all__ = ["explain_queries"]


@kernel(cache=True)
def explain_queries(queries, candidates, planes, usable, least, likely, tie, owners, distances):
    """Fill owners and distances as `explain` returns them; costs within `tie` are equal."""
    d = queries.shape[1]
    for i in range(len(queries)):
        owners[i], distances[i], least_cost = -1, np.inf, np.inf
        for j in range(candidates.sizes[i]):
            row = candidates.indices[i, j]
            if not usable[row] or (likely and not planes.scale[row] > 0.0):
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
            if likely:
                cost = 0.5 * (np.log(variance) + distance * distance)
                cost -= np.log(planes.kept[row])
            if cost < np.inf and cost < least_cost - tie * (1.0 + abs(cost)):
                owners[i], distances[i], least_cost = row, distance, cost
