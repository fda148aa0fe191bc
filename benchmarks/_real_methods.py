"""The outlier detectors that ``bench_real.py`` compares.

A method takes points and the share of outliers, or None. It returns labels and outlyingness, or
None if it needs the share. "position" holds for clouds that were taken from their origin alone.

- "isolated voxels": points go that have at most 5 others in the 27 voxels around them, the default
  of LAStools' lasnoise (``-isolated 5``, ``-step 4``) and of lidR's ``ivf(res = 5, n = 6)``, which
  counts the point itself. Both are of meters, for airborne scans of about one point a square meter,
  whose spacing is about 1 m: here a voxel has 4 times the cloud's median spacing.
- "CloudCompare": its noise filter (CCCoreLib, ``CloudSamplingTools::noiseFilter``) with the
  dialog's relative error of 1 and "remove isolated points". A point goes if it is farther from the
  plane of its neighbors than their standard deviation, or has fewer than 3 neighbors. Its radius
  must be chosen: 3 times the cloud's median spacing, as for "radius".
"""

import numpy as np
from _real_clouds import N_SPACING
from scipy.spatial import cKDTree

from sklearn_mcmd import MCMDOutlierDetector

N_JOBS = 2
N_ROWS = 250  # at a time: 5,000 beams without an echo are neighbors of each other


def detector(**parameters):
    """A setting of the detector as a method."""

    def method(points, share):
        own = MCMDOutlierDetector(random_state=0, n_jobs=N_JOBS, **parameters).fit(points)
        return np.where(own.scores_ < own.offset_, -1, 1), -own.scores_

    return method


def judged(outlyingness, cutoff, share=None):
    """Labels by a cutoff, or as many as the share says, and the outlyingness."""
    if share is not None:
        cutoff = np.quantile(outlyingness, 1 - share)
    return np.where(outlyingness > cutoff, -1, 1), outlyingness


def neighbor_distances(points, n_neighbors):
    """Distances to the nearest other points, in rising order."""
    distances, _ = cKDTree(points).query(points, n_neighbors + 1, workers=N_JOBS)
    return distances[:, 1:]


def median_spacing(points):
    return np.median(neighbor_distances(points, N_SPACING).mean(axis=1))


def sor(n_neighbors):
    """Statistical outlier removal."""

    def method(points, share):
        distance = neighbor_distances(points, n_neighbors).mean(axis=1)
        return judged(distance, distance.mean() + 2 * distance.std())

    return method


def radius_removal(points, share):
    return judged(neighbor_distances(points, 5)[:, 4], 3 * median_spacing(points))


def mean_distance(points, share):
    if share is None:
        return None  # it has no cutoff of its own
    return judged(neighbor_distances(points, 20).mean(axis=1), None, share)


def lof(points, share):
    from sklearn.neighbors import LocalOutlierFactor

    peer = LocalOutlierFactor(20, n_jobs=N_JOBS).fit(points)
    return judged(-peer.negative_outlier_factor_, -peer.offset_, share)


def isolation_forest(points, share):
    from sklearn.ensemble import IsolationForest

    peer = IsolationForest(random_state=0, n_jobs=N_JOBS).fit(points)
    return judged(-peer.score_samples(points), -peer.offset_, share)


def isolated_voxels(points, share):
    """The number of points in the 27 voxels around each point, from few to many."""
    voxels = np.floor((points - points.min(axis=0)) / (4 * median_spacing(points))).astype(np.int64)
    shape = voxels.max(axis=0) + 3  # a free voxel on each side
    keys = np.ravel_multi_index(tuple((voxels + 1).T), shape)
    filled, voxel_of, counts = np.unique(keys, return_inverse=True, return_counts=True)
    strides = np.array([shape[1] * shape[2], shape[2], 1])
    around = np.zeros(len(filled), dtype=np.int64)
    for step in np.stack(np.meshgrid(*3 * [[-1, 0, 1]]), axis=-1).reshape(-1, 3) @ strides:
        place = np.minimum(np.searchsorted(filled, filled + step), len(filled) - 1)
        around += np.where(filled[place] == filled + step, counts[place], 0)
    return judged(-around[voxel_of], -7)


def cloudcompare(points, share):
    """Distance to the plane of the neighbors over their standard deviation from it."""
    tree, radius = cKDTree(points), 3 * median_spacing(points)
    errors = np.full(len(points), np.inf)
    for start in range(0, len(points), N_ROWS):
        own = points[start : start + N_ROWS]
        lists = tree.query_ball_point(own, radius, workers=N_JOBS)
        counts = np.array([len(near) for near in lists])
        # The point itself adds nothing to sums about it.
        steps = points[np.concatenate(lists).astype(int)] - np.repeat(own, counts, axis=0)
        starts, n_others = np.cumsum(counts) - counts, np.maximum(counts - 1, 1)[:, None]
        mean = np.add.reduceat(steps, starts) / n_others
        squares = np.add.reduceat(steps[:, :, None] * steps[:, None], starts) / n_others[..., None]
        values, vectors = np.linalg.eigh(squares - mean[:, :, None] * mean[:, None])
        distance = np.abs(np.einsum("ij,ij->i", mean, vectors[:, :, 0]))
        with np.errstate(divide="ignore", invalid="ignore"):
            error = np.nan_to_num(distance / np.sqrt(np.maximum(values[:, 0], 0)), posinf=np.inf)
        errors[start : start + N_ROWS] = np.where(counts > 3, error, np.inf)
    return judged(errors, 1)


METHODS = {
    "default": detector(),
    "isolated": detector(strictness="isolated"),
    "surfaces": detector(strictness="surfaces"),
    "SOR 8": sor(8),
    "SOR 20": sor(20),
    "SOR 50": sor(50),
    "radius": radius_removal,
    "isolated voxels": isolated_voxels,
    "CloudCompare": cloudcompare,
    "LOF, told": lof,
    "mean distance, told": mean_distance,
    "IsolationForest, told": isolation_forest,
    "position": detector(sensor_origin="origin"),
}


def judgment(name, cloud, share):
    """Labels and outlyingness by a method, or None where it cannot be used on the cloud."""
    if name == "position" and not cloud.from_origin:
        return None
    return METHODS[name](cloud.points, share)
