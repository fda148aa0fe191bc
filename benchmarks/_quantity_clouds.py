"""The clouds in which much is wrong, or sparse, that `bench_quantity.py` measures on."""

from typing import NamedTuple

import numpy as np
from _real_clouds import Spacing, cloud_paths, cropped, random_directions, read_cloud

from sklearn_mcmd.datasets import make_street

FLAKE, LYING_SNOW, UNLABELLED = 110, 111, 0
# Mean distance to 8 neighbors: of points spread evenly in a plane and in a large ball, times the
# root or the cube root of their density; of discs of 25 to 70 points, as BALL_RADIUS (within 4 %).
SPACING_IN_PLANE, SPACING_IN_BALL, DISC_RADIUS = 1.09, 0.97, 0.446
OFF = 15, 60  # spacings between a flat piece and the nearest real point
BALL_PLACE, WALL = np.array([2.0, -1.5, 1.5]), np.array([4.0, 0.0, 3.0])
DEPTH, STRIP = 25.0, np.array([28.0, 18.0])  # meters


class Case(NamedTuple):
    """A cloud with a truth.

    name : str
    points : float64 (n, 3)
    outlier : bool (n,)
    parts : bool (n,) by name: kinds of outliers and classes of real points, of which the table has
        the share that is flagged
    position : float64 (3,) or (n, 3), where the sensor was, or None
    intensity : float64 (n,) or None
    known : bool (n,), points with a label, or None for all
    """

    name: str
    points: np.ndarray
    outlier: np.ndarray
    parts: dict = {}  # noqa: RUF012
    position: np.ndarray | None = None
    intensity: np.ndarray | None = None
    known: np.ndarray | None = None


def real_cloud(options, name):
    return cropped(read_cloud(name, cloud_paths(options.data)[name]), options.limit, options.seed)


def snow(options):
    name = "snow_real_half_turn/half_turn"
    with np.load(cloud_paths(options.data)[name]) as arrays:
        label = arrays["label"]
    cloud = read_cloud(name, cloud_paths(options.data)[name])
    label = cropped(cloud._replace(classes=label), options.limit, options.seed).classes
    cloud = cropped(cloud, options.limit, options.seed)
    parts = {"lying snow": label == LYING_SNOW}
    seen = np.zeros(3), cloud.intensity, label != UNLABELLED
    yield Case("real snow", cloud.points, label == FLAKE, parts, *seen)


def turns(options):
    for name in cloud_paths(options.data):
        if name.startswith("snow_spinning_lidar"):
            cloud = real_cloud(options, name)
            title = name.rpartition("/")[2]
            yield Case(title, cloud.points, cloud.noise, {}, np.zeros(3), cloud.intensity)


def street(options):
    n = options.limit or 100_000
    for sampling in ("uniform", "scan_lines"):
        for share in (0.1, 0.2):
            made = make_street(n, sampling=sampling, outlier_share=share, random_state=options.seed)
            kinds = enumerate(made.outlier_kind_names[1:], 1)
            parts = {name: made.outlier_kind == number for number, name in kinds}
            name = f"{sampling.replace('_', ' ')}, {share:.0%}"
            # Points drawn evenly over the surfaces do not lie on rays that a sensor sent out.
            position = made.sensor_origins if sampling == "scan_lines" else None
            yield Case(name, made.data, made.target == -1, parts, position)


def flat_pieces(points, n_pieces, rng):
    """Discs of 25 to 70 points at random directions from random points of a cloud."""
    spacing, pieces = Spacing(points), []
    while len(pieces) < n_pieces:
        row = rng.integers(len(spacing.points))
        away = rng.uniform(*OFF) * spacing.of_points[row] * random_directions(1, rng)
        center = spacing.points[row] + away
        unit, n = spacing.at(center)[0], rng.integers(25, 71)
        axes = np.linalg.qr(rng.normal(size=(3, 2)))[0].T
        angle, radius = rng.uniform(0, 2 * np.pi, n), np.sqrt(rng.random(n))
        radius *= DISC_RADIUS * np.sqrt(n) * unit
        piece = center + np.column_stack([radius * np.cos(angle), radius * np.sin(angle)]) @ axes
        if OFF[0] <= spacing.tree.query(piece)[0].min() / unit <= OFF[1]:
            pieces.append(piece)
    return pieces


