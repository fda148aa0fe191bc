"""The rulers of ``_judging``, compiled: one neighborhood after another, any dimension."""

import numpy as np

from sklearn_mcmd.planes._around_numba import quantile
from sklearn_mcmd.planes._kernels import kernel

__all__ = ["rule_neighborhoods"]


@kernel(cache=True, error_model="numpy")
def rule_neighborhoods(options, own, neighborhoods, fitted, credible, ruler, usual_spacing):
    """Fill the rulers of queries and the spacing that is usual around; see `judge`."""
    values = np.empty(neighborhoods.indices.shape[1])
    keys = values.view(np.int64)
    half, quarter, limits = options.half, options.quarter, options.credible
    for i in range(len(ruler)):
        neighbors, size = neighborhoods.indices[i], neighborhoods.sizes[i]
        usual_spacing[i] = quantile(fitted.spacing, neighbors, size, half, values, keys)
        if options.ruler == 0:  # OWN
            ruler[i] = own.scale[i]
        elif options.ruler == 2:  # COMMON
            ruler[i] = options.noise
        else:
            around = quantile(fitted.radius, neighbors, size, half, values, keys)
            n_credible = 0
            for j in range(size):
                n_credible += credible[neighbors[j]]
            on_surface = n_credible >= options.surface * size
            is_credible = (
                own.scale[i] <= limits.most_rough * own.radius[i]
                and own.radius[i] <= limits.most_sparse * around
                and 1.0 - own.kept[i] <= 1.0 - limits.least_kept
            )
            if on_surface and is_credible:
                least = quantile(fitted.scale, neighbors, size, quarter, values, keys)
                ruler[i] = max(own.scale[i], least)
            else:
                usual = quantile(fitted.scale, neighbors, size, half, values, keys)
                ruler[i] = min(own.scale[i], usual) if on_surface else max(own.scale[i], usual)
