"""What `bench_peers.py` measures: searches, normals, outliers and regions, ours and of peers.

A job takes a `Case` and returns its answer: a search `Found`, the others an array with a row for
each point. Imports are inside the jobs, so a process loads the one library that it measures.
"""

from collections.abc import Callable
from importlib.util import find_spec
from typing import Any, NamedTuple

import numpy as np

__all__ = ["JOBS", "KINDS", "Case", "Found", "Job", "is_installed", "leaf_order"]

KINDS = ("search", "normals", "outliers", "regions")
# Rows that one thread searches at a time.
CHUNK = 4096


class Case(NamedTuple):
    """X (n, 3), neighbors, threads, a radius that holds k points, normals and their columns."""

    X: np.ndarray
    k: int
    threads: int
    radius: float
    columns: np.ndarray | None = None


class Found(NamedTuple):
    """The answer of a search: rows (n, k) of `points`, for each of `points`."""

    points: np.ndarray
    indices: np.ndarray


class Job(NamedTuple):
    """One row of the tables."""

    run: Callable[[Case], Any]
    package: str  # the module that has to be there
    max_points: float = np.inf


def is_installed(job):
    return find_spec(JOBS[job].package) is not None


def leaf_order(X):
    """Rows of X by the leaves of SciPy's tree: near points are near in memory."""
    from scipy.spatial import cKDTree

    return cKDTree(X).indices


def our_search(case):
    from joblib import Parallel, delayed

    from sklearn_mcmd.planes._nearest import SelfSearch

    search = SelfSearch(case.X)
    indices = np.empty((len(case.X), case.k), dtype=np.int32)

    def fill(start):
        rows = slice(start, start + CHUNK)
        indices[rows] = search.query(rows, case.k)

    starts = range(0, len(case.X), CHUNK)
    Parallel(n_jobs=case.threads, require="sharedmem")(delayed(fill)(start) for start in starts)
    return Found(search.points, indices), search.order


def search_in_leaf_order(case):
    found, _ = our_search(case)
    return found


def search_in_callers_rows(case):
    found, order = our_search(case)
    indices = np.empty_like(found.indices)
    indices[order] = order[found.indices]
    return Found(case.X, indices)


def scipy_search(case):
    from scipy.spatial import cKDTree

    _, indices = cKDTree(case.X).query(case.X, k=case.k, workers=case.threads)
    return Found(case.X, indices)


def scipy_search_in_leaf_order(case):
    return scipy_search(case._replace(X=case.X[leaf_order(case.X)]))


def pykdtree_search(case):
    from pykdtree.kdtree import KDTree

    return Found(case.X, KDTree(case.X).query(case.X, k=case.k)[1])


def pynanoflann_search(case):
    import pynanoflann

    tree = pynanoflann.KDTree(n_neighbors=case.k)
    tree.fit(case.X)
    return Found(case.X, tree.kneighbors(case.X, n_jobs=case.threads)[1])


def small_gicp_search(case):
    import small_gicp

    tree = small_gicp.KdTree(case.X, num_threads=case.threads)
    return Found(case.X, tree.batch_knn_search(case.X, case.k, num_threads=case.threads)[0])


def sklearn_search(case):
    from sklearn.neighbors import NearestNeighbors

    tree = NearestNeighbors(n_neighbors=case.k, algorithm="kd_tree", n_jobs=case.threads)
    return Found(case.X, tree.fit(case.X).kneighbors(case.X, return_distance=False))


def single_precision(X):
    """X about its center as float32, for libraries that take nothing else."""
    return (X - X.mean(axis=0)).astype(np.float32)


def pgeof_search(case):
    import pgeof

    local = single_precision(case.X)
    return Found(case.X, pgeof.knn_search(local, local, case.k)[0])


def our_normals(**parameters):
    def run(case):
        from sklearn_mcmd import RobustNormalEstimator

        estimator = RobustNormalEstimator(case.k, random_state=0, n_jobs=case.threads, **parameters)
        return estimator.fit(case.X).normals_

    return run


def open3d_cloud(X):
    import open3d

    return open3d.geometry.PointCloud(open3d.utility.Vector3dVector(X))


def open3d_normals(case):
    import open3d

    cloud = open3d_cloud(case.X)
    cloud.estimate_normals(open3d.geometry.KDTreeSearchParamKNN(case.k))
    return np.asarray(cloud.normals)


