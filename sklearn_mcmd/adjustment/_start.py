"""A robust first plane for data snooping: both papers joined."""

import numpy as np
from sklearn.utils import check_random_state

__all__ = ["_robust_start_plane"]

SUPPORT_FRACTION = 0.5
SUCCESS_PROBABILITY = 0.9999
# A start needs no more points than this to choose the best of its trial planes.
MAX_POINTS = 20_000


def _robust_start_plane(X, random_state=None):
    """Members of the most coplanar half of the points (Algorithm 1 of the MCMD paper).

    Draws minimal subsets, takes the half of the points that lie nearest to each one's plane,
    and keeps the half whose least eigenvalue lambda_0 is smallest.

    Parameters
    ----------
    X : ndarray of shape (n, d)
    random_state : int, RandomState instance or None

    Returns
    -------
    ndarray of bool of shape (n,)
    """
    rng = check_random_state(random_state)
    n, d = X.shape
    if n <= d + 1:
        return np.ones(n, dtype=bool)
    n_trials = int(np.ceil(np.log(1 - SUCCESS_PROBABILITY) / np.log(1 - SUPPORT_FRACTION**d)))
    local = X - np.median(X, axis=0)
    sample = local if n <= MAX_POINTS else local[rng.choice(n, MAX_POINTS, replace=False)]
    support = max(int(np.ceil(SUPPORT_FRACTION * len(sample))), d + 1)
    best = (np.inf, None, None)
    for _ in range(min(n_trials, 2000)):
        subset = sample[rng.choice(len(sample), d, replace=False)]
        center = subset.mean(axis=0)
        normal = np.linalg.svd(subset - center)[2][-1]
        distances = np.abs((sample - center) @ normal)
        nearest = sample[np.argpartition(distances, support - 1)[:support]]
        values, vectors = np.linalg.eigh(np.cov(nearest.T, bias=True))
        if values[0] < best[0]:
            best = (values[0], nearest.mean(axis=0), vectors[:, 0])
    distances = np.abs((local - best[1]) @ best[2])
    support = max(int(np.ceil(SUPPORT_FRACTION * n)), d + 1)
    members = np.zeros(n, dtype=bool)
    members[np.argpartition(distances, support - 1)[:support]] = True
    return members