def with_errors(name, points, errors, **of_case):
    outlier = np.arange(len(points) + len(errors)) >= len(points)
    return Case(name, np.vstack([points, errors]), outlier, **of_case)


def flat(options):
    names = ("ahn3_amsterdam_2397", "isprs_samp31", "pcl_cars_mincut", "jakarto_street_thinned")
    for name in names:
        cloud = real_cloud(options, name)
        points = cloud.points if cloud.noise is None else cloud.points[~cloud.noise]
        n_pieces = max(20, len(points) // 1_000)  # of 48 points on average
        pieces = flat_pieces(points, n_pieces, np.random.default_rng(options.seed))
        yield with_errors(name, points, np.vstack(pieces))


def ball_before_wall(ratio, inside, rng):
    """Points of a wall and of a ball, whose spacing is `ratio` times that of the wall."""
    n = 3_000
    radius = np.cbrt(rng.random((n, 1))) if inside else 1.0  # meters
    density = n / (4 * np.pi / 3 if inside else 4 * np.pi)
    of_ball = SPACING_IN_BALL / np.cbrt(density) if inside else SPACING_IN_PLANE / np.sqrt(density)
    n_wall = round(WALL.max() * WALL[2] * (SPACING_IN_PLANE * ratio / of_ball) ** 2)
    wall = rng.random((n_wall, 3)) * WALL + rng.normal(0, 0.003, (n_wall, 3))
    return wall, BALL_PLACE + radius * random_directions(n, rng)


def ball(options):
    for inside in (True, False):
        for ratio in (2.5, 3.5, 5.0):
            rng = np.random.default_rng(options.seed)
            wall, things = ball_before_wall(ratio, inside, rng)
            of_ball = np.arange(len(wall) + len(things)) >= len(wall)
            name = f"{'in' if inside else 'on'} the ball, {ratio:g}"
            points = np.vstack([wall, things])
            yield Case(name, points, np.zeros(len(points), bool), {"ball": of_ball})


def thinned(points, chosen, share, rng):
    """The points and which of them are chosen, of which a share is left."""
    kept = ~chosen | (rng.random(len(points)) < share)
    return points[kept], chosen[kept]


def vegetation(options):
    cloud = real_cloud(options, "ign_village")
    plants, rng = cloud.classes == "vegetation", np.random.default_rng(options.seed)
    for share in (0.3, 0.1, 0.03):
        points, left = thinned(cloud.points, plants, share, rng)
        yield Case(f"{share:.0%} of plants", points, np.zeros(len(points), bool), {"plants": left})


def below(points, strip, rng):
    """A strip of 32 or a ball of 120 errors, 25 m under the middle of a cloud in meters."""
    middle = np.median(points[:, :2], axis=0)
    nearest = np.abs(points[:, :2] - middle) <= STRIP / 2
    ground = points[nearest.all(axis=1), 2].min()
    if strip:
        errors = np.column_stack([rng.uniform(-0.5, 0.5, (32, 2)) * STRIP, rng.normal(0, 0.05, 32)])
    else:
        errors = 0.35 * np.cbrt(rng.random((120, 1))) * random_directions(120, rng)
    return np.array([*middle, ground - DEPTH]) + errors


def clump(options):
    rng = np.random.default_rng(options.seed)
    for name, share in (("isprs_samp31", 0.3), ("ign_village", 1.0)):
        cloud = real_cloud(options, name)
        points = cloud.points[~cloud.noise]
        points, _ = thinned(points, np.ones(len(points), bool), share, rng)
        for strip in (True, False):
            title = f"{'strip' if strip else 'ball'} under {name}"
            yield with_errors(title, points, below(points, strip, rng))


def clean(options):
    """Clouds without labelled or added errors."""
    names = ("ahn3_amsterdam_2397", "isprs_samp31", "jakarto_scanlines", "jakarto_street_thinned")
    names += ("pcl_cars_mincut", "pcl_lamppost", "cad_angle_block", "cad_featuretype")
    for name in (*names, "fast_gicp_velodyne", "kinect_tables/scene_5"):
        cloud = real_cloud(options, name)
        yield Case(name, cloud.points, np.zeros(len(cloud.points), bool))
