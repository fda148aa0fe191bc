"""benchmarks/bench_quantity.py: numbers, distances and truth of its clouds, and its tables."""

import importlib
import sys
from argparse import Namespace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from scipy.spatial import cKDTree
from scipy.spatial.distance import pdist

BENCHMARKS = Path(__file__).resolve().parents[1] / "benchmarks"

if not BENCHMARKS.is_dir():
    pytest.skip("a checkout is needed", allow_module_level=True)
sys.path.insert(0, str(BENCHMARKS))
clouds, bench = map(importlib.import_module, ("_quantity_clouds", "bench_quantity"))
sys.path.remove(str(BENCHMARKS))

GROUND = np.random.default_rng(0).random((6_000, 3)) * [60, 60, 0.01]
CASE = clouds.Case("four", np.eye(4, 3), np.array([True, True, False, False]))


def spacing(points):
    """Median of the mean distance to 8 others."""
    distances = cKDTree(points).query(points, 9)[0][:, 1:]
    return np.median(distances.mean(axis=1))


def options():
    return Namespace(data=None, limit=None, seed=0)


def test_flat_pieces_are_planes_as_dense_as_the_cloud_and_off_it():
    unit = spacing(GROUND)
    pieces = clouds.flat_pieces(GROUND, 30, np.random.default_rng(0))
    assert {len(piece) for piece in pieces} <= set(range(25, 71))
    assert len({len(piece) for piece in pieces}) > 10
    nearest = np.array([cKDTree(GROUND).query(piece)[0].min() for piece in pieces]) / unit
    assert 13 < nearest.min() < 25  # of 15 local spacings
    assert 40 < nearest.max() < 66
    flatness = [np.linalg.svd(piece - piece.mean(axis=0))[1] for piece in pieces]
    assert max(values[2] / values[0] for values in flatness) < 1e-9
    assert np.median([spacing(piece) for piece in pieces]) == pytest.approx(unit, rel=0.1)
    normals = np.array([np.linalg.svd(piece - piece.mean(axis=0))[2][2] for piece in pieces])
    assert np.ptp(np.abs(normals[:, 2])) > 0.7  # in all directions


@pytest.mark.parametrize("inside", [True, False])
def test_the_wall_is_so_many_times_denser_than_the_ball_before_it(inside):
    wall, ball = clouds.ball_before_wall(3.0, inside, np.random.default_rng(0))
    assert len(ball) == 3_000
    assert spacing(ball) / spacing(wall) == pytest.approx(3, rel=0.08)
    reach = np.linalg.norm(ball - clouds.BALL_PLACE, axis=1)
    assert reach.max() <= 1 + 1e-9
    assert (np.ptp(reach) > 0.8) == inside
    assert -0.6 < ball[:, 1].max() < -0.4  # and the wall is at 0


def test_balls_have_no_outliers_and_one_part(monkeypatch):
    monkeypatch.setattr(clouds, "ball_before_wall", lambda *_: (GROUND[:5], GROUND[:3]))
    cases = list(clouds.ball(options()))
    assert len({case.name for case in cases}) == 6
    for case in cases:
        assert not case.outlier.any()
        assert_array_equal(case.parts["ball"], [False] * 5 + [True] * 3)


def test_thinning_takes_the_chosen_only():
    chosen = GROUND[:, 0] < 30
    points, left = clouds.thinned(GROUND, chosen, 0.1, np.random.default_rng(0))
    assert (~left).sum() == (~chosen).sum()
    assert left.sum() == pytest.approx(0.1 * chosen.sum(), rel=0.2)
    assert_array_equal(left, points[:, 0] < 30)


def test_a_strip_and_a_ball_hang_25_m_under_the_middle():
    rng = np.random.default_rng(0)
    strip = clouds.below(GROUND, True, rng)
    assert len(strip) == 32
    assert np.abs(strip[:, 2] + 25).max() < 0.3
    assert (np.abs(np.ptp(strip[:, :2], axis=0) / [28, 18] - 0.95) < 0.06).all()
    assert np.abs(strip[:, :2].mean(axis=0) - 30).max() < 4
    ball = clouds.below(GROUND, False, rng)
    assert len(ball) == 120
    assert pdist(ball).max() < 0.7
    assert np.abs(ball.mean(axis=0) - [30, 30, -25]).max() < 1


