"""A scene, which is parts and the scanner that sees them, and its cloud with all the truth."""

from functools import cache, cached_property
from numbers import Integral, Real

import numpy as np
from sklearn.utils import Bunch, check_random_state

from sklearn_mcmd._sklearn import Interval
from sklearn_mcmd.datasets._outliers import CLEARANCE, SCENE_OUTLIERS
from sklearn_mcmd.datasets._surfaces import first_hits

#: Constraints of the parameters that all makers share.
SHARED_PARAMETERS = {
    "n_samples": [Interval(Integral, 1, None, closed="left")],
    "noise": [Interval(Real, 0, None, closed="left")],
    "outlier_share": [Interval(Real, 0, 1, closed="left")],
}
LOWEST = -np.radians(60)  # a scanner is blind below this elevation
_PILOT = 250  # rays on a side of the grid that measures the share of the view that holds something
_SURPLUS = 0.02  # share of rays that are lost at random, as those on dark surfaces are
_N_QUADRATURE = 1 << 16  # points of sums over the visible surface; the error is about 0.3 %


class Scene:
    """Parts that are scanned from one place.

    `displacement` is the standard deviation of "gaussian" outliers on each axis.
    """

    def __init__(self, parts, scanner, *, displacement=0.2):
        self.parts = parts
        self.displacement = displacement
        self.scanner = np.asarray(scanner, float)
        low = np.min([part.bounds[0] for part in parts], axis=0)
        high = np.max([part.bounds[1] for part in parts], axis=0)
        self.bounds = np.array([low, high])
        self.areas = np.array([part.area for part in parts])
        self.farthest_range = max(
            np.linalg.norm(np.abs(part.bounds - self.scanner).max(axis=0)) for part in parts
        )

    def distance(self, points):
        """Distance of any points (n, 3) to the nearest part of the scene."""
        return np.min([part.distance(points) for part in self.parts], axis=0)

    def ranges(self, points):
        """Of points, from the scanner."""
        return np.linalg.norm(points - self.scanner, axis=1)

    def first_hit(self, ends):
        """First meeting of the rays scanner -> ends (n, 3) with a part, as a fraction, or inf."""
        return np.min([part.hit(self.scanner, ends) for part in self.parts], axis=0)

    def visible(self, points, tolerance=1e-6):
        """Whether the scanner sees the points (n, 3) of surfaces."""
        return (1.0 - self.first_hit(points)) * self.ranges(points) <= tolerance

    def sample(self, n, rng):
        """n points that the scanner sees, with the number of their part."""
        kept, labels, missing = [], [], n
        acceptance = self.seen_area / self.areas.sum()
        while missing > 0:
            m = int(1.05 * missing / acceptance) + 64
            counts = rng.multinomial(m, self.areas / self.areas.sum())
            of_parts = [p.sample(c, rng) for p, c in zip(self.parts, counts, strict=True)]
            points, label = np.concatenate(of_parts), np.repeat(np.arange(len(counts)), counts)
            rng.random(m)  # as many numbers as ever, so that scenes stay what they were
            # The points come in the order of the parts, so a plain cut would leave out the last.
            chosen = rng.permutation(np.flatnonzero(self.visible(points)))[:missing]
            kept.append(points[chosen])
            labels.append(label[chosen])
            missing -= len(chosen)
        return np.concatenate(kept), np.concatenate(labels)

    @cached_property
    def seen_area(self):
        """Area of the seen surface in m^2, summed over points of a fixed seed."""
        rng = np.random.default_rng(0)
        counts = np.maximum(_N_QUADRATURE * self.areas / self.areas.sum(), 256).astype(int)
        points = np.concatenate([p.sample(c, rng) for p, c in zip(self.parts, counts, strict=True)])
        weights = np.repeat(self.areas / counts, counts)
        return float(weights[self.visible(points)].sum())


