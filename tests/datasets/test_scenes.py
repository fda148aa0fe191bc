"""Furniture, bus stop, box and crown roof: what is said about their points against brute force."""

from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial import cKDTree
from scipy.stats import kstest

from benchmarks._furniture import (
    _bus_stop,
    _traffic_furniture,
    make_bus_stop,
    make_traffic_furniture,
)
from sklearn_mcmd.datasets import make_box, make_crown_roof, make_street
from sklearn_mcmd.datasets._panels import Bilinear, Disc, Polygon
from sklearn_mcmd.datasets._scan_lines import LOWEST, scan_lines
from sklearn_mcmd.datasets._scene import Scene
from sklearn_mcmd.datasets._shapes import _box, _crown_roof
from sklearn_mcmd.datasets._surfaces import Cylinder, Foliage, Patch

SCENES = {
    "furniture": (make_traffic_furniture, _traffic_furniture),
    "bus stop": (make_bus_stop, _bus_stop),
    "box": (make_box, lambda: _box(0.1)),
    "crown roof": (make_crown_roof, lambda: _crown_roof(0.1)),
}
each_scene = pytest.mark.parametrize(("make", "scene_of"), SCENES.values(), ids=SCENES.keys())
each_sampling = pytest.mark.parametrize("sampling", ["uniform", "scan_lines"])


@cache
def made(make, sampling, seed=0):
    """A scene with noise that grows with the range and a fifth of outliers; made once."""
    return make(
        4000, sampling=sampling, outlier_share=0.2, noise=0.004, noise_growth=3, random_state=seed
    )


def angles(points, scanner):
    way = points - scanner
    elevation = np.arctan2(way[:, 2], np.hypot(way[:, 0], way[:, 1]))
    return np.arctan2(way[:, 1], way[:, 0]), elevation


# --- The street stays what it was -------------------------------------------------------------


def test_streets_are_those_of_the_figures_that_were_published():
    street = make_street(5000, outlier_share=0.3, random_state=0)
    first_and_last = [
        [0.5499167319954179, 4.6971897138273135, 1.1582052729489032],
        [3.9434432731937985, 3.9168059193132714, 0.8841431706953946],
    ]
    assert_allclose(street.data[[0, -1]], first_and_last, rtol=0, atol=1e-12)


# --- All scenes -------------------------------------------------------------------------------


@each_scene
@each_sampling
def test_points_without_noise_lie_on_their_surface(make, scene_of, sampling):
    cloud = made(make, sampling)
    for number, part in enumerate(scene_of().parts):
        mine = cloud.true_points[cloud.surface == number]
        assert_allclose(part.distance(mine), 0, atol=1e-9)


@each_scene
@each_sampling
def test_the_scanner_sees_every_point_from_its_normals_side(make, scene_of, sampling):
    cloud = made(make, sampling)
    scene = scene_of()
    solid = ~np.isnan(cloud.normals[:, 0])
    assert scene.visible(cloud.true_points[solid], tolerance=1e-6).all()
    view = cloud.sensor_origins[0] - cloud.true_points[solid]
    assert (np.einsum("ij,ij->i", cloud.normals[solid], view) > 0).all()
    assert_allclose(np.linalg.norm(cloud.normals[solid], axis=1), 1, rtol=1e-12)


@each_scene
def test_outliers_keep_clear_of_the_scene(make, scene_of):
    cloud = made(make, "uniform")
    outlier = cloud.target == -1
    assert outlier.sum() == 800
    distance = scene_of().distance(cloud.data[outlier])
    assert (distance > 4 * cloud.noise_scale[outlier]).all()
    assert (cloud.surface[outlier] == -1).all()
    assert np.isnan(cloud.edge_distance[outlier]).all()


@each_scene
def test_scenes_are_reproducible_and_differ_between_seeds(make, scene_of):
    first, again, other = (f(make, "uniform", seed).data for f, seed in
                           ((made, 0), (made.__wrapped__, 0), (made, 1)))  # fmt: skip
    assert_array_equal(first, again)
    assert not np.isin(first, other).any()


def noise_of(cloud):
    """Of the regular points, in their standard deviations; and these."""
    regular = cloud.target == 1
    scale = cloud.noise_scale[regular]
    return (cloud.data - cloud.true_points)[regular] / scale[:, None], scale


@each_scene
def test_noise_is_isotropic_where_points_are_drawn_and_along_the_ray_where_scanned(make, scene_of):
    noise, _ = noise_of(made(make, "uniform"))
    for column in noise.T:
        assert kstest(column, "norm").pvalue > 1e-3
    scanned = made(make, "scan_lines")
    noise, scale = noise_of(scanned)
    ray = scanned.true_points[scanned.target == 1] - scanned.sensor_origins[0]
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    along = np.einsum("ij,ij->i", noise, ray)
    assert kstest(along, "norm").pvalue > 1e-3
    assert_allclose(noise - along[:, None] * ray, 0, atol=1e-9)
    # From one to three times the noise at the nearest point.
    assert 0.004 <= scale.min() < scale.max() <= 0.012


