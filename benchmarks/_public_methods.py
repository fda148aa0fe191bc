"""What `bench_public.py` compares: our defaults, and peers with their best published settings.

A method takes a roof, a shape or a frame of `_public_data.py`. It returns the segment of each point
(-1: none), normals, or which points are snow. Of roofs peers are told half a spacing as distance,
five standard deviations of these; of snow one is told the share of flakes.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import _peer_jobs
import _region_methods as regions
import numpy as np
from _real_clouds import spacing_of
from _real_methods import neighbor_distances

from sklearn_mcmd import MCMDOutlierDetector, RegionGrowing, RobustNormalEstimator

SAME_BEAM = 1e-4  # radians; echoes of one beam share their direction to 2e-5


class Method(NamedTuple):
    run: Callable[[Any], np.ndarray]
    setting: str
    package: str = "sklearn_mcmd"  # the module that has to be there


def our_regions(roof):
    return RegionGrowing(random_state=0).fit_predict(roof.X)


def by_library(run, roof):
    """A method of `_region_methods.py`, told a distance and the least points of a plane."""
    X = np.ascontiguousarray(roof.X - roof.X.mean(axis=0))
    spacing = spacing_of(X)
    least = regions.LEAST if len(X) >= regions.SMALL else regions.LEAST_OF_SMALL
    return run(regions.Case(X, spacing, spacing / 2, least, regions.Clock()))


def open3d_planes(case):
    """One plane after another is taken out, until one has too few points."""
    import open3d

    open3d.utility.random.seed(0)
    cloud = _peer_jobs.open3d_cloud(case.X)
    labels, rows = np.full(len(case.X), -1), np.arange(len(case.X))
    for i in range(len(case.X)):
        inside = cloud.segment_plane(case.distance, 3, 1000)[1] if len(rows) >= case.least else []
        if len(inside) < case.least:
            break
        labels[rows[inside]] = i
        cloud = cloud.select_by_index(inside, invert=True)
        rows = np.delete(rows, inside)
    return labels


def cgal_growing(case):
    """With four times the distance, as its planes are fitted to few points first."""
    from CGAL.CGAL_Shape_detection import region_growing

    points, order = regions.cgal_points(case)
    labels = points.add_int_map("region")
    cosine = float(np.cos(np.radians(20)))
    region_growing(points, labels, case.least, 4 * case.distance, -1.0, cosine, 12)
    return regions.cgal_labels(labels, order)


ROOFS = {
    regions.OURS: Method(our_regions, "told nothing"),
    "Open3D patches": Method(partial(by_library, regions.open3d_patches), "defaults", "open3d"),
    "Open3D RANSAC": Method(partial(by_library, open3d_planes), "told a distance", "open3d"),
    "CGAL growing": Method(partial(by_library, cgal_growing), "told a distance", "CGAL"),
    "CGAL RANSAC": Method(partial(by_library, regions.cgal_ransac), "told a distance", "CGAL"),
}


def our_normals(shape, **parameters):
    return RobustNormalEstimator(random_state=0, **parameters).fit(shape.X).normals_


def by_open3d(shape):
    return _peer_jobs.open3d_normals(_peer_jobs.Case(shape.X, 112, threads=1, radius=0.0))


def cgal_normals(name, size, shape):
    """By CGAL's function of that name, of neighbors, or of radii in spacings."""
    from CGAL import CGAL_Point_set_processing_3

    points = regions.cgal_point_set(shape.X)
    if name == "vcm":
        size = (spacing_of(shape.X) * radius for radius in size)
    getattr(CGAL_Point_set_processing_3, f"{name}_estimate_normals")(points, *size)
    normals = (points.normal(row) for row in range(len(shape.X)))
    return np.array([(normal.x(), normal.y(), normal.z()) for normal in normals])


NORMALS = {
    regions.OURS: Method(our_normals, "told nothing"),
    "sklearn_mcmd, auto": Method(partial(our_normals, n_neighbors="auto"), "``auto`` neighbors"),
    **{
        f"PCA {k}": Method(partial(our_normals, method="pca", n_neighbors=k), f"{k} neighbors")
        for k in (18, 112, 450)  # small, medium and large of the benchmark's paper
    },
    "Open3D 112": Method(by_open3d, "112 neighbors", "open3d"),
    **{
        f"CGAL jets {k}": Method(partial(cgal_normals, "jet", (k,)), f"{k} neighbors", "CGAL")
        for k in (18, 112, 450)
    },
    # Of radii of 5 to 20 and 1 to 10 spacings the best for the shape without noise.
    "CGAL VCM": Method(partial(cgal_normals, "vcm", (10, 1)), "radii of 10 spacings, 1", "CGAL"),
}


def our_snow(frame, *, intensity=None):
    """Told nothing, or the position of the sensor, or the intensity as well."""
    position = {} if intensity is None else {"sensor_origin": "origin"}
    told = {"intensity": frame.intensity} if intensity else {}
    return MCMDOutlierDetector(random_state=0, **position).fit_predict(frame.X, **told) == -1


def ranges(X):
    """From the origin; those of points at the sensor itself are tiny."""
    return np.maximum(np.linalg.norm(X, axis=1), np.finfo(float).tiny)


def beam_angle(X):
    """Median angle to the next beam, in radians: of a spinning lidar, its step of azimuth."""
    rays = X / ranges(X)[:, None]
    _, rows = np.unique(np.round(rays / SAME_BEAM), axis=0, return_index=True)
    return np.median(neighbor_distances(rays[rows], 1))


def dror(frame):
    reach = np.maximum(3 * beam_angle(frame.X) * ranges(frame.X), 0.04)
    return neighbor_distances(frame.X, 3)[:, 2] > reach


def dsor(frame):
    distance = neighbor_distances(frame.X, 5).mean(axis=1)
    return distance > 0.05 * ranges(frame.X) * (distance.mean() + 0.01 * distance.std())


def lior(frame):
    weak = (frame.intensity <= 1) & (ranges(frame.X) < 71.2)
    return weak & (neighbor_distances(frame.X, 3)[:, 2] > 0.1)


def over_range(frame):
    ratio = neighbor_distances(frame.X, 10).mean(axis=1) / ranges(frame.X)
    return ratio > np.quantile(ratio, 1 - frame.snow.mean())


SNOW = {
    regions.OURS: Method(our_snow, "told nothing"),
    "sklearn_mcmd, position": Method(partial(our_snow, intensity=False), "of the sensor"),
    "sklearn_mcmd, intensity": Method(partial(our_snow, intensity=True), "and the position"),
    "DROR": Method(dror, "3 neighbors within 3 steps of azimuth, 4 cm at least"),
    "DSOR": Method(dsor, "5 neighbors, .05 of the range, .01 standard deviations"),
    "LIOR-like": Method(lior, "intensity to 1, within 71.2 m, 3 neighbors within .1 m"),
    "10 over range": Method(over_range, "told the share of flakes"),
}
