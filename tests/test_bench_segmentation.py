"""benchmarks/bench_segmentation.py peers: its scores, its tables, and what is not installed."""

import csv
import importlib
import json
import sys
from argparse import Namespace
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[1]
STORED = ROOT / "docs" / "benchmarks" / "segmentation.json"

if not STORED.is_file():
    pytest.skip("a checkout is needed", allow_module_level=True)
sys.path.insert(0, str(ROOT / "benchmarks"))
NAMES = ("_region_clouds", "_region_methods", "_region_peers")
clouds, methods, peers = map(importlib.import_module, NAMES)
sys.path.remove(str(ROOT / "benchmarks"))

RNG = np.random.default_rng(0)
PLANE = np.column_stack([RNG.uniform(0, 1, (3000, 2)), RNG.uniform(-0.01, 0.01, 3000)])


def test_a_flat_region_is_pure_and_a_right_angle_in_one_is_half():
    wall = PLANE[:, [2, 0, 1]]
    both, two = np.vstack([PLANE, wall]), np.repeat([0, 1], 3000)
    assert clouds.purity(both, two, 0.011) == 1
    assert clouds.purity(both, 0 * two, 0.011) == pytest.approx(0.51, abs=0.01)
    assert clouds.purity(both, np.where(two == 1, -1, 0), 0.011) == 1  # no region, no verdict
    assert clouds.purity(both, 0 * two - 1, 0.011) is None


def test_the_tolerance_may_differ_from_point_to_point():
    noisy = PLANE * [1, 1, 5]
    tolerance = np.where(np.arange(3000) < 1500, 0.055, 0.0055)
    assert clouds.purity(noisy, np.zeros(3000, int), tolerance) == pytest.approx(0.55, abs=0.03)


@pytest.mark.parametrize("X", [np.zeros((9, 3)), np.outer(np.arange(9), [1, 2, 3]) * 1.0])
def test_points_of_one_line_are_in_one_plane(X):
    assert clouds.purity(X, np.zeros(9, int), 1e-9) == 1


def test_regions_for_80_percent_are_counted_from_the_largest_on():
    labels = np.repeat([0, 1, 2, -1], [1500, 1000, 300, 200])
    unlabeled = clouds.Cloud(PLANE, None, 0.01)
    found = clouds.scores(unlabeled, labels)
    assert (found["regions"], found["for_80"]) == (3, 2)
    assert found["inside"] == pytest.approx(2800 / 3000)
    assert clouds.scores(unlabeled, np.where(labels == 2, 2, -1))["for_80"] is None


def test_a_table_is_scored_by_the_overlap_of_its_largest_region():
    surface = np.repeat([1, -1], [80, 20])
    labels = np.repeat([0, 1, 1, -1], [60, 20, 10, 10])
    assert clouds.agreement(surface, labels) == pytest.approx(60 / 80)
    assert clouds.agreement(surface, np.repeat([0, -1], [90, 10])) == pytest.approx(80 / 90)
    assert clouds.agreement(surface, np.full(100, -1)) == 0


@pytest.fixture
def run(tmp_path, monkeypatch):
    """Runs a method on a small cloud, and returns the stored results."""
    small = {"small/a": lambda: clouds.simulated_roof("gable", 1000)}
    monkeypatch.setattr(peers, "loaders", lambda data: small)
    path = tmp_path / "segmentation.json"

    def start(*names, clouds=None, resume=False):
        options = {"output": path, "data": "", "limit": 60, "clouds": clouds, "resume": resume}
        peers.run(Namespace(methods=names, **options))
        return json.loads(path.read_text()) if path.is_file() else {}

    return start


FIGURES = {"points": 1000, "seconds": 0.5, "regions": 2, "score": 0.9}


def test_what_is_not_installed_is_said_and_keeps_its_stored_results(run, monkeypatch, capsys):
    monkeypatch.setattr(peers, "version_of", lambda method: "one 1.0")
    monkeypatch.setattr(peers, "measured", lambda *_: [("small/a", FIGURES)])
    run("Open3D patches")
    monkeypatch.setattr(peers, "version_of", lambda method: None)
    stored = run("Open3D patches", "CGAL RANSAC")
    assert "CGAL RANSAC: CGAL is not installed" in capsys.readouterr().out
    assert stored["Open3D patches"]["clouds"] == {"small/a": FIGURES}
    tables = peers.tables(stored)
    row = dict(zip(*tables["scores"], strict=True))
    assert (row["cloud"], row["points"], row["Open3D patches"]) == ("small", "1,000", "0.90")
    assert row["CGAL RANSAC"] == "not run"
    packages = {name: package for name, _, package in tables["methods"]}
    assert packages["Open3D patches"] == "one 1.0"
    assert packages["CGAL RANSAC"] == "not installed"


@pytest.mark.parametrize("method", methods.PEERS)
def test_a_package_that_is_absent_has_no_version(method, monkeypatch):
    monkeypatch.setattr(methods, "find_spec", lambda name: None)
    monkeypatch.setattr(methods.shutil, "which", lambda name: None)
    assert methods.version_of(method) is None


def test_a_failure_is_a_cell_and_parts_are_averaged():
    parts = {"a/1": FIGURES, "a/2": {**FIGURES, "score": 0.7}, "b": {"failed": "over 9 s"}}
    tables = peers.tables({methods.OURS: {"package": "x", "clouds": parts}})
    assert [row[2] for row in tables["scores"][1:]] == ["0.80", "over 9 s"]


@pytest.mark.parametrize("method", methods.PEERS)
def test_each_method_that_is_installed_divides_a_right_angle(method):
    if methods.version_of(method) is None:
        pytest.skip(f"{methods.METHODS[method].package} is not installed")
    X = np.vstack([PLANE, PLANE[:, [2, 0, 1]] + [0, 0, 0.05]])
    labels, seconds = peers.measure(method, clouds.Cloud(X, None, 0.006))
    assert labels.shape == (6000,)
    assert seconds > 0
    # PCL may join the faces. Of the others this also says that labels are in the order of rows.
    if not method.startswith("PCL"):
        assert clouds.agreement(np.repeat([0, 1], 3000), labels) > 0.6


def test_the_stored_tables_are_those_of_the_stored_results():
    for name, rows in peers.tables(json.loads(STORED.read_text())).items():
        with open(STORED.with_name(f"segmentation_{name}.csv"), newline="") as file:
            assert list(csv.reader(file)) == rows, "python benchmarks/bench_segmentation.py peers"