@pytest.mark.parametrize(
    ("make", "parameters", "message"),
    [
        (make_box, {"outlier_kinds": ["mixed_pixel"], "outlier_share": 0.1}, "outlier_kinds="),
        (make_crown_roof, {"outlier_scale": 0.0}, "'outlier_scale' parameter"),
        (make_bus_stop, {"sampling": "random"}, "'sampling' parameter"),
        (make_bus_stop, {"sampling": "scan_lines", "spacing_growth": 2.0}, "spacing_growth=2"),
        (make_traffic_furniture, {"n_samples": 1, "outlier_share": 0.9}, "no regular point"),
    ],
)
def test_bad_parameters_of_scenes_are_named(make, parameters, message):
    with pytest.raises(ValueError, match=message):
        make(**parameters)


# --- Furniture and bus stop -------------------------------------------------------------------


def test_the_furniture_has_the_ten_flat_and_eleven_round_surfaces_of_the_paper():
    cloud = make_traffic_furniture(20_000, random_state=0)
    counts = np.bincount(cloud.surface, minlength=21)
    assert counts.min() >= 20
    round_parts = [p.name for p in _traffic_furniture().parts if isinstance(p, Cylinder)]
    assert len(set(round_parts) - {"road"}) == 11
    assert len(cloud.surface_names) == 21


def test_the_bus_stop_has_the_31_surfaces_of_the_paper_each_of_40_points():
    cloud = make_bus_stop(random_state=0)
    counts = np.bincount(cloud.surface)
    assert (counts > 0).sum() == 31
    assert counts[counts > 0].min() >= 40


@pytest.mark.parametrize("scene_of", [_traffic_furniture, _bus_stop])
def test_wherever_two_surfaces_meet_both_have_an_edge(scene_of):
    parts = [p for p in scene_of().parts if not isinstance(p, Foliage)]
    rng, met = np.random.default_rng(0), 0
    for part in parts:
        points = part.sample(4_000, rng)
        for foot in getattr(part, "circles", ()):
            # Inside a pole's foot no point is ever seen.
            if isinstance(part, Patch):
                away = np.linalg.norm(points[:, :2] - foot.center[:2], axis=1) > foot.radius
                points = points[away]
        for other in parts:
            if other is part:
                continue
            near = points[other.distance(points) < 0.01]
            if len(near) and not _hidden(part, other):
                met += 1
                assert part.edge_distance(near).max() < 0.025, (part.name, other.name)
    assert met > 20


def _hidden(part, other):
    """Contacts out of the scanner's sight: under an umbrella, in the foliage."""
    names = {part.name, other.name}
    return any("panel" in n for n in names) and any(n.endswith("_pole") for n in names)


def test_foliage_is_scanned_in_depth_and_lets_some_rays_through():
    leaves = Foliage("foliage", (0, 3, 0), 1.0)
    wall = Patch("wall", (-2, 6, -2), (4, 0, 0), (0, 0, 4))
    scene = Scene([leaves, wall], 1.0, 1, scanner=(0, 0, 0))
    points, _, surface, *_ = scan_lines(scene, 20_000, np.random.default_rng(0))
    hit = points[surface == 0]
    assert_allclose(np.linalg.norm(hit - leaves.center, axis=1).max(), 1, atol=0.01)
    azimuth, elevation = angles(points, scene.scanner)
    # Through the middle: an exponential depth of mean .7 over a way of 2 leaves e^(-2 / .7).
    central = np.hypot(azimuth - np.pi / 2, elevation) < 0.03
    through = (surface[central] == 1).mean()
    expected = np.exp(-2 / 0.7)
    error = np.sqrt(expected * (1 - expected) / central.sum())
    assert central.sum() > 50
    assert abs(through - expected) < 4 * error + 0.005


# --- Scan lines -------------------------------------------------------------------------------


def test_scanned_points_lie_on_vertical_lines_of_equal_azimuth_at_equal_steps():
    cloud = make_traffic_furniture(20_000, sampling="scan_lines", noise=0, random_state=0)
    azimuth, elevation = angles(cloud.data, cloud.sensor_origins[0])
    for angle in (azimuth, elevation):
        levels = np.unique(np.round(angle, 9))
        steps = np.diff(levels)
        step = np.median(steps)
        assert len(levels) < 1500  # of 20 000 points
        assert_allclose(steps / step, np.round(steps / step), atol=1e-4)
    assert elevation.min() >= LOWEST


def test_the_density_of_a_scan_falls_with_the_square_of_the_range_and_the_incidence():
    cloud = make_street(60_000, sampling="scan_lines", noise=0, outlier_share=0, random_state=1)
    road = cloud.data[cloud.surface == 0]
    scanner = cloud.sensor_origins[0]
    # On the level road: incidence h / r, and columns closer by the cosine of the elevation.
    windows = [(0.2, 0.7), (0.7, 1.2), (3.6, 4.1), (4.1, 4.6)]
    found, expected = [], []
    for low, high in windows:
        inside = (road[:, 0] >= low) & (road[:, 0] < high) & (road[:, 1] > 1) & (road[:, 1] < 1.5)
        grid = np.stack(
            np.meshgrid(np.linspace(low, high, 41), np.linspace(1, 1.5, 41)), axis=-1
        ).reshape(-1, 2)
        flat = np.linalg.norm(grid - scanner[:2], axis=1)
        height = scanner[2] - 0.03
        r = np.hypot(flat, height)
        found.append(inside.sum())
        expected.append(np.mean(height / r / r**2 / (flat / r)))
    ratio = np.array(found) / expected
    assert min(found) > 200
    assert_allclose(ratio / ratio.mean(), 1, atol=0.1)


