"""Reflections behind panes: found, explained, and not seen where there are none."""

import pickle

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from sklearn_mcmd import MCMDOutlierDetector
from sklearn_mcmd.datasets import make_street
from sklearn_mcmd.outliers import _cloud
from sklearn_mcmd.outliers._reflections import HERE, images_of, large_planes

PANE_Y = 4.6  # of the street


def glazed():
    return make_street(
        20_000, glass=True, tree=True, sampling="scan_lines", outlier_share=0.03,
        outlier_kinds=["reflection"], random_state=0,
    )  # fmt: skip


def detector(**parameters):
    return MCMDOutlierDetector(reflections=True, random_state=0, **parameters)


@pytest.fixture(scope="module")
def street():
    return glazed()


@pytest.fixture(scope="module")
def fitted(street):
    return detector(sensor_origin=street.scanners[0]).fit(street.data)


def test_reflections_in_a_shop_window_are_found_and_the_room_behind_is_kept(street, fitted):
    mirrored = fitted.mirror_index_ >= 0
    names = np.array([*street.surface_names, ""])[street.surface]
    in_room = np.char.startswith(names, "room")
    assert mirrored[street.target == -1].mean() > 0.85
    assert mirrored[in_room].mean() < 0.01
    assert not mirrored[(street.target == 1) & ~in_room].any()
    assert (fitted.predict(street.data)[mirrored] == -1).all()


def test_the_plane_of_the_pane_is_told_and_not_that_of_the_wall_around_it(fitted):
    mirrors = fitted.mirrors_
    assert len(mirrors.offsets) == 1
    assert_allclose(mirrors.normals[0], [0, -1, 0], atol=0.003)  # toward the sensor
    assert_allclose(mirrors.offsets[0], -PANE_Y, atol=0.005)
    assert_array_equal(mirrors.n_points, [(fitted.mirror_index_ == 0).sum()])
    assert (fitted.scores_[fitted.mirror_index_ == 0] <= -mirrors.evidence[0]).all()


def test_a_position_that_is_wrong_by_centimeters_finds_as_much(street, fitted):
    off = detector(sensor_origin=street.scanners[0] + [0.03, -0.03, 0.03]).fit(street.data)
    assert (off.mirror_index_ != fitted.mirror_index_).mean() < 0.001


@pytest.mark.parametrize("share", [0.0, 0.1])
def test_a_clear_pane_is_no_mirror(share):
    street = make_street(
        20_000, glass=True, tree=True, sampling="scan_lines", outlier_share=share, random_state=1
    )
    found = detector(sensor_origin=street.scanners[0]).fit(street.data)
    assert len(found.mirrors_.offsets) == 0
    assert (found.mirror_index_ == -1).all()


# ---- the law of reflection, by hand ----------------------------------------------------------


def bounced(rng, noise=0.002):
    """A hall with a board and a post before a glass wall, traced beam by beam.

    The glass is the plane x = 4, the floor z = 0, the board is slanted. All echoes of the glass
    come from a frame. Returns points and which of them are reflections.
    """
    sensor = np.array([0.0, 0.0, 1.5])
    board = np.array([2.0, 1.2, 1.3]), np.array([0.8, -0.6, 0.0])  # center and normal

    def hit(start, way):
        """Range at which a beam meets floor or board."""
        best = -start[2] / way[2] if way[2] < -1e-9 else np.inf
        center, normal = board
        toward = way @ normal
        if abs(toward) > 1e-9:
            reach = (center - start) @ normal / toward
            away = start + reach * way - center
            if reach > 1e-9 and abs(away[2]) < 0.6 and np.linalg.norm(away[:2]) < 0.7:
                best = min(best, reach)
        return best

    points, mirrored = [], []
    for azimuth in np.linspace(-0.9, 0.9, 150):
        for elevation in np.linspace(-0.75, 0.3, 100):
            way = np.array([
                np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth),
                np.sin(elevation),
            ])  # fmt: skip
            reach, glass = hit(sensor, way), 4 / way[0]
            place = sensor + glass * way
            is_mirrored = False
            if glass < reach:
                if not (abs(place[1]) < 3 and 0.3 < place[2] < 2.6):  # the frame
                    reach = glass if abs(place[1]) < 3.6 and 0 < place[2] < 2.9 else np.inf
                elif rng.random() < 0.5:
                    reach = glass + hit(place, way * [-1, 1, 1])
                    is_mirrored = True
                else:
                    reach = np.inf
            if reach < 9:
                points.append(sensor + (reach + rng.normal(0, noise)) * way)
                mirrored.append(is_mirrored)
    return np.array(points), np.array(mirrored), sensor


def test_beams_traced_by_the_law_of_reflection_are_found():
    X, mirrored, sensor = bounced(np.random.default_rng(0))
    assert mirrored.sum() > 200
    found = detector(sensor_origin=sensor).fit(X)
    assert (found.mirror_index_[mirrored] == 0).mean() > 0.9
    assert (found.mirror_index_[~mirrored] >= 0).mean() < 0.001
    assert_allclose(found.mirrors_.normals, [[-1, 0, 0]], atol=0.003)
    assert_allclose(found.mirrors_.offsets, [-4], atol=0.005)


@pytest.fixture(scope="module")
def asked(street):
    """What `find_mirrors` is asked."""
    kept = []
    find = _cloud.find_mirrors
    _cloud.find_mirrors = lambda *arguments: kept.append(arguments) or find(*arguments)
    try:
        detector(sensor_origin=street.scanners[0]).fit(street.data)
    finally:
        _cloud.find_mirrors = find
    return kept[0]