def pgeof_normals(case):
    import pgeof

    local = single_precision(case.X)
    neighbors, _ = pgeof.knn_search(local, local, case.k)
    starts = np.arange(0, (len(local) + 1) * case.k, case.k, dtype=np.uint32)
    return pgeof.compute_features(local, neighbors.ravel(), starts)[:, 4:7]


def pgeof_normals_by_radius(case):
    import pgeof

    axes = pgeof.EFeatureID.Normal_x, pgeof.EFeatureID.Normal_y, pgeof.EFeatureID.Normal_z
    return pgeof.compute_features_selected(case.X, case.radius, 20 * case.k, axes)


def jakteristics_normals(case):
    import jakteristics

    return jakteristics.compute_features(
        case.X, case.radius, num_threads=case.threads, feature_names=["nx", "ny", "nz"]
    )


def small_gicp_normals(case):
    import small_gicp

    cloud = small_gicp.PointCloud(case.X)
    small_gicp.estimate_normals(cloud, num_neighbors=case.k, num_threads=case.threads)
    return cloud.normals()[:, :3]


def our_detector(case):
    from sklearn_mcmd import MCMDOutlierDetector

    return MCMDOutlierDetector(case.k, random_state=0, n_jobs=case.threads).fit_predict(case.X)


def local_outlier_factor(case):
    from sklearn.neighbors import LocalOutlierFactor

    return LocalOutlierFactor(case.k, n_jobs=case.threads).fit_predict(case.X)


def open3d_statistical(case):
    _, kept = open3d_cloud(case.X).remove_statistical_outlier(case.k, 2.0)
    labels = np.full(len(case.X), -1)
    labels[np.asarray(kept)] = 1
    return labels


def our_regions(case):
    from sklearn_mcmd import RegionGrowing

    return RegionGrowing(normals="precomputed", n_jobs=case.threads).fit(case.columns).labels_


def open3d_patches(case):
    import open3d

    cloud = open3d_cloud(case.X)
    cloud.normals = open3d.utility.Vector3dVector(np.ascontiguousarray(case.columns[:, 3:6]))
    neighbors = open3d.geometry.KDTreeSearchParamKNN(30)
    return len(cloud.detect_planar_patches(search_param=neighbors))


JOBS = {
    "search: sklearn_mcmd": Job(search_in_leaf_order, "sklearn_mcmd"),
    "search: sklearn_mcmd, caller's rows": Job(search_in_callers_rows, "sklearn_mcmd"),
    "search: SciPy cKDTree": Job(scipy_search, "scipy"),
    "search: SciPy cKDTree, leaf order": Job(scipy_search_in_leaf_order, "scipy"),
    "search: pykdtree": Job(pykdtree_search, "pykdtree"),
    "search: pynanoflann": Job(pynanoflann_search, "pynanoflann"),
    "search: small_gicp": Job(small_gicp_search, "small_gicp"),
    "search: pgeof, float32": Job(pgeof_search, "pgeof"),
    "search: scikit-learn kd_tree": Job(sklearn_search, "sklearn"),
    "normals: sklearn_mcmd, default": Job(our_normals(), "sklearn_mcmd"),
    "normals: sklearn_mcmd, literal": Job(our_normals(reweight=False), "sklearn_mcmd"),
    "normals: sklearn_mcmd, pca": Job(our_normals(method="pca"), "sklearn_mcmd"),
    "normals: Open3D": Job(open3d_normals, "open3d"),
    "normals: pgeof, float32": Job(pgeof_normals, "pgeof"),
    "normals: pgeof, by radius": Job(pgeof_normals_by_radius, "pgeof"),
    "normals: jakteristics, by radius": Job(jakteristics_normals, "jakteristics"),
    "normals: small_gicp": Job(small_gicp_normals, "small_gicp"),
    "outliers: sklearn_mcmd": Job(our_detector, "sklearn_mcmd"),
    "outliers: Open3D statistical": Job(open3d_statistical, "open3d"),
    "outliers: scikit-learn LOF": Job(local_outlier_factor, "sklearn", 100_000),
    "regions: sklearn_mcmd growing": Job(our_regions, "sklearn_mcmd"),
    "regions: Open3D planar patches": Job(open3d_patches, "open3d"),
}
