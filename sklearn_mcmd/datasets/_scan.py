"""From a scene to a cloud with the truth of every point."""

from collections.abc import Sequence
from numbers import Integral, Real
from typing import NamedTuple

import numpy as np
from sklearn.utils import Bunch, check_random_state

from sklearn_mcmd._sklearn import Interval, StrOptions
from sklearn_mcmd.datasets._glass import reflection
from sklearn_mcmd.datasets._outliers import CLEARANCE, MAKERS
from sklearn_mcmd.datasets._scan_lines import effective_area, scan_lines

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
    """How a scene is scanned: parameters of `make_street`, and the outliers that there can be.

    possible_kinds : tuple of str
    """

    sampling: str
    spacing_growth: float
    noise: float
    noise_growth: float
    outlier_share: float
    outlier_kinds: Sequence[str]
    possible_kinds: tuple[str, ...] = tuple(MAKERS)


def scan(make_scene, n_samples, scanning, random_state):
    """Scan a scene: points, noise, outliers and the truth, as `make_street` documents them.

    Parameters
    ----------
    make_scene : callable
        The scene, from the number of its regular points.
    n_samples : int
    scanning : Scanning
    random_state : int, RandomState instance or None
    """
    sampling, spacing_growth, noise, noise_growth, outlier_share, *kinds = scanning
    kinds = _check_kinds(*kinds)
    _check_sampling(sampling, spacing_growth)
    n_outliers = round(outlier_share * n_samples)
    n_regular = n_samples - n_outliers
    if n_regular == 0:
        raise ValueError(
            f"outlier_share={outlier_share:g} of n_samples={n_samples} leaves no regular point: "
            "lower the share or give more points."
        )
    scene = make_scene(n_regular)
    # One stream a purpose: the true points stay the same whatever the noise and the outliers.
    seed = check_random_state(random_state).randint(np.iinfo(np.int32).max)
    points_rng, noise_rng, outlier_rng, order_rng = np.random.default_rng(seed).spawn(4)

    def noise_at(points):
        return noise * scene.growth(scene.to_bay(points)[0], noise_growth)

    if sampling == "scan_lines":
        local, surface, bay = scan_lines(scene, n_regular, points_rng)
        # A scanner's error is that of the range.
        ray = local - scene.scanner
        ray /= np.linalg.norm(ray, axis=1, keepdims=True)
        deviations = ray * noise_rng.standard_normal((n_regular, 1))
    else:
        local, surface = scene.sample(n_regular, spacing_growth, points_rng)
        bay = points_rng.integers(scene.n_bays, size=n_regular)
        deviations = noise_rng.standard_normal((n_regular, 3))
    true_points = scene.to_scene(local, bay)
    scale = noise * scene.growth(local, noise_growth)
    normals, edge_distance = _truth(scene, local, surface, bay)

    sizes = np.full(len(kinds), n_outliers // len(kinds)) if kinds else np.zeros(0, int)
    sizes[: n_outliers - sizes.sum()] += 1
    makers = MAKERS
    if "reflection" in scanning.possible_kinds:
        makers = {**MAKERS, "reflection": reflection}
    outliers = [
        makers[kind](scene, size, lambda points: CLEARANCE * noise_at(points), outlier_rng)
        for kind, size in zip(kinds, sizes, strict=True)
    ]
    outliers = np.concatenate([np.empty((0, 3)), *outliers])
    names = ["regular", *makers]
    codes = np.repeat([names.index(kind) for kind in kinds], sizes)

    order = order_rng.permutation(n_samples)

    def rows(regular, filling):
        filling = np.broadcast_to(filling, (n_outliers, *regular.shape[1:]))
        return np.concatenate([regular, filling]).astype(regular.dtype)[order]

    per_bay = points_per_bay(scene, 1.0, sampling, spacing_growth)
    return Bunch(
        data=rows(true_points + scale[:, None] * deviations, outliers),
        target=rows(np.ones(n_regular, np.int64), -1),
        true_points=rows(true_points, np.nan),
        normals=rows(normals, np.nan),
        surface=rows(surface, -1),
        bay=rows(bay, -1),
        edge_distance=rows(edge_distance, np.nan),
        outlier_kind=rows(np.zeros(n_regular, np.int8), codes),
        noise_scale=rows(scale, noise_at(outliers)),
        surface_names=[part.name for part in scene.parts],
        outlier_kind_names=names,
        feature_names=["x", "y", "z"],
        scanners=scene.scanners,
        spacing=float(np.sqrt(scene.n_bays * per_bay / n_regular)),
        length=scene.length,
    )


def points_per_bay(scene, spacing, sampling, spacing_growth):
    """How many regular points a bay takes at that spacing."""
    if sampling == "scan_lines":
        return effective_area(scene) / spacing**2
    return scene.effective_area(spacing_growth) / spacing**2


def _check_kinds(kinds, possible):
    unknown = [kind for kind in kinds if kind not in possible]
    if unknown or len(set(kinds)) < len(kinds) or not kinds:
        raise ValueError(
            f"outlier_kinds={kinds!r} must name, once each, one or more of {list(possible)}; "
            "for a cloud without outliers set outlier_share=0."
        )
    return list(kinds)


def _check_sampling(sampling, spacing_growth):
    if sampling == "scan_lines" and spacing_growth != 1:
        raise ValueError(
            f"spacing_growth={spacing_growth:g} has no meaning with sampling='scan_lines', where "
            "the spacing grows with the range as the rays part: leave it 1."
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
