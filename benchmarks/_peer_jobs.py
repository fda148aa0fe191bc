"""What `bench_peers.py` measures: normals, outliers, regions and edges, ours and of peers.

A job takes a `Case` and returns an array with a row for each point. Imports are inside the jobs, so
a process loads the one library that it measures.
"""

from collections.abc import Callable
from importlib.util import find_spec
from typing import Any, NamedTuple

import numpy as np

KINDS = ("normals", "outliers", "regions", "edges")
OURS = "normals: sklearn_mcmd, default"  # to which others are compared


class Case(NamedTuple):
    """X (n, 3), neighbors, threads, a radius that holds k points, normals and their columns."""

    X: np.ndarray
    k: int
    threads: int
    radius: float
    columns: np.ndarray | None = None


class Job(NamedTuple):
    """One row of the tables."""

    run: Callable[[Case], Any]
    package: str  # the module that has to be there


def is_installed(job):
    return find_spec(JOBS[job].package) is not None


def single_precision(X):
    """X about its center as float32, for libraries that take nothing else."""
    return (X - X.mean(axis=0)).astype(np.float32)


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


def our_growing(case):
    from sklearn_mcmd import RegionGrowing, RobustNormalEstimator

    normals = RobustNormalEstimator(case.k)
    growing = RegionGrowing(normal_estimator=normals, random_state=0, n_jobs=case.threads)
    return growing.fit(case.X).labels_


def our_edges(case):
    from sklearn_mcmd import MCMDOutlierDetector, RobustNormalEstimator, SharpFeatureDetector

    detector = SharpFeatureDetector(
        outlier_detector=MCMDOutlierDetector(case.k),
        normal_estimator=RobustNormalEstimator(case.k),
        random_state=0,
        n_jobs=case.threads,
    )
    return detector.fit_predict(case.X)


def open3d_patches(case):
    import open3d

    cloud = open3d_cloud(case.X)
    cloud.normals = open3d.utility.Vector3dVector(np.ascontiguousarray(case.columns[:, 3:6]))
    neighbors = open3d.geometry.KDTreeSearchParamKNN(30)
    return len(cloud.detect_planar_patches(search_param=neighbors))


JOBS = {
    OURS: Job(our_normals(), "sklearn_mcmd"),
    "normals: sklearn_mcmd, literal": Job(our_normals(reweight=False), "sklearn_mcmd"),
    "normals: sklearn_mcmd, pca": Job(our_normals(method="pca"), "sklearn_mcmd"),
    "normals: Open3D": Job(open3d_normals, "open3d"),
    "normals: pgeof, float32": Job(pgeof_normals, "pgeof"),
    "normals: pgeof, by radius": Job(pgeof_normals_by_radius, "pgeof"),
    "normals: jakteristics, by radius": Job(jakteristics_normals, "jakteristics"),
    "normals: small_gicp": Job(small_gicp_normals, "small_gicp"),
    "outliers: sklearn_mcmd": Job(our_detector, "sklearn_mcmd"),
    "outliers: Open3D statistical": Job(open3d_statistical, "open3d"),
    "outliers: scikit-learn LOF": Job(local_outlier_factor, "sklearn"),
    "regions: sklearn_mcmd, with normals": Job(our_growing, "sklearn_mcmd"),
    "regions: sklearn_mcmd, normals given": Job(our_regions, "sklearn_mcmd"),
    "regions: Open3D planar patches, normals given": Job(open3d_patches, "open3d"),
    "edges: sklearn_mcmd, with normals and detector": Job(our_edges, "sklearn_mcmd"),
}