def scan(
    scene,
    n_samples,
    noise,
    outlier_share,
    random_state,
    *,
    outlier_kinds=tuple(SCENE_OUTLIERS),
    noise_growth=1.0,
    on_lines=False,
):
    """Scan a scene: points, noise, outliers and the truth, as `make_street` documents them.

    Points are a sample of even density, or on scan lines.
    """
    sizes = _outlier_sizes(n_samples, outlier_share, list(outlier_kinds))
    n = n_samples - sum(sizes.values())
    # One stream a purpose: true points stay whatever noise and outliers are.
    seed = check_random_state(random_state).randint(np.iinfo(np.int32).max)
    points_rng, noise_rng, outlier_rng, order_rng = np.random.default_rng(seed).spawn(4)
    nearest = min(part.distance(scene.scanner[None])[0] for part in scene.parts)

    def scale_at(ranges):
        share = np.clip((ranges - nearest) / (scene.farthest_range - nearest), 0.0, 1.0)
        return noise * (1.0 + (noise_growth - 1.0) * share)

    def is_clear(points, more=0.0):
        return scene.distance(points) > more + CLEARANCE * scale_at(scene.ranges(points))

    if on_lines:
        points, surface = scan_lines(scene, n, points_rng)
        # A scanner's error is that of the range.
        ray = points - scene.scanner
        ray /= np.linalg.norm(ray, axis=1, keepdims=True)
        deviations = ray * noise_rng.standard_normal((n, 1))
        area = angular_area(scene) * nearest**2
    else:
        points, surface = scene.sample(n, points_rng)
        deviations = noise_rng.standard_normal((n, 3))
        area = scene.seen_area
    scale = scale_at(scene.ranges(points))
    kinds = [SCENE_OUTLIERS[name](scene, m, is_clear, outlier_rng) for name, m in sizes.items()]
    outliers, order = np.concatenate(kinds), order_rng.permutation(n_samples)

    def join(of_points, of_outliers):
        of_outliers = np.broadcast_to(of_outliers, (len(outliers), *of_points.shape[1:]))
        return np.concatenate([of_points, of_outliers]).astype(of_points.dtype)[order]

    normals, edge_distance = np.empty_like(points), np.empty(n)
    for number in np.unique(surface):
        mine = surface == number
        normals[mine] = scene.parts[number].normals(points[mine])
        edge_distance[mine] = scene.parts[number].edge_distance(points[mine])
    away = np.einsum("ij,ij->i", normals, scene.scanner - points) < 0
    normals[away] *= -1.0  # a panel is seen from either side
    names = ["regular", *SCENE_OUTLIERS]
    codes = np.repeat([names.index(kind) for kind in sizes], list(sizes.values()))
    return Bunch(
        data=join(points + scale[:, None] * deviations, outliers),
        target=join(np.ones(n, np.int64), -1),
        true_points=join(points, np.nan),
        normals=join(normals, np.nan),
        surface=join(surface, -1),
        edge_distance=join(edge_distance, np.nan),
        noise_scale=join(scale, scale_at(scene.ranges(outliers))),
        sensor_origins=join(np.tile(scene.scanner, (n, 1)), scene.scanner),
        outlier_kind=join(np.zeros(n, np.int8), codes),
        outlier_kind_names=names,
        surface_names=[part.name for part in scene.parts],
        spacing=float(np.sqrt(area / n)),
    )


def _outlier_sizes(n_samples, share, kinds):
    """How many outliers of each kind: a share of all points, in (nearly) equal parts.

    Raise unless kinds are known, each once, and regular points are left.
    """
    if not set(kinds) <= set(SCENE_OUTLIERS) or len(set(kinds)) < len(kinds) or not kinds:
        raise ValueError(
            f"outlier_kinds={kinds!r} must name, once each, one or more of {list(SCENE_OUTLIERS)}."
        )
    n = round(share * n_samples)
    if n >= n_samples:
        raise ValueError(f"outlier_share={share:g} leaves no regular point of {n_samples}.")
    return {kind: n // len(kinds) + (i < n % len(kinds)) for i, kind in enumerate(kinds)}


def scan_lines(scene, n, rng):
    """n points of the scene's surfaces on vertical scan lines at equal angles, and their parts.

    From the scanner rays leave in columns of equal azimuth, at equal steps of azimuth and
    elevation, and end at the first surface they meet. So the density falls with the square of the
    range and with the angle of incidence, and what lies behind another surface is in shadow.
    """
    step = np.sqrt(angular_area(scene) / ((1 + _SURPLUS) * n + 4))
    while True:
        points, part, _ = _cast(scene, step, rng)
        if len(points) >= n:
            rows = np.sort(rng.permutation(len(points))[:n])
            return points[rows], part[rows]
        step *= 0.99


@cache
def angular_area(scene):
    """Azimuth times elevation, in square radians, in which the scanner meets a surface."""
    low, high = _elevations(scene)
    size = 2 * np.pi * (high - low)
    points, _, n_rays = _cast(scene, np.sqrt(size) / _PILOT, np.random.default_rng(0))
    return size * (len(points) / n_rays)


def _cast(scene, step, rng):
    """Where rays of the scanner end, column by column, the parts there, and how many rays left."""
    view = (-np.pi, np.pi), _elevations(scene)
    azimuth, elevation = (np.arange(low + step * rng.random(), high, step) for low, high in view)
    azimuth, elevation = np.repeat(azimuth, len(elevation)), np.tile(elevation, len(azimuth))
    flat = np.cos(elevation)
    ray = np.column_stack([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)])
    ray *= 1.01 * scene.farthest_range
    fraction, part = first_hits(scene.parts, scene.scanner, scene.scanner + ray, rng)
    met = part >= 0
    return scene.scanner + fraction[met, None] * ray[met], part[met], len(ray)


def _elevations(scene):
    """Least and greatest elevation, in radians, that can hold a part."""
    lowest, highest = [], []
    for part in scene.parts:
        low, high = part.bounds - scene.scanner
        nearest = np.linalg.norm(np.maximum(np.maximum(low, -high), 0.0)[:2])
        farthest = np.linalg.norm(np.maximum(np.abs(low), np.abs(high))[:2])
        lowest.append(np.arctan2(low[2], nearest if low[2] < 0 else farthest))
        highest.append(np.arctan2(high[2], nearest if high[2] > 0 else farthest))
    return max(min(lowest), LOWEST), max(highest)