def test_streets_have_their_kinds_and_positions():
    lines = list(clouds.street(Namespace(limit=3_000, seed=0)))
    assert [case.outlier.mean() for case in lines] == pytest.approx([0.1, 0.2, 0.1, 0.2])
    for case in lines:
        assert_array_equal(sum(case.parts.values()), case.outlier)
        assert (case.position is not None) == case.name.startswith("scan lines")
    assert set(lines[0].parts) == {"gaussian", "uniform", "mixed_pixel", "ghost"}


def test_real_snow_has_its_labels_in_each_crop(tmp_path):
    (tmp_path / "snow_real_half_turn").mkdir()
    label = np.tile([110, 111, 0, 40, 50], 1_200).astype(np.uint16)
    xyz = np.column_stack([label, np.arange(6_000), np.zeros(6_000)])
    arrays = {"xyz": xyz, "label": label, "snow": label == 110, "intensity": label.astype(float)}
    np.savez(tmp_path / "snow_real_half_turn" / "half_turn.npz", **arrays)
    for limit, n in ((None, 6_000), (1_000, 1_000)):
        (case,) = clouds.snow(Namespace(data=tmp_path, limit=limit, seed=0))
        assert len(case.points) == n
        assert_array_equal(case.outlier, case.points[:, 0] == 110)
        assert_array_equal(case.parts["lying snow"], case.points[:, 0] == 111)
        assert_array_equal(case.known, case.points[:, 0] != 0)
        assert_array_equal(case.intensity, case.points[:, 0])
        assert not case.position.any()


def test_rows_are_percents_of_a_count_by_hand():
    flagged = np.array([True, False, True, False])
    row = bench.row_of(CASE._replace(parts={"real": ~CASE.outlier}), "mine", flagged)
    assert row == {
        **{"cloud": "four", "method": "mine", "F1": 50, "found": 50, "right": 50, "lost": 50},
        **{"real": 50},
    }
    known = np.array([True, False, False, True])
    row = bench.row_of(CASE._replace(known=known), "mine", flagged)
    assert row["F1, labelled"] == 100
    none = bench.row_of(CASE._replace(outlier=np.zeros(4, bool)), "mine", flagged)
    assert set(none) == {"cloud", "method", "lost"}


def test_luck_is_the_share_of_flags_that_one_run_has_alone(monkeypatch):
    one, other = np.array([1, 1, 1, 0, 0], bool), np.array([1, 1, 0, 1, 0], bool)
    assert bench.changed(one, other) == pytest.approx(1 / 3)
    assert bench.changed(one, one) == bench.changed(~one & one, one & ~one) == 0
    monkeypatch.setattr(bench, "flags", lambda case, random_state: [one, other, one][random_state])
    row = bench.row_of_luck(CASE)
    assert row["flags"] == "3"
    assert (row["changed"], row["worst"]) == pytest.approx((200 / 9, 100 / 3))


def test_methods_run_where_they_can():
    rng = np.random.default_rng(0)
    points = np.vstack([GROUND[:600] - [0, 0, 2], rng.uniform(-20, 20, (20, 3))])
    case = clouds.with_errors("few", points[:600], points[600:])
    names = {name for name, _ in bench.judgments(case)}
    assert names == {"default", *bench.PEERS}
    judged = dict(bench.judgments(case._replace(position=np.zeros(3))))
    assert {"position", "DROR", "DSOR", "10 over range, told"} < set(judged)
    assert judged["10 over range, told"].sum() == 20
    moved = case._replace(position=np.ones((620, 3)))
    assert {name for name, _ in bench.judgments(moved)} == {"default", "position", *bench.PEERS}


def test_tables_leave_free_what_is_not_measured():
    text = bench.table("two", [{"cloud": "a", "F1": 12.34}, {"cloud": "b", "lost": 5.0}])
    assert text.splitlines()[2:] == [
        *("| cloud | F1 | lost |", "| --- | --- | --- |", "| a | 12.3 |  |", "| b |  | 5.0 |"),
    ]
    told = "10 over range, told"
    rows = [{"cloud": "a", "method": told, "F1": 12.34}, {"cloud": "a", "method": "DROR"}]
    assert bench.page([*rows, {"cloud": "b", "F1": 5.0, "lost": 1.0}], ["F1"]).split("\n")[3:] == [
        *(
            f'   cloud, default, DROR, "{told}"',
            '   a: F1, "", "", 12.3',
            '   b: F1, 5.0, "", ""',
            "",
        ),
    ]
    for group in bench.GROUPS:
        assert hasattr(clouds, group if group != "luck" else "clean")
