"""Smooth neighborhoods, which keep all their members: their curvature is no contamination.

On a curved surface that is measured better than it bends within a neighborhood, the points away
from the majority's plane look like outliers, and a plane fitted to the rest leans. So a
neighborhood is first asked whether one smooth surface, a quadric over the plane of all members,
explains it as well as the robust plane explains its own part. An edge is not explained so.
The NumPy form, for any dimension; ``_smoothness_numba`` repeats it in three.
"""

import numpy as np

from sklearn_mcmd._plane import fit_planes

__all__ = ["ALL_FLAT", "CURVED", "PIVOT", "QUADRIC", "least_members", "smooth_planes"]

# All members keep to their plane nearly as well as the retained do to theirs: no outliers.
ALL_FLAT = 1.2
# The quadric's residual is below the scale of the robust plane, which curvature has inflated.
# At a crease of noisy faces it is above: the scale there is the noise.
CURVED = 0.8
# Share of the variance about the plane that a quadric leaves, without noise at most. It leaves
# 6 % of a crease.
QUADRIC = 0.02
# A quadric that the members don't determine, as on two scan lines, explains nothing.
PIVOT = 1e-6


def least_members(d):
    """Fewest members for a quadric to have left something to explain."""
    return 2 * (1 + (d - 1) + d * (d - 1) // 2)


def smooth_planes(neighborhoods, sizes, scale):
    """Planes of all members, and where these make a smooth surface.

    Parameters
    ----------
    neighborhoods : ndarray of shape (B, k, d)
    sizes : ndarray of int of shape (B,)
    scale : ndarray of shape (B,)
        Of the robust plane.

    Returns
    -------
    smooth : ndarray of bool of shape (B,)
    centroids, eigenvalues, axes : as by `fit_planes`
    deviation : ndarray of shape (B,)
        Standard deviation of the members from the plane.
    left : ndarray of shape (B,)
        Standard deviation that the quadric leaves; from the plane where there is none.
    """
    _, k, d = neighborhoods.shape
    valid = np.arange(k) < sizes[:, None]
    centroids, eigenvalues, axes = fit_planes(neighborhoods, valid)
    extent = np.sqrt(np.maximum(eigenvalues[:, -1:], np.finfo(float).tiny))
    local = np.matmul((neighborhoods - centroids[:, None]) / extent[:, None], axes)
    local *= valid[..., None]
    height, flat = local[..., 0], local[..., 1:]
    pairs = [(i, j) for i in range(d - 1) for j in range(i, d - 1)]
    columns = [valid.astype(float), *np.moveaxis(flat, -1, 0)]
    columns += [flat[..., i] * flat[..., j] for i, j in pairs]
    design = np.stack(columns, axis=-1)
    total = np.square(height).sum(axis=1)
    squares, determined = _residual(design, height, total)
    plane = total / np.maximum(sizes - d, 1)
    quadric = squares / np.maximum(sizes - len(columns), 1)
    noise = np.square(scale / extent[:, 0])
    smooth = (plane <= ALL_FLAT**2 * noise) | (
        determined & ((quadric <= CURVED**2 * noise) | (quadric <= QUADRIC * plane))
    )
    smooth &= (sizes >= least_members(d)) & (scale > 0)
    left = np.where(determined, np.minimum(quadric, plane), plane)
    extent = extent[:, 0]
    return smooth, centroids, eigenvalues, axes, np.sqrt(plane) * extent, np.sqrt(left) * extent


def _residual(design, height, total):
    """Squares that least squares leaves, by Cholesky's decomposition of all rows at once."""
    matrix = np.swapaxes(design, -1, -2) @ design
    right = np.einsum("bki,bk->bi", design, height)
    size = matrix.shape[-1]
    lower = np.zeros_like(matrix)
    forward = np.zeros_like(right)
    determined = np.ones(len(matrix), dtype=bool)
    for i in range(size):
        for j in range(i):
            dot = np.einsum("bm,bm->b", lower[:, i, :j], lower[:, j, :j])
            lower[:, i, j] = (matrix[:, i, j] - dot) / lower[:, j, j]
        pivot = matrix[:, i, i] - np.square(lower[:, i, :i]).sum(axis=1)
        good = pivot > PIVOT * matrix[:, i, i]
        determined &= good
        lower[:, i, i] = np.sqrt(np.where(good, pivot, 1.0))
        dot = np.einsum("bm,bm->b", lower[:, i, :i], forward[:, :i])
        forward[:, i] = (right[:, i] - dot) / lower[:, i, i]
    return np.maximum(total - np.square(forward).sum(axis=1), 0.0), determined
