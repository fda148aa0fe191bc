"""Flat surfaces of two scans: which moved against the others, and how far."""

import numpy as np
import pytest

from benchmarks._halls import hall, registered, walls_of
from sklearn_mcmd import CloudChange
from sklearn_mcmd.change import moved_bodies


def test_two_of_nine_walls_that_moved_are_named_whatever_the_registration():
    named, false = [], []
    for seed in range(4):
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


def test_clouds_without_flat_surfaces_are_refused():
    ball = np.random.default_rng(0).normal(size=(2, 300, 3))
    ball /= np.linalg.norm(ball, axis=2, keepdims=True)
    with pytest.raises(ValueError, match=r"have 0 flat surfaces .* three"):
        moved_bodies(*ball, random_state=0)
