"""Regions by our default and by peers: `bench_segmentation.py peers`.

A method takes a `Case`, works inside its clock, and returns a label for each point, -1 for none.
Where a library asks for a distance, it is told what nobody tells us: three standard deviations of
the cloud's noise, but half a spacing at least.
"""

import importlib.metadata
import time
from collections.abc import Callable
from importlib.util import find_spec
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

OURS = "sklearn_mcmd"
LEAST = 50  # points of a plane: of PCL's tutorial and of CGAL's example
SMALL, LEAST_OF_SMALL = 2000, 20  # in smaller clouds: of 10, 20 and 50 best for most peers


class Clock:
    """Processor seconds of what runs inside it."""

    seconds = 0.0

    def __enter__(self):
        self.seconds -= time.process_time()

    def __exit__(self, *_):
        self.seconds += time.process_time()


class Case(NamedTuple):
    """Points about their center, their spacing, and what peers are told: distance, least points."""

    X: np.ndarray
    spacing: float
    distance: float
    least: int
    clock: Clock


class Method(NamedTuple):
    run: Callable[[Case], np.ndarray] | None  # None: stored results alone
    package: str  # the module
    setting: str


def version_of(method):
    """Package and version, or None if it is not installed."""
    package = METHODS[method].package
    if not find_spec(package):
        return None
    name = {OURS: "sklearn-mcmd", "CGAL": "cgal"}.get(package, package)
    return f"{name} {importlib.metadata.version(name)}"


def ours(case):
    from sklearn_mcmd import RegionGrowing

    with case.clock:
        return RegionGrowing(random_state=0).fit_predict(case.X)


def open3d_patches(case):
    """A point is of the box that it lies in; of several, of the one whose plane is nearest."""
    import open3d

    open3d.utility.random.seed(0)
    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(case.X))
    neighbors = open3d.geometry.KDTreeSearchParamKNN(30)
    with case.clock:
        cloud.estimate_normals(neighbors)
        boxes = cloud.detect_planar_patches(search_param=neighbors)
    labels, nearest = np.full(len(case.X), -1), np.full(len(case.X), np.inf)
    for i, box in enumerate(boxes):
        inside = np.asarray(box.get_point_indices_within_bounding_box(cloud.points), dtype=int)
        distances = np.abs((case.X[inside] - box.center) @ box.R[:, 2])
        nearer = distances < nearest[inside]
        labels[inside[nearer]], nearest[inside[nearer]] = i, distances[nearer]
    return labels


def cgal_points(case):
    """CGAL's points with normals, the flattest first, as its manual advises; and their rows."""
    from CGAL.CGAL_Point_set_processing_3 import pca_estimate_normals

    with case.clock:
        order = np.argsort(plane_deviations(case.X, 12))
    points = cgal_point_set(case.X[order])
    with case.clock:
        pca_estimate_normals(points, 24)
    return points, order


def cgal_point_set(X):
    """Points with room for normals."""
    from CGAL.CGAL_Kernel import Point_3
    from CGAL.CGAL_Point_set_3 import Point_set_3

    points = Point_set_3()
    points.add_normal_map()
    for point in X.tolist():
        points.insert(Point_3(*point))
    return points


def plane_deviations(X, k):
    """Standard deviation of the k nearest points from their plane."""
    deviations, tree = np.empty(len(X)), cKDTree(X)
    for start in range(0, len(X), 10_000):
        rows = slice(start, start + 10_000)
        near = X[tree.query(X[rows], k)[1]]
        near -= near.mean(axis=1, keepdims=True)
        deviations[rows] = np.linalg.eigvalsh(near.transpose(0, 2, 1) @ near)[:, 0]
    return np.sqrt(np.maximum(deviations, 0) / k)


def cgal_labels(labels, order):
    unordered = np.empty(len(order), dtype=int)
    # Not `points.indices()`: RANSAC shuffles them.
    unordered[order] = [labels.get(row) for row in range(len(order))]
    return unordered


def cgal_ransac(case):
    from CGAL.CGAL_Shape_detection import efficient_RANSAC

    points, order = cgal_points(case)
    labels = points.add_int_map("shape")
    settings = (case.least, case.distance, 2 * case.spacing)
    with case.clock:
        efficient_RANSAC(points, labels, *settings, 0.9, 0.05)
    return cgal_labels(labels, order)


# Of those without a function results are stored: commits 97bb9769 and 0bdc31fa have the programs.
METHODS = {
    OURS: Method(ours, OURS, "told nothing"),
    "Open3D patches": Method(
        open3d_patches, "open3d", "``detect_planar_patches``, defaults; normals of 30 neighbors"
    ),
    "Open3D RANSAC, d": Method(
        None, "open3d", "``segment_plane``, 1,000 trials, plane after plane; d"
    ),
    "CGAL growing, 20": Method(
        None, "CGAL", "``region_growing``, 12 neighbors, 4 d, 20 degrees, its example's"
    ),
    "CGAL RANSAC": Method(None, "CGAL", "``Efficient_RANSAC``, defaults"),
    "CGAL RANSAC, d": Method(cgal_ransac, "CGAL", "the same, d, ``cluster_epsilon`` of 2 spacings"),
    "PCL growing, 3": Method(
        None, "PCL", "``RegionGrowing``, 3 degrees, curvature 1, as in its tutorial"
    ),
    "PCL growing, 30": Method(None, "PCL", "the same, 30 degrees, curvature .05, its defaults"),
}
MEASURED = [name for name, method in METHODS.items() if method.run]
