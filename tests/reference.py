"""Algorithms 1 to 4 of the first paper, literally and slowly: the oracle of the tests.

One neighborhood at a time, one trial at a time, no vectorization, no shortcuts. The only
addition is what the paper leaves open: ties go to the first member and the first trial.
"""

import numpy as np


def plane(points):
    """Mean, ascending eigenvalues and eigenvectors of the covariance matrix (Eq. 1)."""
    mean = points.mean(axis=0)
    deviations = points - mean
    covariance = sum(np.outer(row, row) for row in deviations) / len(points)
    eigenvalues, eigenvectors = np.linalg.eigh(covariance)
    return mean, eigenvalues, eigenvectors


def pca_normal(X):
    """The axis of least variance of the whole cloud, outliers and all."""
    return np.linalg.eigh(np.cov(X.T))[1][:, 0]


def rank(points):
    centered = points - points.mean(axis=0)
    singular = np.linalg.svd(centered, compute_uv=False)
    return int(np.sum(singular > 1e-6 * singular[0])) if singular[0] > 0 else 0


def normal_through(points):
    """Normal of the plane of a minimal subset, by the decomposition that loses least."""
    _, _, axes = np.linalg.svd(points - points.mean(axis=0))
    return axes[-1]


def consistent_set(points, trials, h):
    """Algorithm 1: members of the maximum consistent set and its least eigenvalue."""
    k, d = points.shape
    distances = sorted(np.linalg.norm(points - points[0], axis=1))
    radius = distances[k // 2] or distances[-1] or 1.0
    found = []
    for row in trials:
        row = [p for p in row if p < k]
        m = d
        while rank(points[row[:m]]) < d - 1 and m < k:
            m = min(m + max(1, m // 2), k)
        subset = points[row[:m]]
        normal = normal_through(subset)
        distances = np.abs((points - subset.mean(axis=0)) @ normal)
        # Equal to rounding is equal: the earlier member first.
        order = sorted(range(k), key=lambda j: (round(distances[j] / radius * 2**29), j))
        chosen = order[:h]
        mean, eigenvalues, axes = plane(points[chosen])
        if eigenvalues[1] <= 1e-12 * eigenvalues[-1]:
            continue  # a line has no normal
        found.append((np.mean(((points[chosen] - mean) @ axes[:, 0]) ** 2), sorted(chosen)))
    best = min(least for least, _ in found)
    return next((m, least) for least, m in found if least <= best + 1e-14 * radius**2)


def mcmd_z(points, members, query):
    """Algorithm 2: inliers (Rz < 2.5) and the query's own Rz."""
    mean, _, axes = plane(points[members])
    od = (points - mean) @ axes[:, 0]
    median = np.median(od)
    mad = 1.4826 * np.median(np.abs(od - median))
    rz = np.abs(od - median) / mad
    return rz < 2.5, abs((query - mean) @ axes[:, 0] - median) / mad


def mcmd_md(points, members, query, cutoff):
    """Algorithm 3: inliers (RMD < cutoff) and the query's own RMD; covariance with n - 1."""
    mean = points[members].mean(axis=0)
    inverse = np.linalg.inv(np.cov(points[members].T))
    rmd = [np.sqrt((p - mean) @ inverse @ (p - mean)) for p in points]
    own = np.sqrt((query - mean) @ inverse @ (query - mean))
    return np.array(rmd) < cutoff, own


def neighborhood(X, query, k):
    """Indices of the k nearest points, by sorting all distances."""
    return np.argsort(np.linalg.norm(X - query, axis=1), kind="stable")[:k]


def saliency(X, query, k, trials, h, method, cutoff):
    """Algorithm 4 for one query: own distance, normal and eigenvalues after cleaning."""
    points = X[neighborhood(X, query, k)]
    members, _ = consistent_set(points, trials, h)
    if method == "mcmd_z":
        inliers, own = mcmd_z(points, members, query)
    else:
        inliers, own = mcmd_md(points, members, query, cutoff)
    _, eigenvalues, axes = plane(points[inliers])
    return own, axes[:, 0], eigenvalues
