"""Removed points that lie together are told, and single errors and small groups are not."""

import numpy as np
import pytest

from scenes import ball
from sklearn_mcmd import MCMDOutlierDetector
from sklearn_mcmd.report._volumes import lost_volumes, words_of

RNG = np.random.default_rng(0)
WALL = RNG.uniform([0, 0, 0], [6, 0.01, 3], (20_000, 3))
ERRORS = RNG.uniform([-0.3, -3, -0.3], [6.3, 0.3, 3.3], (1_000, 3))
GROUPS = np.repeat(RNG.uniform([0, -3, 0], [6, -0.5, 3], (12, 3)), 40, axis=0)
GROUPS += RNG.normal(0, 0.03, GROUPS.shape)


def lost_ball(n=1_500, radius=0.5):
    return ball(n, [3, -1.5, 1.5], radius, RNG)


def volumes(kept, removed, n_parts=1):
    """Of points in any order, in parts."""
    xyz = np.vstack([kept, removed])
    order = np.random.default_rng(n_parts).permutation(len(xyz))
    parts = [(xyz[rows], rows >= len(kept)) for rows in np.array_split(order, n_parts)]
    return lost_volumes(lambda: iter(parts), len(xyz))


def test_errors_and_small_groups_are_single_however_many_there_are():
    assert volumes(WALL, np.vstack([ERRORS, GROUPS])) == []


def test_copies_of_one_point_have_no_volume():
    copies = np.tile([1.0, 2.0, 3.0], (1_000, 1))
    assert volumes(copies, copies) == []


def test_a_lost_ball_before_a_wall_is_told_with_its_place():
    (volume,) = volumes(WALL, lost_ball())
    assert volume.n_lost == volume.n_all >= 1_450
    assert np.abs(volume.low - [2.5, -2, 1]).max() < 0.3
    assert np.abs(volume.high - [3.5, -1, 2]).max() < 0.3
    assert f"{volume.n_lost:,} outliers lie together, of" in words_of([volume])


def test_a_lost_ball_among_errors_is_told_in_any_order_and_parts():
    removed = np.vstack([ERRORS, GROUPS, lost_ball()])
    (volume,), (same,) = (volumes(WALL, removed, n_parts) for n_parts in (1, 5))
    assert 1_400 < volume.n_lost < 1_700
    np.testing.assert_equal(tuple(volume), tuple(same))


def test_a_crown_of_which_most_but_not_all_is_lost_is_told():
    crown = lost_ball(3_000, 1.0)
    (volume,) = volumes(np.vstack([WALL, crown[:1_000]]), np.vstack([crown[1_000:], ERRORS[:200]]))
    assert volume.n_lost > 1_000
    assert volumes(np.vstack([WALL, crown[200:]]), np.vstack([crown[:200], ERRORS])) == []


def test_what_is_all_at_one_place_or_far_away_breaks_nothing():
    assert volumes(np.zeros((5, 3)), np.zeros((600, 3))) == []
    far = np.vstack([WALL, [[1e9, 1e9, 1e9]]])
    assert len(volumes(far, lost_ball())) == 1


def test_a_thing_of_a_tenth_of_few_points_is_told_and_scattered_errors_are_not():
    (volume,) = volumes(WALL[:180], lost_ball(20, 0.2))
    assert volume.n_lost == volume.n_all >= 18
    assert volumes(WALL[:180], ERRORS[:20]) == []
    assert volumes(WALL[:180], lost_ball(12, 0.2)) == []


def test_small_tiles_of_real_surveys_are_told_where_a_tenth_together_is_lost(shared_data):
    detector, told, lost = MCMDOutlierDetector(random_state=0), [], []
    for name in ("ahn3_amsterdam_2397", "ign_village"):
        with np.load(shared_data / name / "cloud.npz") as arrays:
            xyz = arrays["xyz"]
        for center in xyz[np.random.default_rng(0).integers(0, len(xyz), 10)]:
            tile = xyz[np.argsort(np.linalg.norm((xyz - center)[:, :2], axis=1))[:400]]
            removed = detector.fit_predict(tile) < 0
            told.append(len(lost_volumes(lambda: [(tile, removed)], 400)))  # noqa: B023
            lost.append(removed.mean())
    told, lost = np.array(told) > 0, np.array(lost)
    assert told[lost > 0.12].all()
    assert np.count_nonzero(told) >= 3
    assert not told[lost < 0.08].any()


@pytest.mark.slow
def test_simulated_errors_in_real_clouds_are_single(shared_data, load):
    clouds = load("_real_clouds")
    for cloud in clouds.load_clouds(shared_data, limit=60_000):
        real = np.ones(len(cloud.points), bool) if cloud.noise is None else ~cloud.noise
        xyz, _ = clouds.inject(cloud.points[real], np.random.default_rng(0))
        is_outlier = MCMDOutlierDetector(random_state=0, n_jobs=2).fit_predict(xyz) < 0
        volumes = lost_volumes(lambda: [(xyz, is_outlier)], len(xyz))  # noqa: B023
        # In the turn of heavy snow hundreds of real points next to the sensor are lost.
        assert bool(volumes) == ("half_turn" in cloud.name), cloud.name