def test_what_is_behind_a_plane_equals_a_loop_over_the_points(asked):
    seen, least, limits = asked
    n = len(seen.points)
    panes, n_behind = large_planes(seen, least, limits)[:6], 0
    assert panes
    for pane in panes:
        expected = []
        for row, (x, sensor) in enumerate(zip(seen.points, seen.origins, strict=True)):
            deep, high = (x - pane.center) @ pane.normal, (sensor - pane.center) @ pane.normal
            if min(abs(deep), abs(high)) <= 6 * pane.scale or deep * high >= 0:
                continue
            flat = (sensor + high / (high - deep) * (x - sensor) - pane.center) @ pane.axes
            if (flat >= pane.low).all() and (flat <= pane.high).all():
                expected.append(row)
        assert_array_equal(pane.behind(seen, np.ones(n, bool)), expected)
        n_behind += len(expected)
    assert n_behind > 0


def test_images_that_lie_on_real_points_equal_a_loop(asked):
    seen, least, limits = asked
    wall = max(
        large_planes(seen, least, limits),
        key=lambda pane: len(pane.behind(seen, np.ones(len(seen.points), bool))),
    )
    pane = wall.moved((PANE_Y - wall.center[1]) / wall.normal[1])
    rows = pane.behind(seen, np.ones(len(seen.points), bool))[::11]
    found, planes = images_of(pane, HERE, rows, seen, 0.0, limits), seen.planes
    agrees = 0
    for fits, row in zip(found.fits[0], rows, strict=True):
        turn = np.eye(3) - 2 * np.outer(pane.normal, pane.normal)
        image = pane.center + turn @ (seen.points[row] - pane.center)
        away = np.linalg.norm(seen.points - image, axis=1)
        near = int(np.argmin(away))
        side = np.sign((seen.origins[row] - pane.center) @ pane.normal)
        expected = side * ((seen.points[near] - pane.center) @ pane.normal) > 6 * pane.scale
        if seen.on_plane[near]:
            off = abs((image - planes.centroids[near]) @ planes.normals[near])
            expected &= off <= 3 * np.hypot(planes.scale[near], pane.scale)
            expected &= away[near] <= limits.reach * seen.spacing[near]
            if seen.on_plane[row]:
                cosine = abs((turn @ planes.normals[row]) @ planes.normals[near])
                expected &= cosine >= np.cos(np.radians(limits.angle))
        else:
            expected &= away[near] <= seen.spacing[near]
        agrees += fits == expected
    assert agrees == len(rows) > 100


# ---- what changes nothing --------------------------------------------------------------------


@pytest.mark.parametrize("change", ["moved", "turned", "scaled", "shuffled", "each its position"])
def test_the_same_points_are_reflections_however_the_cloud_lies(street, fitted, change):
    X, origin = street.data, street.scanners[0]
    expected, rows = fitted.mirror_index_, np.arange(len(X))
    if change == "moved":
        step = np.array([100, -50, 20])
        X, origin = X + step, origin + step
    elif change == "turned":
        turn = Rotation.from_euler("xyz", [20, 30, 40], degrees=True).as_matrix()
        X, origin = X @ turn.T, turn @ origin
    elif change == "scaled":
        X, origin = 1000 * X, 1000 * origin
    elif change == "shuffled":
        rows = np.random.default_rng(0).permutation(len(X))
        X = X[rows]
    else:
        origin = np.tile(origin, (len(X), 1))
    found = detector().fit(X, sensor_origin=origin).mirror_index_
    assert (found != expected[rows]).mean() < 0.0005


def test_new_points_next_to_reflections_are_judged_as_they_are(street, fitted):
    near = street.data[fitted.mirror_index_ == 0][:50] + 1e-4
    assert (fitted.predict(near) == -1).all()
    read = pickle.loads(pickle.dumps(fitted))
    assert_array_equal(read.predict(near), fitted.predict(near))
    assert_array_equal(read.mirrors_.offsets, fitted.mirrors_.offsets)


def test_they_are_not_sought_unless_asked_for(street):
    plain = MCMDOutlierDetector(sensor_origin=street.scanners[0], random_state=0).fit(street.data)
    assert not hasattr(plain, "mirrors_")
    assert (plain.predict(street.data)[street.target == -1] == -1).mean() < 0.2


def test_they_need_the_position():
    with pytest.raises(ValueError, match="reflections=True needs to know where the sensor stood"):
        detector().fit(np.random.default_rng(0).random((100, 3)))


@pytest.mark.parametrize("d", [2, 3, 4])
def test_small_clouds_of_any_dimension_have_none(d):
    X = np.random.default_rng(0).random((200, d))
    found = detector(outlier_rate=0.1, sensor_origin=np.full(d, 5.0)).fit(X)
    assert found.mirrors_.normals.shape == (0, d)
    assert (found.mirror_index_ == -1).all()


def test_new_points_of_the_room_between_reflections_stay(street, fitted):
    room = np.flatnonzero([name.startswith("room") for name in street.surface_names])
    kept = np.isin(street.surface, room) & (fitted.mirror_index_ < 0)
    rng = np.random.default_rng(0)
    X = street.data[kept]
    new = X + rng.normal(0, 0.002, X.shape)
    before, after = fitted.predict(X) == 1, fitted.predict(new) == 1
    assert after.mean() > before.mean() - 0.02


def test_reflections_do_not_count_as_real_points_of_a_rate(street):
    rated = detector(sensor_origin=street.scanners[0], false_positive_rate=0.01).fit(street.data)
    assert (rated.scores_[rated.mirror_index_ >= 0] < rated.offset_).all()
