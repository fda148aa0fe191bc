"""benchmarks/bench_real.py: its comparators, against loops over all pairs of points."""

import importlib
import sys
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

BENCHMARKS = Path(__file__).resolve().parents[1] / "benchmarks"

if not BENCHMARKS.is_dir():
    pytest.skip("a checkout is needed", allow_module_level=True)
sys.path.insert(0, str(BENCHMARKS))
clouds, methods, bench = map(
    importlib.import_module, ("_real_clouds", "_real_methods", "bench_real")
)
sys.path.remove(str(BENCHMARKS))


def turn():
    """Rings on a noisy ground and a wall, and flakes: 300 points about the sensor."""
    rng = np.random.default_rng(0)
    azimuth = np.tile(np.linspace(0, 2 * np.pi, 60, endpoint=False), 4)
    reach = np.repeat([4.0, 6.0, 9.0, 14.0], 60) * rng.normal(1, 0.002, 240)
    ground = np.column_stack([reach * np.cos(azimuth), reach * np.sin(azimuth), np.full(240, -1.8)])
    return np.vstack([ground + rng.normal(0, 0.01, ground.shape), rng.uniform(-25, 25, (60, 3))])


X = turn()
DISTANCES = np.linalg.norm(X[:, None] - X, axis=2)
RISING = np.sort(DISTANCES, axis=1)[:, 1:]  # without the point itself
SPACING = np.median(RISING[:, :8].mean(axis=1))
RANGES = np.sqrt((X**2).sum(axis=1))


def flagged(name, points=X, share=None):
    labels, outlyingness = methods.METHODS[name](points, share)
    assert len(labels) == len(outlyingness) == len(points)
    return labels == -1


def check(name, expected):
    """The same points go, and this can fail: some go, and some stay."""
    assert 0 < expected.sum() < len(expected)
    assert_array_equal(flagged(name), expected)


def test_isolated_voxels_count_the_points_of_27_voxels():
    voxels = np.floor((X - X.min(axis=0)) / (4 * SPACING))
    steps = np.abs(voxels[:, None] - voxels).max(axis=2)
    check("isolated voxels", (steps <= 1).sum(axis=1) - 1 <= 5)


def test_cloudcompare_takes_what_is_off_its_neighbors_plane():
    expected = []
    for i, distances in enumerate(DISTANCES):
        near = X[(distances <= 3 * SPACING) & (np.arange(len(X)) != i)]
        if len(near) < 3:
            expected.append(True)
            continue
        normal = np.linalg.svd(near - near.mean(axis=0))[2][2]
        off = (near - near.mean(axis=0)) @ normal
        expected.append(abs((X[i] - near.mean(axis=0)) @ normal) > off.std())
    check("CloudCompare", np.array(expected))


def test_cloudcompare_keeps_points_of_one_place_and_of_an_exact_plane():
    sheet = np.stack(np.meshgrid(np.arange(12.0), np.arange(12.0), [0.0]), axis=-1).reshape(-1, 3)
    assert not flagged("CloudCompare", np.vstack([sheet, np.tile(sheet[:1], (20, 1))])).any()


def test_the_angle_between_beams_is_the_step_of_azimuth():
    azimuth, height = np.meshgrid(np.radians(np.arange(0, 360, 2)), [-0.3, -0.1, 0.1])
    rays = np.stack([np.cos(azimuth), np.sin(azimuth), height], axis=-1).reshape(-1, 3)
    points = np.vstack([5 * rays, 8 * rays[::3]])  # a third has two echoes
    assert methods.beam_angle(points) == pytest.approx(np.radians(2), rel=0.05)


def test_dror_asks_for_three_others_within_a_radius_that_grows_with_the_range():
    reach = np.maximum(3 * methods.beam_angle(X) * RANGES, 0.04)
    check("DROR", (reach[:, None] >= DISTANCES).sum(axis=1) - 1 < 3)


def test_dsor_scales_its_threshold_by_the_range():
    mean = RISING[:, :5].mean(axis=1)
    check("DSOR", mean > 0.05 * RANGES * (mean.mean() + 0.01 * mean.std()))


def test_ten_neighbors_over_range_untold_and_told_with_and_without_intensity():
    ratio = RISING[:, :10].mean(axis=1) / RANGES
    check("10 over range", ratio > ratio.mean() + 2 * ratio.std())
    assert methods.METHODS["10 over range, told"](X, None) is None
    intensity = np.random.default_rng(1).uniform(0, 99, len(X))
    for name, score in (("", ratio), (" and intensity", ratio / (1 + intensity))):
        of_cloud = clouds.RealCloud("turn", X, None, None, True, intensity)
        labels, outlyingness = methods.judgment(f"10 over range{name}, told", of_cloud, 0.2)
        assert_allclose(outlyingness, score)
        assert_array_equal(labels == -1, score > np.sort(score)[-61])


def test_points_at_the_sensor_break_nothing():
    points = np.vstack([X, np.zeros((20, 3))])
    for name in ("DROR", "DSOR", "10 over range"):
        assert not np.isnan(methods.METHODS[name](points, None)[1]).any()


def test_what_needs_position_or_intensity_runs_only_where_they_are():
    nowhere = clouds.RealCloud("town", X, None, None)
    for name in methods.FROM_ORIGIN & set(methods.METHODS):
        assert methods.judgment(name, nowhere, 0.2) is None
    without = nowhere._replace(from_origin=True)
    for name in methods.WITH_INTENSITY & set(methods.METHODS):
        assert methods.judgment(name, without, 0.2) is None
    assert methods.judgment("DROR", without, 0.2) is not None
    assert methods.FROM_ORIGIN - set(methods.METHODS) <= {"position, intensity"}


def test_the_table_leaves_free_what_cannot_be_used(monkeypatch):
    monkeypatch.setattr(bench, "inject", lambda points, rng: (points, np.full(len(points), "real")))
    names = ["DROR", "SOR 20"]
    rows = list(bench.measured(clouds.RealCloud("town", X, None, None), names, seed=0))
    assert {row.method for row in rows} == {"SOR 20"}
    noisy = clouds.RealCloud("turn", X, None, np.arange(300) >= 240, True)
    rows = list(bench.measured(noisy, names, seed=0))
    found = {r.method: r.value for r in rows if (r.part, r.measure) == ("clean", "TPR")}
    assert found["DROR"] == pytest.approx(100 * flagged("DROR")[240:].mean())


def test_clouds_say_whether_they_are_from_the_origin_and_crops_keep_their_rows(tmp_path):
    arrays = {"xyz": X, "intensity": np.arange(300, dtype=np.float16), "snow": RANGES > 9}
    for folder in ("snow_turns", "town"):
        (tmp_path / folder).mkdir()
        np.savez(tmp_path / folder / "cloud.npz", **arrays)
    snow, town = clouds.load_clouds(tmp_path, limit=100)
    assert (snow.from_origin, town.from_origin) == (True, False)
    rows = snow.intensity.astype(int)
    assert len(rows) == 100
    assert_array_equal(snow.points, X[rows])
    assert_array_equal(snow.noise, RANGES[rows] > 9)
