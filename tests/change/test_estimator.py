"""Distances between two clouds against simulated truth, and against another way to find them."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.stats import norm

from sklearn_mcmd import CloudChange
from sklearn_mcmd.change._comparison import REASONS, Scale

NOISE = 0.003


def wall(rng, n=4_000, common=None, moved=None, size=(8.0, 5.0)):
    """A bowed wall along x: its points."""
    x, z = (rng.uniform(0, length, n) for length in size)
    y = 0.02 * np.sin(x) + rng.normal(0, NOISE, n)
    y += 0.0 if common is None else common(rng, x, z)
    y += 0.0 if moved is None else moved(x, z)
    return np.column_stack([x, y, z])


def waves(rng, x, z, length=0.3):
    """Smooth noise of 1 mm."""
    turns, phases = rng.normal(size=(2, 300)) / length, rng.uniform(0, 2 * np.pi, 300)
    return (
        0.001
        * np.sqrt(2 / 300)
        * np.cos(np.outer(x, turns[0]) + np.outer(z, turns[1]) + phases).sum(axis=1)
    )


def rows(rng, x, z):
    """Noise of 1 mm that is alike in each row of a scanner, 6 cm high."""
    return rng.normal(0, 0.001, 90)[(z / 0.06).astype(int)]


def compared(before, after, **parameters):
    return CloudChange(random_state=0, **parameters).fit(before).compare(after)


@pytest.mark.parametrize("common", [None, waves, rows])
def test_as_many_points_as_alpha_says_are_called_moved_where_nothing_moved(common):
    """Of noise that is alike nearby M3C2's level of detection calls a quarter of them moved."""
    shares = []
    for seed in range(2):
        rng = np.random.default_rng(seed)
        changes = compared(wall(rng, common=common), wall(rng, common=common), correction="none")
        shares.append(changes.significant[changes.reason == 0].mean())
    assert 0.02 < np.mean(shares) < 0.08


def test_distances_and_errors_are_those_of_a_movement():
    """At twice the level of detection 97.5 % are found, at once the half: by the normal law."""
    rng = np.random.default_rng(0)
    before = wall(rng, 6_000)
    level = np.nanmedian(compared(before, wall(rng, 6_000)).level_of_detection)
    for times, share in ((1, 0.5), (2, 0.975)):
        after = wall(rng, 6_000, moved=lambda x, z, d=times * level: np.where(x > 4, d, 0.0))
        changes = compared(before, after, correction="none")
        moved, stayed = before[:, 0] > 4.5, before[:, 0] < 3.5
        assert np.nanmedian(changes.distance[moved]) == pytest.approx(times * level, rel=0.15)
        assert abs(np.mean(changes.significant[moved]) - share) < 0.12
        ratio = np.nanstd(changes.distance[stayed] / changes.distance_error[stayed])
        assert 0.85 < ratio < 1.15


def test_fdr_keeps_its_share_of_false_discoveries_and_sidak_has_none():
    rng = np.random.default_rng(1)
    before = wall(rng)
    after = wall(rng, moved=lambda x, z: np.where(x > 5, 0.004, 0.0))
    stayed = before[:, 0] < 4.5
    changes = compared(before, after)
    assert np.mean(stayed[changes.significant]) < 0.06
    assert np.mean(changes.significant[before[:, 0] > 5.5]) > 0.95
    assert not compared(before, wall(rng), correction="sidak").significant.any()


def test_the_pvalues_are_those_of_two_sided_tests():
    rng = np.random.default_rng(2)
    changes = compared(wall(rng), wall(rng), correction="none", alpha=0.1)
    expected = 2 * norm.sf(np.abs(changes.distance) / changes.distance_error)
    assert_allclose(changes.pvalue, expected, rtol=1e-9)
    assert_allclose(changes.level_of_detection, norm.isf(0.05) * changes.distance_error)
    assert_array_equal(changes.significant, np.abs(changes.distance) > changes.level_of_detection)


def test_a_registration_that_is_off_is_in_the_errors():
    rng = np.random.default_rng(3)
    before, shares = wall(rng, 1_500), []
    change = CloudChange(registration=0.003, correction="none", random_state=0).fit(before)
    for shift in norm.ppf(np.arange(0.025, 1, 0.05), scale=0.003):
        after = wall(rng, 1_500, moved=lambda x, z, d=shift: d)
        shares.append(change.compare(after).significant.mean())
    assert 0.02 < np.mean(shares) < 0.09


def test_a_covariance_of_the_registration_is_its_standard_error_and_turns_about_the_mean():
    rng = np.random.default_rng(4)
    before, after = wall(rng), wall(rng)
    exact = compared(before, after)
    one = compared(before, after, registration=0.002)
    shifts = compared(before, after, registration=np.diag([0.002**2] * 3 + [0.0] * 3))
    assert_allclose(shifts.distance_error, one.distance_error, rtol=1e-9)
    turned = compared(before, after, registration=np.diag([0.0] * 5 + [1e-6]))
    added = turned.distance_error**2 - exact.distance_error**2
    arms = 0.001 * np.abs(before[:, 0] - before[:, 0].mean())  # about z, along y
    told = exact.reason == 0
    assert_allclose(np.sqrt(added)[told], arms[told], atol=2e-4)


