"""Readers and measures of `benchmarks/bench_public.py`, on made data whose answer is known."""

import csv
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[1]
if not (ROOT / "benchmarks").is_dir():
    pytest.skip("a checkout is needed", allow_module_level=True)


@pytest.fixture
def score_roof(load):
    def score(plane, labels):
        plane, labels = np.asarray(plane), np.asarray(labels)
        roof = load("_public_data").Roof("all", np.zeros((len(plane), 3)), plane)
        return load("_public_measures").roof_scores(roof, labels)

    return score


NAMES = ["mean IoU", "precision", "recall", "faces off by", "over", "under"]
ROOFS = {  # faces, segments, the ARI's bounds, and the other scores
    "right by other numbers": (
        [[4, 1, 2], [5, 9, 6]],
        [[0, 2, 1], [5, 9, 6]],
        (0.99, 1.01),
        [1, 1, 1, 0, 0, 0],
    ),
    # The half of six is matched: 6 of 10; the other finds none.
    "a face in two halves": (
        [[1, 2], [10, 10]],
        [[0, 1, 2], [10, 6, 4]],
        (0.01, 0.99),
        [0.8, 2 / 3, 1, 1, 0.5, 0],
    ),
    "two faces in one": ([[1, 2], [10, 30]], [[0], [40]], (-0.01, 0.01), [0.75, 1, 0.5, 1, 0, 1]),
    # Points of no segment are a label more for ARI alone.
    "points of none": (
        [[1, 2, -1], [10, 10, 5]],
        [[0, 1, -1, 3], [10, 8, 2, 5]],
        (0.01, 0.99),
        [0.9, 1, 1, 0, 0, 0],
    ),
}


@pytest.mark.parametrize("kind", ROOFS)
def test_roofs_whose_faces_are_known_have_known_scores(score_roof, kind):
    plane, labels, (least, most), expected = ROOFS[kind]
    scores = score_roof(np.repeat(*plane), np.repeat(*labels))
    assert least < scores.pop("ARI") < most
    assert scores == pytest.approx(dict(zip(NAMES, expected, strict=True)))


def test_normals_that_are_off_by_known_angles_have_known_scores(load):
    off = np.radians([0.0, 6, 20, 40])
    normals = np.column_stack([np.sin(off), np.zeros(4), np.cos(off)])
    normals[0] *= -1  # the side does not count
    normals = np.vstack([normals, np.full((1, 3), np.nan), [[1, 0, 0]]])  # the last is not judged
    truth = np.tile([0.0, 0, 1], (6, 1))
    shape = load("_public_data").Shape("no noise", np.zeros((6, 3)), truth, np.arange(5))
    scores = load("_public_measures").normal_scores(shape, normals)
    rmse = np.sqrt(np.mean([0, 36, 400, 1600, 8100]))
    area = 100 * np.mean([1, 24 / 30, 10 / 30, 0, 0])
    expected = {"RMSE": rmse, "within 5": 20, "within 10": 40, "area": area}
    assert scores == pytest.approx(expected, abs=1e-5)


def test_flakes_are_counted_as_found_and_as_wrongly_flagged(load):
    snow = np.repeat([True, False], [4, 16])
    frame = load("_public_data").Frame("all", np.zeros((20, 3)), np.zeros(20), snow)
    flagged = np.isin(np.arange(20), [0, 1, 2, 10])
    scores = load("_public_measures").snow_scores(frame, flagged)
    assert scores == pytest.approx({"precision": 75, "recall": 75, "F1": 75, "others lost": 6.25})
    assert load("_public_measures").snow_scores(frame, snow & False)["F1"] == 0


def roofs(folder):
    """Two gables of 400 points."""
    x, y = np.random.default_rng(0).uniform(-1, 1, (2, 800))
    X, building = np.column_stack([x, y, -0.7 * np.abs(x)]), np.arange(800) % 2
    np.savez(folder / "roofs.npz", xyz=X, building=building, plane=1 + (x > 0))


def test_the_command_prints_ours_peers_what_is_left_out_and_what_is_printed(
    load, tmp_path, monkeypatch, capsys
):
    roofs(tmp_path)
    methods = load("_public_methods")
    absent = methods.ROOFS["Open3D patches"]._replace(package="no_such_library")
    monkeypatch.setitem(methods.ROOFS, "Open3D patches", absent)
    load("bench_public").main(["roofs_ntnu", str(tmp_path), "--output", str(tmp_path)])
    assert "Open3D patches: no_such_library is not installed" in capsys.readouterr().out
    with open(tmp_path / "public_roofs_ntnu.csv", newline="") as file:
        rows = {row["method"]: row for row in csv.DictReader(file)}
    assert float(rows["sklearn_mcmd"]["ARI"]) > 0.95
    assert rows["sklearn_mcmd"]["faces off by"] == "0.000"
    assert rows["Open3D patches"]["ARI"] == "not installed"
    assert rows["printed: network, trees"]["ARI"] == "0.875"


@pytest.mark.parametrize("name", ["roofs_ntnu", "pcpnet", "wads"])
def test_the_stored_table_has_the_methods_and_the_printed_rows_of_the_command(name, load):
    benchmark = load("bench_public").BENCHMARKS[name]
    rows = [(method, how.setting) for method, how in benchmark.methods.items()]
    rows += [(method, cells[0]) for method, cells in benchmark.printed.items()]
    with open(ROOT / "docs" / "benchmarks" / f"public_{name}.csv", newline="") as file:
        assert [(row["method"], row["told"]) for row in csv.DictReader(file)] == rows
