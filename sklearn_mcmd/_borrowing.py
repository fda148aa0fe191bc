"""Borrowed planes: next to an edge, a point asks its neighbors' planes whether one is its own."""

import numpy as np

__all__ = ["credible_planes", "most_of_a_surface", "nearest_credible_planes"]

# A credible plane keeps at least half of its neighborhood, ...
LEAST_KEPT = 0.5
# ... is not sparser than its surroundings, ...
MOST_SPARSE = 1.15
# ... and is flat for its size: so many times flatter than the radius, or than is usual.
FLATNESS = 0.1
FLATNESS_FACTOR = 3.0


def credible_planes(scale, removed_fraction, radius, radius_around, usual_flatness):
    """Which planes may explain points, their own or others: arrays (n,) to bool (n,).

    Parameters
    ----------
    scale, removed_fraction : of the planes
    radius : of their neighborhoods
    radius_around : what is usual among the neighbors
    usual_flatness : float
        Scale over radius, the median of the cloud. A cloud whose noise is as large as its
        neighborhoods has no flatter planes than that.
    """
    flat = scale <= most_of_a_surface(usual_flatness) * radius
    dense = radius <= MOST_SPARSE * radius_around
    return flat & dense & (removed_fraction <= 1 - LEAST_KEPT)


def most_of_a_surface(usual_flatness):
    """Largest ratio of a plane's scale to the radius of its neighborhood on a surface."""
    return max(FLATNESS, FLATNESS_FACTOR * usual_flatness)


def nearest_credible_planes(queries, candidates, valid, planes, ruler):
    """Of the planes of its neighbors, the credible one that each query is nearest to.

    Parameters
    ----------
    queries : ndarray of shape (m, d)
    candidates : ndarray of int of shape (m, k)
        Rows of `planes`.
    valid : ndarray of bool of shape (m, k)
    planes : object with arrays `centroids`, `normals`, `radius`, `credible`
    ruler : ndarray that broadcasts to (m, k)
        Standard deviation by which the distance to a candidate is measured.

    Returns
    -------
    distances : ndarray of shape (m,)
        In standard deviations; inf where no credible plane reaches the query.
    owners : ndarray of int of shape (m,)
        Rows of `planes`; -1 where none.
    """
    deviations = queries[:, None] - planes.centroids[candidates]
    heights = np.abs(np.einsum("mkd,mkd->mk", deviations, planes.normals[candidates]))
    reach = np.sqrt(np.einsum("mkd,mkd->mk", deviations, deviations))
    usable = valid & planes.credible[candidates] & (reach <= planes.radius[candidates])
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        distances = np.where(usable, heights / ruler, np.inf)
    best = distances.argmin(axis=1)
    each = np.arange(len(queries))
    distances, owners = distances[each, best], candidates[each, best]
    return distances, np.where(np.isfinite(distances), owners, -1)
