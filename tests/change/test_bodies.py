"""Flat surfaces of two scans: which moved against the others, and how far."""

import numpy as np
import pytest

from benchmarks._halls import hall, registered, walls_of
from sklearn_mcmd import CloudChange
from sklearn_mcmd.change import moved_bodies


def test_two_of_nine_walls_that_moved_are_named_whatever_the_registration():
    named, false = [], []
    for seed in range(2):
        rng = np.random.default_rng(seed)
        moved = [rng.choice([0, 1]), rng.choice([3, 4, 6, 7])]
        before, walls = hall(rng)
        after, motion = registered(hall(rng, moved)[0], rng)
        bodies = moved_bodies(before, after, random_state=0)
        is_moved = np.isin(walls_of(bodies, before, walls), moved)
        assert len(is_moved) == 9
        named += list(bodies.moved[is_moved])
        false += list(bodies.moved[~is_moved])
        off = np.abs(bodies.motion - motion) / np.sqrt(np.diag(bodies.motion_covariance))
        assert off.max() < 5
    assert np.mean(named) >= 0.95
    assert np.mean(false) <= 0.05


def test_where_nothing_moved_none_is_named_and_offsets_are_within_errors():
    rng = np.random.default_rng(9)
    bodies = moved_bodies(hall(rng)[0], hall(rng)[0], random_state=0)
    assert not bodies.moved.any()
    assert (np.abs(bodies.offset) < 4 * bodies.offset_error).all()
    assert (bodies.tilt < 4 * bodies.tilt_error).all()


def test_the_registration_of_stable_walls_is_in_the_errors_of_distances():
    rng = np.random.default_rng(1)
    before, walls = hall(rng)
    after = hall(rng, [3], by=0.03)[0] + [0.004, 0.004, 0.004]
    exact = CloudChange(random_state=0).fit(before).compare(after)
    changes = CloudChange(registration="auto", random_state=0).fit(before).compare(after)
    stayed = (walls != 3) & (changes.reason == 0)
    assert exact.bodies is None
    assert exact.significant[stayed].mean() > 0.8
    assert changes.significant[stayed].mean() < 0.05
    assert changes.significant[(walls == 3) & (changes.reason == 0)].mean() > 0.9
    assert list(walls_of(changes.bodies, before, walls)[changes.bodies.moved]) == [3]


def test_offsets_have_the_sign_of_distances():
    """Walls lean by .3 degrees, by which their normals point down."""
    rng = np.random.default_rng(0)
    lean = np.array([[1, 0, 0], [0, 1, 0], [0.005, 0.005, 1]])
    before, walls = hall(rng)
    before, after = before @ lean, hall(rng, [1, 4, 7], by=0.02)[0] @ lean
    bodies = moved_bodies(before, after, random_state=0)
    changes = CloudChange(random_state=0).fit(before).compare(after)
    for k, wall in enumerate(walls_of(bodies, before, walls)):
        told = np.nanmedian(changes.distance[walls == wall])
        assert bodies.offset[k] == pytest.approx(told, abs=1e-3)


def test_clouds_without_flat_surfaces_are_refused():
    ball = np.random.default_rng(0).normal(size=(2, 300, 3))
    ball /= np.linalg.norm(ball, axis=2, keepdims=True)
    with pytest.raises(ValueError, match=r"have 0 flat surfaces .* three"):
        moved_bodies(*ball, random_state=0)


def test_what_no_surface_tells_is_no_motion_and_surfaces_alone_in_their_direction_are_not_tested():
    """Terraces tell how they are raised and tilted, and neither shift along them nor turn."""

    def terraces(rng, up, n=600):
        steps = [rng.uniform(0, 1, (n, 3)) * [4, 4, 0] + [4.5 * k, 0, k] for k in range(4)]
        return (
            np.vstack(steps) + rng.normal(0, 0.003, (4 * n, 3)) * [0, 0, 1] + np.array([0, 0, up])
        )

    rng = np.random.default_rng(2)
    bodies = moved_bodies(terraces(rng, 0), terraces(rng, 0.002), random_state=0)
    assert len(bodies.moved) == 4
    assert not bodies.moved.any()
    assert bodies.motion[2] == pytest.approx(0.002, abs=5e-4)
    assert np.abs(bodies.motion[[0, 1, 3, 4, 5]]).max() < 5e-4
    faces = [rng.uniform(0.02, 1, (2, 500, 3)) * (np.arange(3) != k) for k in range(3)]
    corners = np.concatenate(faces, axis=1) + rng.normal(0, 0.002, (2, 1_500, 3))
    assert np.isnan(moved_bodies(*corners, random_state=0).pvalue).all()


@pytest.mark.parametrize("digits", [9, 2])  # a file's centimeters are then all its noise
def test_exact_faces_stay(digits):
    def box(rng):
        faces = [rng.uniform(0.02, 0.98, (300, 3)) * [5, 4, 3] for _ in range(6)]
        for k, face in enumerate(faces):
            face[:, k % 3] = [0, 0, 0, 5, 4, 3][k]
        return np.round(np.vstack(faces), digits)

    rng = np.random.default_rng(3)
    bodies = moved_bodies(box(rng), box(rng), random_state=0)
    assert not bodies.moved.any()
    assert np.isfinite(bodies.pvalue).all()
    assert np.abs(bodies.motion).max() < 1e-9


@pytest.mark.parametrize("columns", [(2, 2), (3, 2)])
def test_bodies_are_of_space(columns):
    clouds = (np.zeros((40, d)) for d in columns)
    with pytest.raises(ValueError, match="two clouds of 3 columns"):
        moved_bodies(*clouds)