def scene(rng, car=False, leaves=True):
    """A road, a kerb and a wall; a tree's leaves, and a car that may be there."""
    road = rng.uniform(0, 1, (5_000, 3)) * [10, 4, 0]
    walk = rng.uniform(0, 1, (2_500, 3)) * [10, 2, 0] + [0, 4, 0.15]
    front = rng.uniform(0, 1, (5_000, 3)) * [10, 0, 4] + [0, 6, 0.15]
    parts = [road, walk, front]
    if leaves:
        parts.append(np.array([3, 5, 3]) + rng.uniform(-1, 1, (1_500, 3)))
    if car:
        inside = (np.abs(road[:, 0] - 7) < 2) & (np.abs(road[:, 1] - 2) < 0.9)
        parts[0] = road[~inside]
        parts.append(rng.uniform(0, 1, (1_000, 3)) * [4, 1.8, 0] + [5, 1.1, 1.5])
    sizes = list(map(len, parts))
    xyz = np.vstack(parts)
    return xyz + rng.normal(0, NOISE, xyz.shape), np.repeat(np.arange(len(parts)), sizes)


def test_next_to_edges_no_more_is_called_moved_than_elsewhere():
    """M3C2's cylinders across a kerb hold both of its sides."""
    rng = np.random.default_rng(5)
    (before, part), (after, _) = scene(rng), scene(rng)
    changes = compared(before, after, correction="none")
    near = (part < 2) & (np.abs(before[:, 1] - 4) < 0.4)
    assert np.mean(changes.reason[near] == 0) > 0.9
    assert np.mean(changes.significant[near & (changes.reason == 0)]) < 0.1


def test_leaves_are_no_surface_and_a_car_is_a_change():
    rng = np.random.default_rng(6)
    (before, part), (after, _) = scene(rng), scene(rng, car=True)
    changes = compared(before, after)
    assert np.mean(changes.reason[part == 3] == REASONS.index("no surface")) > 0.7
    assert np.isnan(changes.distance[changes.reason > 0]).all()
    below = (part == 0) & (np.abs(before[:, 0] - 7) < 1.5) & (np.abs(before[:, 1] - 2) < 0.5)
    told = changes.reason[below] == 0
    assert_allclose(changes.distance[below][told], 1.5, atol=0.05)
    assert changes.significant[below][told].all()
    away = (part < 3) & (np.abs(before[:, 0] - 7) > 3)
    assert changes.significant[away].mean() < 0.03


def test_core_points_are_where_the_clouds_are_compared():
    rng = np.random.default_rng(7)
    before, after = wall(rng), wall(rng)
    fitted = CloudChange(random_state=0).fit(before)
    some = fitted.compare(after, before[::50])
    assert_array_equal(some.distance, fitted.compare(after).distance[::50])
    far = fitted.compare(after, [[0.0, 100.0, 0.0], *before[:3]])
    assert far.reason[0] == REASONS.index("nothing within reach")


def test_results_depend_neither_on_rows_nor_on_threads():
    rng = np.random.default_rng(8)
    before, after = wall(rng, 3_000), wall(rng, 3_000)
    expected = compared(before, after)
    order, other = rng.permutation(3_000), rng.permutation(3_000)
    found = compared(before[order], after[other], n_jobs=2)
    for name in ("distance", "distance_error", "pvalue", "reason"):
        assert_allclose(getattr(found, name), getattr(expected, name)[order], rtol=1e-6, atol=1e-12)


def test_the_other_way_round_distances_have_the_other_sign():
    rng = np.random.default_rng(9)
    before, after = wall(rng), wall(rng, moved=lambda x, z: 0.02 + 0 * x)
    assert np.nanmedian(compared(before, after).distance) == pytest.approx(0.02, abs=5e-4)
    assert np.nanmedian(compared(after, before).distance) == pytest.approx(-0.02, abs=5e-4)


def test_walls_have_one_side_whatever_noise_says():
    rng = np.random.default_rng(10)
    for lean in (0.0, 0.015, 0.03):
        leaning = wall(rng)
        leaning[:, 1] += lean * leaning[:, 2]
        assert (CloudChange(random_state=0).fit(leaning).normals_[:, 1] > 0).all()


@pytest.mark.parametrize("n", [2_000, 16_000])
def test_a_pipe_that_did_not_move_has_not_moved_whatever_the_density(n):
    """Planes of wider neighborhoods lie deeper: with 50 neighbors in both .51 are moved."""

    def pipe(rng, n):
        turn, r = rng.uniform(0, 2 * np.pi, n), 1 + rng.normal(0, 0.002, n)
        return np.column_stack([r * np.cos(turn), r * np.sin(turn), rng.uniform(0, 3, n)])

    rng = np.random.default_rng(13)
    changes = compared(pipe(rng, 8_000), pipe(rng, n), correction="none")
    assert changes.significant.mean() < 0.1


