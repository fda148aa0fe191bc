"""From a scene to a cloud with the truth of every point."""

from collections.abc import Sequence
from numbers import Integral, Real
from typing import NamedTuple

import numpy as np
from sklearn.utils import Bunch, check_random_state

from sklearn_mcmd._sklearn import Interval, StrOptions
from sklearn_mcmd.datasets._echoes import REGULAR, SNOW, own_codes, rows_of
from sklearn_mcmd.datasets._outliers import CLEARANCE, MAKERS, check_kinds
from sklearn_mcmd.datasets._scan_lines import Optics, effective_area, scan_lines

__all__ = ["SCAN_PARAMETERS", "Scanning", "points_per_bay", "scan"]

#: Constraints of the parameters that all makers of scenes share.
SCAN_PARAMETERS = {
    "n_samples": [Interval(Integral, 1, None, closed="left")],
    "sampling": [StrOptions({"uniform", "scan_lines"})],
    "spacing_growth": [Interval(Real, 1, None, closed="left")],
    "noise": [Interval(Real, 0, None, closed="left")],
    "noise_growth": [Interval(Real, 1, None, closed="left")],
    "outlier_share": [Interval(Real, 0, 1, closed="left")],
    "outlier_kinds": [list, tuple],
    "random_state": ["random_state"],
}


class Scanning(NamedTuple):
    """How a scene is scanned: parameters of `make_street`, and the outliers that there can be."""

    sampling: str
    spacing_growth: float
    noise: float
    noise_growth: float
    outlier_share: float
    outlier_kinds: Sequence[str]
    possible_kinds: tuple[str, ...] = tuple(MAKERS)
    beam_divergence: float = 0.0  # radians; for scan lines only
    snow: float = 0.0  # mm of water an hour; for scan lines only


def scan(make_scene, n_samples, scanning, random_state):
    """Scan a scene: points, noise, outliers and the truth, as `make_street` documents them.

    ``make_scene(n)`` is the scene of n regular points.
    """
    sampling, spacing_growth, noise, noise_growth, outlier_share, *kinds, width, snow = scanning
    check_kinds(*kinds)
    kinds = kinds[0]
    _check_sampling(sampling, spacing_growth, width, snow)
    n_outliers = round(outlier_share * n_samples)
    n_echoes = n_samples - n_outliers
    if n_echoes == 0:
        raise ValueError(
            f"outlier_share={outlier_share:g} of n_samples={n_samples} leaves no regular point: "
            "lower the share or give more points."
        )
    scene = make_scene(n_echoes)
    # One stream a purpose: the true points stay the same whatever the noise and the outliers.
    seed = check_random_state(random_state).randint(np.iinfo(np.int32).max)
    streams = np.random.default_rng(seed).spawn(5)
    points_rng, noise_rng, outlier_rng, order_rng, snow_rng = streams

    def noise_at(points):
        return noise * scene.growth(scene.to_bay(points)[0], noise_growth)

    if sampling == "scan_lines":
        optics = Optics(
            width, snow, lambda local: noise * scene.growth(local, noise_growth), snow_rng
        )
        local, places, surface, bay, kind = scan_lines(scene, n_echoes, points_rng, optics)
        # A scanner's error is that of the range.
        ray = local - scene.scanner
        ray /= np.linalg.norm(ray, axis=1, keepdims=True)
        deviations = ray * noise_rng.standard_normal((n_echoes, 1))
    else:
        local, surface = scene.sample(n_echoes, spacing_growth, points_rng)
        places, kind = local, np.full(n_echoes, REGULAR)
        bay = points_rng.integers(scene.n_bays, size=n_echoes)
        deviations = noise_rng.standard_normal((n_echoes, 3))
    scale = noise * scene.growth(local, noise_growth)
    points = scene.to_scene(local, bay) + scale[:, None] * deviations
    normals, edge_distance = _truth(scene, places, surface, bay)

    sizes = np.full(len(kinds), n_outliers // len(kinds))
    sizes[: n_outliers - sizes.sum()] += 1
    outliers = [
        MAKERS[kind](scene, size, lambda points: CLEARANCE * noise_at(points), outlier_rng)
        for kind, size in zip(kinds, sizes, strict=True)
    ]
    outliers = np.concatenate([np.empty((0, 3)), *outliers])
    names = ["regular", *MAKERS, *(["snow"] if snow else [])]
    codes = np.repeat([names.index(kind) for kind in kinds], sizes)
    rows, truth = rows_of(kind, n_outliers, order_rng.permutation(n_samples))
    scanners = scene.scanners
    per_bay = points_per_bay(scene, 1.0, sampling, spacing_growth)
    return Bunch(
        data=rows(points, outliers),
        target=truth(np.ones(n_echoes, np.int64), -1),
        true_points=truth(scene.to_scene(places, bay), np.nan),
        normals=truth(normals, np.nan),
        surface=truth(surface, -1),
        bay=truth(bay, -1),
        edge_distance=truth(edge_distance, np.nan),
        outlier_kind=rows(own_codes(kind, names), codes),
        noise_scale=rows(scale, noise_at(outliers)),
        sensor_origins=rows(scanners[bay], scanners[scene.to_bay(outliers)[1]]),
        surface_names=[part.name for part in scene.parts],
        outlier_kind_names=names,
        feature_names=["x", "y", "z"],
        spacing=float(np.sqrt(scene.n_bays * per_bay / max(np.sum(kind != SNOW), 1))),
        length=scene.length,
    )


def points_per_bay(scene, spacing, sampling, spacing_growth):
    """How many regular points a bay takes at that spacing."""
    if sampling == "scan_lines":
        return effective_area(scene) / spacing**2
    return scene.effective_area(spacing_growth) / spacing**2


def _check_sampling(sampling, spacing_growth, beam_divergence, snow):
    if sampling == "scan_lines" and spacing_growth != 1:
        raise ValueError(
            f"spacing_growth={spacing_growth:g} has no meaning with sampling='scan_lines', where "
            "the spacing grows with the range as the rays part: leave it 1."
        )
    for name, value in (("beam_divergence", beam_divergence), ("snow", snow)):
        if sampling != "scan_lines" and value:
            raise ValueError(
                f"{name}={value:g} has no meaning with sampling={sampling!r}, which has no beams: "
                f"give sampling='scan_lines', or leave {name} 0."
            )


def _truth(scene, local, surface, bay):
    """Normal and distance to the nearest sharp edge of the own surface, for each point."""
    normals = np.empty_like(local)
    edge_distance = np.empty(len(local))
    for number, part in enumerate(scene.parts):
        mine = np.flatnonzero(surface == number)
        normals[mine] = part.normals(local[mine])
        view = np.einsum("ij,ij->i", normals[mine], scene.scanner - local[mine])
        normals[mine[view < 0]] *= -1.0  # a panel is seen from either side
        edge_distance[mine] = scene.over_bays(part.edge_distance, local[mine], bay[mine])
    return normals, edge_distance
