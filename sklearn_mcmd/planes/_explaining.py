"""Borrowed planes: next to an edge, a point asks its neighbors' planes whether one is its own."""

import numpy as np

__all__ = [
    "EXPLAINED",
    "KEPT_WEIGHT",
    "LEAST_KEPT",
    "MOST_SPARSE",
    "credible_planes",
    "explanation_cost",
    "nearest_credible_planes",
]

# A credible plane keeps at least half of its neighborhood, ...
LEAST_KEPT = 0.5
# ... is not sparser than its surroundings, and is flat for its size.
MOST_SPARSE = 1.15
# A plane explains points within so many of its standard deviations.
EXPLAINED = 3.0
# Weight of the logarithm of the share of its neighborhood that a plane keeps. More is better where
# there is noise, less where there is none.
KEPT_WEIGHT = 1.5


def credible_planes(scale, removed_fraction, radius, radius_around, most_rough):
    """Which planes may explain points, their own or others: arrays (n,) to bool (n,).

    Parameters
    ----------
    scale, removed_fraction : of the planes
    radius : of their neighborhoods
    radius_around : what is usual among the neighbors
    most_rough : float
        Largest ratio of scale to radius.
    """
    flat = scale <= most_rough * radius
    dense = radius <= MOST_SPARSE * radius_around
    return flat & dense & (removed_fraction <= 1 - LEAST_KEPT)


def nearest_credible_planes(queries, candidates, valid, fitted, ruler):
    """Of the planes of its neighbors, the credible one that each query is nearest to.

    Parameters
    ----------
    queries : ndarray of shape (m, d)
    candidates : ndarray of int of shape (m, k)
        Rows of `fitted`.
    valid : ndarray of bool of shape (m, k)
    fitted : Surroundings
    ruler : ndarray of shape (m, k)
        Standard deviation by which the distance to a candidate is measured.

    Returns
    -------
    distances : ndarray of shape (m,)
        In standard deviations; inf where no credible plane reaches the query.
    owners : ndarray of int of shape (m,)
        Rows of `fitted`; -1 where none.
    """
    deviations = queries[:, None] - fitted.planes.centroids[candidates]
    heights = np.abs(np.einsum("mkd,mkd->mk", deviations, fitted.planes.normals[candidates]))
    reach = np.sqrt(np.einsum("mkd,mkd->mk", deviations, deviations))
    usable = valid & fitted.credible[candidates] & (reach <= fitted.radius[candidates])
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        distances = np.where(usable, heights / ruler, np.inf)
    best = distances.argmin(axis=1)
    each = np.arange(len(queries))
    distances, owners = distances[each, best], candidates[each, best]
    return distances, np.where(np.isfinite(distances), owners, -1)


def explanation_cost(heights, variance, kept):
    """How badly planes explain a point: the least is of the face that it lies on.

    Parameters
    ----------
    heights : ndarray
        Distances of the point to planes.
    variance : ndarray
        Squared scale of the planes.
    kept : ndarray
        Share of its neighborhood that each plane keeps.
    """
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        cost = 0.5 * (np.log(variance) + np.square(heights) / variance)
        return cost - KEPT_WEIGHT * np.log(kept)
