"""The outlier detectors that ``bench_real.py`` compares.

A method takes points and the share of outliers, or None. It returns labels and outlyingness, or
None if it needs the share. "position" holds for clouds that were taken from their origin alone.
"""

import numpy as np
from _real_clouds import N_SPACING
from scipy.spatial import cKDTree

from sklearn_mcmd import MCMDOutlierDetector

N_JOBS = 2


def detector(**parameters):
    """A setting of the detector as a method."""

    def method(points, share):
        fitted = MCMDOutlierDetector(random_state=0, n_jobs=N_JOBS, **parameters).fit(points)
        return np.where(fitted.scores_ < fitted.offset_, -1, 1), -fitted.scores_

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


METHODS = {
    "default": detector(),
    "isolated": detector(strictness="isolated"),
    "surfaces": detector(strictness="surfaces"),
    "SOR 8": sor(8),
    "SOR 20": sor(20),
    "SOR 50": sor(50),
    "radius": radius_removal,
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