def test_copies_are_one_point_and_single_precision_is_taken():
    """Counted as neighbors, copies widened the second neighborhoods: .6 of a pipe had moved."""
    rng = np.random.default_rng(16)
    before, after = wall(rng, 2_000), wall(rng, 2_000)
    expected = compared(before, after)
    twice = compared(before, np.vstack([after, after]))
    assert_allclose(twice.distance, expected.distance, rtol=1e-6, atol=1e-12)
    single = compared(before.astype(np.float32), after[:1_999].astype(np.float32))
    assert_allclose(single.distance, compared(before, after[:1_999]).distance, atol=1e-6)


def test_noise_alike_nearby_is_that_of_the_cloud_and_not_of_core_points():
    rng = np.random.default_rng(14)
    before, after = wall(rng, common=waves), wall(rng, common=waves)
    fitted = CloudChange(random_state=0).fit(before)
    some, whole = fitted.compare(after, before[::100]), fitted.compare(after)
    assert some.alike == whole.alike > 1.5
    told = whole.reason[::100] == 0
    assert_allclose(some.distance_error[told], whole.distance_error[::100][told])


def test_points_off_their_own_surface_are_no_place_of_it():
    rng = np.random.default_rng(15)
    before = np.vstack([wall(rng), [[4.0, 0.5, 2.5], [4.05, 0.5, 2.5]]])
    assert list(compared(before, wall(rng)).reason[-2:]) == [REASONS.index("no surface")] * 2


@pytest.mark.parametrize("scale", [0.001, 1000.0])
def test_the_unit_changes_nothing_but_lengths(scale):
    rng = np.random.default_rng(11)
    before, after = wall(rng, 3_000), wall(rng, 3_000)
    one, other = compared(before, after), compared(scale * before, scale * after)
    assert_allclose(other.distance, scale * one.distance, rtol=1e-5, atol=1e-9 * scale)
    assert_allclose(other.pvalue, one.pvalue, rtol=1e-4)


def test_clouds_that_cannot_be_meant_are_refused_or_warned_of():
    rng = np.random.default_rng(12)
    before, after = wall(rng, 2_000), wall(rng, 2_000)
    fitted = CloudChange(random_state=0).fit(before)
    with pytest.raises(ValueError, match="core has 2 columns, the clouds 3"):
        fitted.compare(after, before[:5, :2])
    with pytest.raises(ValueError, match=r"nowhere within a reach .* the second"):
        fitted.compare(1000 * after + 50_000)
    with pytest.warns(UserWarning, match="are equal"):
        equal = fitted.compare(before[::-1])
    assert (equal.distance[equal.reason == 0] == 0).all()
    with pytest.warns(UserWarning, match="second cloud is far sparser"):
        fitted.compare(after[::40])
    assert Scale.of([0.0], [0.0], 50).width == 1  # each cloud is copies of one point
    with pytest.warns(UserWarning, match="% of the core points have nothing"):
        fitted.compare(after + np.array([7.5, 0, 0]))


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"registration": np.eye(3)}, r"shape \(6, 6\)"),
        ({"registration": np.diag([1.0] * 5 + [-1.0])}, "without negative variances"),
    ],
)
def test_bad_parameters_are_refused(parameters, message):
    with pytest.raises(ValueError, match=message):
        CloudChange(**parameters).fit(wall(np.random.default_rng(0), 200))


def test_a_registration_of_bodies_is_for_space():
    with pytest.raises(ValueError, match="for points in space"):
        CloudChange(20, registration="auto").fit(np.random.default_rng(0).random((100, 2)))


def test_exact_points_have_neither_distance_nor_error():
    x, y = np.meshgrid(np.arange(40.0), np.arange(40.0))
    before = np.column_stack([x.ravel(), y.ravel(), np.zeros(1600)])
    changes = compared(before, before + np.array([0.25, 0.25, 0.0]))
    inner = (before[:, :2] > 5).all(axis=1) & (before[:, :2] < 34).all(axis=1)
    assert_allclose(changes.distance[inner], 0, atol=1e-12)
    assert not changes.significant[inner].any()


@pytest.mark.parametrize("noise", [0.0005, 0.002, 0.004])
def test_errors_hold_what_rounding_does_to_a_level_floor(noise):
    """Files of centimeters: a floor stands at a height of its own between two levels."""
    ratios = []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        height, moved = rng.uniform(0, 0.01), 0.0012 * (seed % 2)
        xyz = rng.uniform(0, 4, (2, 2_000, 3)) * [1, 1, 0]
        xyz[:, :, 2] = height + rng.normal(0, noise, (2, 2_000)) + [[0], [moved]]
        changes = compared(*np.round(xyz, 2), correction="none")
        error = np.nanmedian(changes.distance_error)
        ratios.append((np.nanmedian(changes.distance) - moved) / error)
    assert np.abs(ratios).max() < 2