def test_nothing_is_scanned_in_the_shadow_of_what_stands_before():
    cloud = make_traffic_furniture(30_000, sampling="scan_lines", noise=0, random_state=2)
    column = cloud.surface_names.index("column")
    behind = cloud.data[(cloud.surface == cloud.surface_names.index("footpath"))]
    way, foot = (
        behind[:, :2] - cloud.sensor_origins[0, :2],
        np.array([4.5, 4.8]) - cloud.sensor_origins[0, :2],
    )
    share = np.clip(way @ foot / (way * way).sum(axis=1), 0, 1)
    miss = np.linalg.norm(share[:, None] * way - foot, axis=1)
    assert (cloud.surface == column).sum() > 300
    assert miss.min() > 0.35 - 1e-9


def test_a_long_scanned_street_has_the_spacing_that_was_asked():
    street = make_street(40_000, spacing=0.04, sampling="scan_lines", random_state=0)
    # What a bay's scanner sees grows less than in proportion to its length.
    assert street.spacing == pytest.approx(0.04, rel=0.03)
    counts = np.bincount(street.bay[street.bay >= 0])
    assert len(counts) == len(np.unique(street.sensor_origins, axis=0)) > 1
    assert np.ptp(counts) <= 1


# --- Box and roof -----------------------------------------------------------------------------


def test_the_edge_distance_of_the_box_is_that_of_its_three_edges():
    box = make_box(2000, random_state=0)
    far = np.sort(1 - box.true_points, axis=1)  # the face's own coordinate is 1
    assert_allclose(far[:, 0], 0, atol=1e-12)
    assert_allclose(box.edge_distance, far[:, 1], atol=1e-12)


def test_the_ridges_of_the_crown_roof_bend_as_the_documentation_says():
    parts = _crown_roof(0.1).parts
    west, east = parts[0], parts[1]
    for y, expected in ((1e-6, 60), (1 - 1e-6, 32)):
        ridge = np.array([[1.0, y, 0.6 + 0.3 * y]])
        cosine = np.sum(west.normals(ridge) * east.normals(ridge))
        assert np.degrees(np.arccos(cosine)) == pytest.approx(expected, abs=0.5)


def test_the_edge_distance_of_the_roof_is_that_to_its_four_ridges():
    roof = make_crown_roof(2000, random_state=0)
    t = np.linspace(0, 1, 4001)[:, None]
    center = np.array([1, 1, 0.9])
    gables = np.array([(1, 0, 0.6), (2, 1, 0.6), (1, 2, 0.6), (0, 1, 0.6)])
    ridges = np.concatenate([center + t * (g - center) for g in gables])
    assert_allclose(roof.edge_distance, cKDTree(ridges).query(roof.true_points)[0], atol=2e-4)


def test_samples_of_a_bilinear_surface_are_uniform_over_its_area():
    part = Bilinear("roof", [(0, 0, 0), (1, 0, 0.8), (1.1, 1.2, 0), (0, 1, 0.9)])
    points = part.sample(40_000, np.random.default_rng(0))
    # Area of a half by triangles of a fine grid, independent of the parametrization's Jacobian.
    u = np.linspace(0, 1, 201)
    grid = part._surface(*(g.ravel() for g in np.meshgrid(u, u))).reshape(201, 201, 3)
    a, b, c, d = grid[:-1, :-1], grid[:-1, 1:], grid[1:, :-1], grid[1:, 1:]
    cells = sum(
        np.linalg.norm(np.cross(y - x, z - x), axis=-1) / 2 for x, y, z in ((a, b, c), (d, c, b))
    )
    assert part.area == pytest.approx(cells.sum(), rel=1e-4)
    in_half = part._foot(points)[0] < 0.5
    share = cells[:, :100].sum() / cells.sum()
    assert in_half.mean() == pytest.approx(share, abs=5 * np.sqrt(0.25 / 40_000))


def test_edges_of_a_polygon_are_its_sides():
    square = Polygon("square", [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)])
    points = square.sample(500, np.random.default_rng(0))
    x, y = points[:, 0], points[:, 1]
    assert_allclose(square.edge_distance(points), np.min([x, y, 1 - x, 1 - y], axis=0), atol=1e-12)


def test_edges_of_a_ring_are_both_its_circles():
    ring = Disc("ring", (0, 0, 1), (0, 0, 1), 0.9, inner=0.4)
    points = ring.sample(500, np.random.default_rng(0))
    reach = np.linalg.norm(points[:, :2], axis=1)
    assert_allclose(ring.edge_distance(points), np.minimum(0.9 - reach, reach - 0.4), atol=1e-12)
