"""benchmarks/simulators: what tests and figures take as their truth, and its seeds."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from benchmarks import simulators
from benchmarks.simulators._scans import YARD
from sklearn_mcmd import datasets
from sklearn_mcmd.datasets._surfaces import Foliage

LINES = {"sampling": "scan_lines", "tree": True}
FIFTH = {"outlier_share": 0.2}
SUMMED = ("data", "normals", "noise_scale", "outlier_kind", "surface", "edge_distance")
SEEDS = [  # and sums of these, in which rows weigh from 1 to 2
    ("make_street", {}, (37499.993046, 5498.326097, 29.9975, 1521.2185, 13828.8275, 4560.9097509)),
    (
        "make_street",
        LINES,
        (34038.893838, 5209.8262094, 29.9975, 1521.2185, 16001.03375, 5129.9962104),
    ),
    (
        "make_traffic_furniture",
        FIFTH,
        (52320.318932, 5017.9445144, 29.9975, 3003.517, 14828.7725, 4923.3090735),
    ),
    (
        "make_bus_stop",
        FIFTH,
        (52068.627634, 4862.7222317, 29.9975, 3003.517, 27187.28225, 3917.8009173),
    ),
]


@pytest.mark.parametrize(("name", "parameters", "sums"), SEEDS)
def test_a_seed_keeps_its_cloud(name, parameters, sums):
    """Golden results and published figures rest on these."""
    make = getattr(datasets, name, None) or getattr(simulators, name)
    scan = make(4000, random_state=0, **parameters)
    weights = 1 + np.arange(4000) / 4000
    found = [np.nansum(np.abs(scan[array]).T * weights) for array in SUMMED]
    assert_allclose(found, sums, rtol=1e-9)


def test_a_turn_has_points_where_beams_first_meet_the_yard_and_outliers_before():
    scan = simulators.make_lidar_turn(8_000, outlier_share=0.1, random_state=0)
    up = np.array([0, 0, 1.5])  # from the yard's ground to the sensor
    regular = scan.target == 1
    assert np.mean(~regular) == pytest.approx(0.1, abs=0.015)
    points = scan.true_points[regular]  # the sensor is the origin
    distances = [part.distance(points + up) for part in YARD]
    assert np.min(distances, axis=0).max() < 1e-6
    solid = [part for part in YARD if not isinstance(part, Foliage)]
    echoes = np.where(regular[:, None], scan.true_points, scan.data)
    ends = up + (1 - 1e-7) * echoes[echoes.any(axis=1)]
    assert all(np.isinf(part.hit(np.tile(up, (len(ends), 1)), ends)).all() for part in solid)
    elevations = np.degrees(np.arcsin(points[:, 2] / np.linalg.norm(points, axis=1)))
    rings = (elevations + 30.67) / (10.67 + 30.67) * 31
    assert_allclose(rings, np.round(rings), atol=1e-9)
    silent = ~scan.data.any(axis=1)
    assert 100 < silent.sum() < 350
    assert not silent[regular].any()


def test_depths_are_levels_whose_steps_grow_with_the_square_of_depth():
    step, down = 0.01, np.radians(8)  # not the default
    scan = simulators.make_depth_frame(20_000, step=step, random_state=0)
    depth = (scan.data - scan.sensor_origins) @ [0.0, np.cos(down), -np.sin(down)]
    level = 1 / (step * depth)
    assert_allclose(level, np.round(level), atol=1e-9)
    assert len(np.unique(np.round(level))) > 20
