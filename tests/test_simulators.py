"""benchmarks/simulators: the physics on which figures of the pages rest, and their seeds."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial import cKDTree

from benchmarks import simulators
from benchmarks.simulators._furniture import _bus_stop, _traffic_furniture
from scenes import WORLDS, scanned
from sklearn_mcmd.datasets._sensor_outliers import SENSOR_OUTLIERS
from sklearn_mcmd.datasets._surfaces import Cylinder, Foliage, Patch, Soft
from sklearn_mcmd.io import PointCloud, sensor_origins

ALL = ["mixed_pixel", "range_error", "ghost", "low", "high", "particle", "no_return"]
SEEDS = {
    "make_mobile_scan": (
        {"outlier_share": 0.1, "far_share": 0.05, "outlier_kinds": ALL},
        (8.829294658, 0.10400707, 0.028100448),
        92237.98514,
    ),
    "make_airborne_scan": (
        {"far_share": 0.05},
        (35.773295123, 1.746501107, -0.005876905),
        349763.843307,
    ),
    "make_depth_frame": ({}, (-0.123732252, 4.367026223, 1.45190041), 27639.866871),
    "make_traffic_furniture": (
        {"outlier_share": 0.2},
        (7.96965013, 3.53275642, 0.10328705),
        34959.485373,
    ),
    "make_bus_stop": ({"outlier_share": 0.2}, (6.60745103, 3.4039736, 0.17481952), 34783.051122),
}


@pytest.mark.parametrize("name", SEEDS)
def test_a_seed_keeps_its_cloud(name):
    """Golden results, ablations and the pages' figures rest on these."""
    parameters, first, total = SEEDS[name]
    n = 4000 if name in ("make_traffic_furniture", "make_bus_stop") else 5000
    points = getattr(simulators, name)(n, random_state=0, **parameters).data
    assert_allclose(points[0], first, atol=6e-9)
    assert np.abs(points).sum() == pytest.approx(total, rel=1e-9)


@pytest.mark.parametrize("name", WORLDS)
def test_points_are_the_first_that_beams_meet_and_outliers_are_off_everything(name):
    kinds, far_share = tuple(ALL), {"far_share": 0.05}
    if name == "make_lidar_turn":
        kinds, far_share = tuple(SENSOR_OUTLIERS), {}
    scan, world = scanned(name, 8_000, outlier_share=0.1, outlier_kinds=kinds, **far_share)
    assert scan.surface_names == [part.name for part in world.parts]
    regular = scan.target == 1
    origins, points = scan.sensor_origins[regular], scan.true_points[regular]
    for number, part in enumerate(world.parts):
        mine = scan.surface == number
        assert_allclose(part.distance(scan.true_points[mine]), 0, atol=1e-6)
        assert (scan.classification[mine] == world.class_of[number]).all()
        if not world.through[number]:
            before = part.hit(origins, origins + (1 - 1e-7) * (points - origins))
            assert np.isinf(before).all(), part.name
    soft = np.array([isinstance(part, Soft) for part in world.parts])
    assert np.isnan(scan.normals[regular][soft[scan.surface[regular]]]).all()
    view = np.einsum("ij,ij->i", scan.normals[regular], origins - points)
    assert (view[~np.isnan(view)] >= 0).all()
    found = np.array(scan.outlier_kind_names)[scan.outlier_kind]
    far = np.char.startswith(found, "far")
    near = ~regular & ~far
    counts = [np.sum(found == kind) for kind in kinds]
    assert near.sum() == sum(counts) == 800
    assert np.ptp(counts) <= 1
    assert (world.distance(scan.data[near]) > 3.99 * scan.noise_scale[near]).all()
    if not far_share:
        return
    assert far.sum() == 400
    away = cKDTree(scan.data[regular]).query(scan.data[far])[0]
    # Noise moves the regular points somewhat.
    assert away.min() > 0.095 * np.linalg.norm(np.ptp(scan.data[regular], axis=0))


@pytest.mark.parametrize("name", ["make_mobile_scan", "make_airborne_scan"])
def test_times_and_trajectory_say_where_the_sensor_was(name):
    scan, _ = scanned(name, 5_000)
    cloud = PointCloud(scan.data, {"gps_time": scan.gps_time})
    positions = sensor_origins(cloud, scan.trajectory)
    assert np.abs(positions - scan.sensor_origins).max() < 1e-9


AXIS = np.array([0.0, np.cos(np.radians(8)), -np.sin(np.radians(8))])


def test_depths_are_levels_whose_steps_grow_with_the_square_of_depth():
    step = 0.01  # not the default
    scan = simulators.make_depth_frame(20_000, step=step, random_state=0)
    depth = (scan.data - scan.sensor_origins) @ AXIS
    level = 1 / (step * depth)
    assert_allclose(level, np.round(level), atol=1e-9)
    levels = np.unique(np.round(depth, 9))
    middle = (levels[:-1] + levels[1:]) / 2
    near = np.diff(levels) < 1.5 * step * middle**2
    assert near.sum() > 20
    assert_allclose(np.diff(levels)[near] / middle[near] ** 2, step, rtol=2e-2)


def test_the_furniture_has_the_ten_flat_and_eleven_round_surfaces_of_the_paper():
    cloud = simulators.make_traffic_furniture(20_000, random_state=0)
    counts = np.bincount(cloud.surface, minlength=21)
    assert counts.min() >= 20
    round_parts = [p.name for p in _traffic_furniture().parts if isinstance(p, Cylinder)]
    assert len(set(round_parts) - {"road"}) == 11
    assert len(cloud.surface_names) == 21


def test_the_bus_stop_has_the_31_surfaces_of_the_paper_each_of_40_points():
    cloud = simulators.make_bus_stop(random_state=0)
    counts = np.bincount(cloud.surface)
    assert (counts > 0).sum() == 31
    assert counts[counts > 0].min() >= 40


@pytest.mark.parametrize("scene_of", [_traffic_furniture, _bus_stop])
def test_wherever_two_surfaces_meet_both_have_an_edge(scene_of):
    parts = [p for p in scene_of().parts if not isinstance(p, Foliage)]
    rng, met = np.random.default_rng(0), 0
    for part in parts:
        points = part.sample(2_000, rng)
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
