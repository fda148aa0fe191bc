"""The flight that scan angles tell, and angles that tell none."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from flights import flight, of
from sklearn_mcmd.io import PointCloud, read_points
from sklearn_mcmd.io._flight_lines import positions_of_lines


@pytest.mark.parametrize(("step", "most"), [(1.0, 0.5), (0.006, 0.01)])
@pytest.mark.parametrize("heading", [0.7, -2.0])
def test_the_flight_is_found_from_rounded_angles(step, most, heading):
    xyz, sensor, given = flight(heading=heading, step=step, start=2e8)
    found, words = positions_of_lines(of(xyz, given))
    assert words == "scan angles of one flight line"
    off = np.linalg.norm(found - sensor, axis=1)
    # Half a degree of 800 m, which a mean of thousands of points makes much smaller.
    assert off.max() < np.radians(most) * 800


def test_each_flight_line_has_its_own_flight():
    lines = [flight(heading=0.1, seed=1), flight(heading=3.2, height=600, seed=2)]
    clouds = [of(xyz, given, line) for line, (xyz, _, given) in enumerate(lines)]
    both = PointCloud(
        np.vstack([cloud.xyz for cloud in clouds]),
        {
            name: np.concatenate([cloud.attributes[name] for cloud in clouds])
            for name in clouds[0].attributes
        },
    )
    found, words = positions_of_lines(both)
    assert words == "scan angles of 2 lines"
    for part, (_, sensor, _) in zip(np.split(found, 2), lines, strict=True):
        assert_allclose(part, sensor, atol=7)


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"scan_angle_rank": np.zeros(4_000)}, "all equal"),
        ({"gps_time": np.zeros(4_000)}, "all equal"),
        ({"scan_angle_rank": np.random.default_rng(0).integers(-20, 20, 4_000)}, "differ from"),
        ({"scan_angle_rank": None}, "no scan angles"),
        (slice(60), "fewer than 100 points"),
    ],
)
def test_angles_that_tell_no_flight_are_refused_with_the_reason(change, why):
    xyz, _, given = flight()
    if isinstance(change, dict):
        given = {name: values for name, values in (given | change).items() if values is not None}
        change = slice(None)
    found, words = positions_of_lines(of(xyz, given).subset(change))
    assert found is None
    assert why in words


def test_a_real_flight_is_found_where_its_operator_flew(shared_data):
    path = shared_data / "ahn3_amsterdam_2397" / "ahn_2397_9705.laz"
    found, _ = positions_of_lines(read_points(path))
    assert ((found[:, 2] > 600) & (found[:, 2] < 1_000)).all()
