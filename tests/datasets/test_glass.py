"""A street with a pane of glass: the room behind it, and the law of reflection by hand."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sklearn_mcmd.datasets import make_street
from sklearn_mcmd.datasets._glass import SHOP_WINDOW, Pane
from sklearn_mcmd.datasets._street import _street

PANE_Y = 4.6


@pytest.fixture(scope="module", params=["uniform", "scan_lines"])
def street(request):
    return make_street(
        15_000, glass=True, tree=True, sampling=request.param, noise=0.001, outlier_share=0.1,
        outlier_kinds=["reflection", "ghost"], random_state=0,
    )  # fmt: skip


def reflections(street):
    return street.data[street.outlier_kind == street.outlier_kind_names.index("reflection")]


def test_the_room_is_seen_through_the_pane_and_some_beams_end_at_it(street):
    of = {name: street.surface == number for number, name in enumerate(street.surface_names)}
    for name in ("room_back", "room_floor", "room_table", "window_pane"):
        assert of[name].sum() > 10, name
    assert_allclose(street.true_points[of["window_pane"], 1], PANE_Y, atol=1e-9)
    inside = np.any([of[name] for name in of if name.startswith("room")], axis=0)
    sensor, points = street.scanners[0], street.true_points[inside]
    share = (PANE_Y - sensor[1]) / (points[:, 1] - sensor[1])
    x, _, z = (sensor + share[:, None] * (points - sensor)).T
    x0, x1, z0, z1 = SHOP_WINDOW
    assert ((x >= x0) & (x <= x1) & (z >= z0) & (z <= z1)).all()


def test_reflections_are_the_mirror_images_of_what_stands_before_the_pane(street):
    points = reflections(street)
    assert len(points) == 750
    assert (points[:, 1] > PANE_Y).all()
    images = points * [1, -1, 1] + [0, 2 * PANE_Y, 0]
    scene = _street(street.length, 1, tree=True, glass=True)
    assert_allclose(scene.bay_distance(images), 0, atol=0.006)
    assert (images[:, 1] < PANE_Y).all()


def test_beams_obey_the_law_of_reflection(street):
    """The way over the pane to what the beam met is as long as the range that is written."""
    sensor, points = street.scanners[0], reflections(street)
    ways = points - sensor
    places = sensor + ((PANE_Y - sensor[1]) / ways[:, 1])[:, None] * ways
    met = points * [1, -1, 1] + [0, 2 * PANE_Y, 0]
    onward = met - places
    cosines = np.abs(ways[:, 1]) / np.linalg.norm(ways, axis=1)
    assert_allclose(np.abs(onward[:, 1]) / np.linalg.norm(onward, axis=1), cosines, atol=1e-9)
    lengths = np.linalg.norm(places - sensor, axis=1) + np.linalg.norm(onward, axis=1)
    assert_allclose(lengths, np.linalg.norm(ways, axis=1), atol=1e-9)


def test_each_bay_mirrors_for_its_own_scanner():
    street = make_street(
        23_000, glass=True, spacing=0.06, outlier_share=0.05, outlier_kinds=["reflection"],
        random_state=0,
    )  # fmt: skip
    bays = len(street.scanners)
    assert bays > 1
    bay = np.floor(reflections(street)[:, 0] * bays / street.length).astype(int)
    assert (np.bincount(np.clip(bay, 0, bays - 1), minlength=bays) > 0).all()


def test_without_glass_there_are_no_reflections():
    with pytest.raises(ValueError, match="must name, once each"):
        make_street(1000, outlier_kinds=["reflection"])
    assert "reflection" not in make_street(1000, random_state=0).outlier_kind_names


def test_a_pane_stops_its_share_of_beams():
    pane = Pane("pane", (0, 1, 0), (1, 0, 0), (0, 0, 1))
    ends = np.random.default_rng(0).uniform([0, 2, 0], [1, 2, 1], (20_000, 3))
    origin = np.array([0.5, 0, 0.5])
    stopped = np.isfinite(pane.scatter(origin, ends, np.random.default_rng(1)))
    assert_allclose(stopped.mean(), Pane.dust, atol=0.01)
    assert np.isinf(pane.hit(origin, ends)).all()
    assert_allclose(pane.mirror(np.array([[0.2, 3, 0.4]])), [[0.2, -1, 0.4]])
