"""benchmarks/simulators: the physics on which figures of the pages rest, and their seeds."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial import cKDTree
from scipy.stats import norm

from benchmarks import simulators
from benchmarks.simulators._beams import MIXED, Beams, Sensor, cast
from benchmarks.simulators._furniture import _bus_stop, _traffic_furniture
from benchmarks.simulators._sensor_outliers import SENSOR_OUTLIERS
from benchmarks.simulators._snow import flake_echoes
from benchmarks.simulators._things import World
from scenes import WORLDS, scanned
from sklearn_mcmd import datasets
from sklearn_mcmd.datasets._surfaces import Cylinder, Foliage, Patch, Soft
from sklearn_mcmd.io import PointCloud, sensor_origins

ALL = ["mixed_pixel", "range_error", "ghost", "low", "high", "particle", "no_return"]
ANY = {"outlier_share": 0.1, "far_share": 0.05, "outlier_kinds": ALL}
WINTER = {"snow": 2.0, "beam_divergence": 0.003}
LINES = {"sampling": "scan_lines", "tree": True}
FIFTH = {"outlier_share": 0.2}
SUMMED = ("data", "normals", "noise_scale", "outlier_kind", "surface")
SEEDS = [  # and sums of these, in which rows weigh from 1 to 2
    ("make_street", {}, (37499.993046, 5498.326097, 29.9975, 1521.2185, 13828.8275)),
    ("make_street", LINES, (34038.893838, 5209.8262094, 29.9975, 1521.2185, 16001.03375)),
    ("make_lidar_turn", {}, (73449.928972, 5899.9419928, 75.762641794, 573.68, 312295.5475)),
    (
        "make_lidar_turn",
        WINTER,
        (65874.810313, 5642.2166557, 74.101491219, 2098.98075, 294063.8405),
    ),
    ("make_mobile_scan", ANY, (108815.92839, 3232.0955354, 38.100741231, 4902.3205, 682487.99425)),
    (
        "make_airborne_scan",
        {"far_share": 0.05},
        (421603.26116, 5250.3664568, 83.993, 3076.215, 254302.35725),
    ),
    ("make_depth_frame", {}, (33159.768071, 5815.7284882, 126.11000195, 176.51525, 155088.13125)),
    (
        "make_traffic_furniture",
        FIFTH,
        (52320.318932, 5017.9445144, 29.9975, 3003.517, 14828.7725),
    ),
    ("make_bus_stop", FIFTH, (52068.627634, 4862.7222317, 29.9975, 3003.517, 27187.28225)),
]


@pytest.mark.parametrize(("name", "parameters", "sums"), SEEDS)
def test_a_seed_keeps_its_cloud(name, parameters, sums):
    """Golden results, ablations and published figures rest on these."""
    make = getattr(datasets, name, None) or getattr(simulators, name)
    scan = make(4000, random_state=0, **parameters)
    weights = 1 + np.arange(4000) / 4000
    found = [np.nansum(np.abs(scan[array]).T * weights) for array in SUMMED]
    assert_allclose(found, sums, rtol=1e-9)


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


def test_ranges_at_an_outline_follow_the_energy_on_either_side():
    """A plate before a wall, seen by beams of all offsets from its upright side."""
    width = 0.008
    plate = Patch("plate", (-3, 4, -1), (3, 0, 0), (0, 0, 2))
    wall = Patch("wall", (-3, 6, -1.5), (6, 0, 0), (0, 0, 3))
    world = World({"street": [plate, wall]})
    sensor = Sensor(lambda r: np.full(len(r), 0.005), 9.0, divergence=width, resolution=np.inf)
    sideways = np.linspace(-width, width, 500)
    ways = np.column_stack([sideways, np.ones(500), np.zeros(500)])
    echoes = cast(world, sensor, Beams(np.zeros((500, 3)), ways), np.random.default_rng(0))
    share = norm.cdf(-sideways / (width / 4))  # of the energy, on the plate
    ranges = (share / 4 + (1 - share) / 6) / (share / 16 + (1 - share) / 36)
    error = np.abs(echoes.ranges - ranges)
    assert error.max() < 0.25  # a step of one in 19 rays is up to 0.17 m
    assert error.mean() < 0.06
    mixed = (echoes.ranges > 4.02) & (echoes.ranges < 5.98)
    np.testing.assert_array_equal(echoes.kind == MIXED, mixed)
    assert_allclose(echoes.place[~mixed, 1], np.where(echoes.ranges[~mixed] < 5, 4.0, 6.0))


@pytest.mark.parametrize("name", ["make_mobile_scan", "make_airborne_scan"])
def test_times_and_trajectory_say_where_the_sensor_was(name):
    scan, _ = scanned(name, 5_000)
    cloud = PointCloud(scan.data, {"gps_time": scan.gps_time})
    positions = sensor_origins(cloud, scan.trajectory)
    assert np.abs(positions - scan.sensor_origins).max() < 1e-9


def test_rays_of_a_turn_leave_in_rings_of_equal_elevation():
    scan, _ = scanned("make_lidar_turn")
    regular = scan.target == 1
    ray = (scan.true_points - scan.sensor_origins)[regular]
    elevation = np.degrees(np.arcsin(ray[:, 2] / np.linalg.norm(ray, axis=1)))
    assert_allclose(elevation, np.linspace(-30.67, 10.67, 32)[scan.ring[regular]], atol=1e-9)


def test_snow_is_like_that_of_turns_that_others_simulated(shared_data):
    with np.load(shared_data / "snow_spinning_lidar" / "turn_000048.npz") as arrays:
        ranges, snow = np.linalg.norm(arrays["xyz"].astype(float), axis=1), arrays["snow"]
    beam, mine = flake_echoes(ranges[~snow], 2.0, 100.0, 0.0, np.random.default_rng(0))
    assert len(beam) / np.sum(~snow) == pytest.approx(snow.mean(), abs=0.005)
    shares = (0.05, 0.25, 0.5, 0.75, 0.95)
    ratio = np.quantile(mine, shares) / np.quantile(ranges[snow], shares)
    assert 0.75 < ratio.min() < ratio.max() < 1.25


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


@pytest.mark.parametrize(
    ("name", "n_surfaces", "n_round", "least"),
    [("make_traffic_furniture", 21, 11, 20), ("make_bus_stop", 31, 10, 40)],
)
def test_roadside_scenes_have_the_surfaces_of_the_papers(name, n_surfaces, n_round, least):
    cloud = getattr(simulators, name)(random_state=0)
    names, counts = np.unique(cloud.surface[cloud.surface >= 0], return_counts=True)
    assert (len(names), counts.min() >= least) == (n_surfaces, True)
    parts = {"make_bus_stop": _bus_stop, "make_traffic_furniture": _traffic_furniture}[name]().parts
    round_parts = [part.name for part in parts if isinstance(part, Cylinder)]
    assert len(set(round_parts) - {"road"}) == n_round


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
