"""From a scene to a cloud with the truth of every point."""

from collections.abc import Sequence
from numbers import Integral, Real
from typing import NamedTuple

import numpy as np

from sklearn_mcmd._sklearn import Interval
from sklearn_mcmd.datasets._beams import REGULAR
from sklearn_mcmd.datasets._labels import labeled_cloud, outlier_sizes, streams
from sklearn_mcmd.datasets._outliers import CLEARANCE, SCENE_OUTLIERS
from sklearn_mcmd.datasets._scan_lines import effective_area, scan_lines
from sklearn_mcmd.datasets._surfaces import facing_normals

#: Constraints of the parameters that all makers share.
SHARED_PARAMETERS = {
    "n_samples": [Interval(Integral, 1, None, closed="left")],
    "noise": [Interval(Real, 0, None, closed="left")],
    "outlier_share": [Interval(Real, 0, 1, closed="left")],
    "random_state": ["random_state"],
}


class Scanning(NamedTuple):
    """How a scene is scanned: parameters of `make_street`."""

    noise: float
    outlier_share: float
    outlier_kinds: Sequence[str] = tuple(SCENE_OUTLIERS)
    sampling: str = "uniform"
    noise_growth: float = 1.0
    beam_divergence: float = 0.0


def scan(make_scene, n_samples, scanning, random_state):
    """Scan a scene: points, noise, outliers and the truth, as `make_street` documents them.

    ``make_scene(n)`` is the scene of n regular points.
    """
    sizes = outlier_sizes(n_samples, scanning.outlier_share, scanning.outlier_kinds, SCENE_OUTLIERS)
    n_echoes = n_samples - sum(sizes.values())
    scene = make_scene(n_echoes)
    points_rng, noise_rng, outlier_rng, order_rng = streams(random_state, 4)

    def scale_of(local):
        return scanning.noise * scene.growth(scene.ranges(local), scanning.noise_growth)

    def noise_at(points):
        return scale_of(scene.to_bay(points)[0])

    if scanning.sampling == "scan_lines":
        local, places, surface, bay, kind = scan_lines(scene, n_echoes, points_rng, scanning)
        # A scanner's error is that of the range.
        ray = local - scene.scanner
        ray /= np.linalg.norm(ray, axis=1, keepdims=True)
        deviations = ray * noise_rng.standard_normal((n_echoes, 1))
    else:
        local, surface = scene.sample(n_echoes, points_rng)
        places, kind = local, np.full(n_echoes, REGULAR)
        bay = points_rng.integers(scene.n_bays, size=n_echoes)
        deviations = noise_rng.standard_normal((n_echoes, 3))
    scale = scale_of(local)
    points = scene.to_scene(local, bay) + scale[:, None] * deviations
    edge_distance = np.empty(n_echoes)
    for number, part in enumerate(scene.parts):
        mine = np.flatnonzero(surface == number)
        edge_distance[mine] = scene.over_bays(part.edge_distance, places[mine], bay[mine])

    def clearance(points):
        return CLEARANCE * noise_at(points)

    outliers = [SCENE_OUTLIERS[name](scene, n, clearance, outlier_rng) for name, n in sizes.items()]
    outliers = np.concatenate(outliers)
    scanners = scene.scanners
    cloud = labeled_cloud(
        scene.parts,
        kind,
        sizes,
        ["regular", *SCENE_OUTLIERS],
        order_rng.permutation(n_samples),
        both={
            "data": (points, outliers),
            "noise_scale": (scale, noise_at(outliers)),
            "sensor_origins": (scanners[bay], scanners[scene.to_bay(outliers)[1]]),
        },
        regular={
            "true_points": (scene.to_scene(places, bay), np.nan),
            "normals": (facing_normals(scene.parts, places, surface, scene.scanner), np.nan),
            "surface": (surface, -1),
            "bay": (bay, -1),
            "edge_distance": (edge_distance, np.nan),
        },
    )
    per_bay = points_per_bay(scene, 1.0, scanning)
    cloud.update(spacing=float(np.sqrt(scene.n_bays * per_bay / n_echoes)), length=scene.length)
    return cloud


def points_per_bay(scene, spacing, scanning):
    """How many regular points a bay takes at that spacing."""
    lines = scanning.sampling == "scan_lines"
    return (effective_area(scene) if lines else scene.seen_area) / spacing**2
