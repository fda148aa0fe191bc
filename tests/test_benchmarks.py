"""The scripts of benchmarks/ run, their comparators are right, their tables are the stored ones."""

import csv
import importlib
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from sklearn_mcmd.datasets import make_street
from sklearn_mcmd.io import PointCloud, write_points

ROOT = Path(__file__).resolve().parents[1]
BENCHMARKS, STORED = ROOT / "benchmarks", ROOT / "docs" / "benchmarks"
if not BENCHMARKS.is_dir():
    pytest.skip("a checkout is needed", allow_module_level=True)


@pytest.fixture
def load(monkeypatch):
    """Imports a module of the folder."""
    monkeypatch.syspath_prepend(BENCHMARKS)
    return importlib.import_module


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    """Files of the kinds that scripts read: a ball with normals, and streets."""
    folder, rng = tmp_path_factory.mktemp("data"), np.random.default_rng(0)
    normals = rng.normal(size=(600, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    (folder / "ball").mkdir()
    edges = {"edge_dist": normals[:, 0] + 2}
    np.savez(folder / "ball" / "cloud.npz", xyz=normals, normals=normals, **edges)
    (folder / "large").mkdir()
    np.savez(folder / "large" / "cloud.npz", xyz=make_street(6_000, random_state=0).data)
    write_points(folder / "street.npy", PointCloud(make_street(3_000, random_state=0).data))
    return folder


SMOKE = [
    ("bench_edges", "barrels --data {data}", "s of processor time"),
    ("bench_normals", "clouds {data}/ball/cloud.npz --n-neighbors 20", "least squares"),
    ("bench_normals", "streets --size 1500 --seeds 1", "true planes"),
    ("bench_normals", "halves --data {data}", "auto, error"),
    ("bench_real", "--data {data} --clouds ball large --methods default radius", "worst"),
    ("bench_real", "--panel --data {data} --output {data}", "worse by"),
    ("bench_segmentation", "roofs --sizes 300 --creases 30 --noises 0.1 --seeds 1", "barrel"),
    ("bench_segmentation", "peers --methods --output {data}/none.json", "CGAL growing, 20"),
    ("figures", "", "docs/view.rst"),
    ("readme_figures", "{data}/street.npy", "not reweighted"),
]
SLOW = [
    ("bench_planes", "--simulated 2", "a clean wall seen from aside"),
    ("bench_planes", "--data {data} --limit 6000", "real planes agree, tilt"),
    (
        "bench_segmentation",
        "peers --clouds crown --methods sklearn_mcmd --output {data}/a.json",
        "0.99         not run",
    ),
]


@pytest.mark.parametrize(
    ("script", "arguments", "shown"),
    [*SMOKE, *(pytest.param(*row, marks=pytest.mark.slow) for row in SLOW)],
)
def test_a_script_runs_and_prints_its_table(script, arguments, shown, load, data, capsys):
    load(script).main(arguments.format(data=data).split())
    assert shown in capsys.readouterr().out


def test_each_script_runs_here_or_is_named_by_figures(load):
    named = "".join(row[2] for row in load("figures").RESULTS)
    scripts = {path.stem for path in BENCHMARKS.glob("[!_]*.py")}
    assert {s for s in scripts if f"{s}.py" not in named} <= {row[0] for row in SMOKE + SLOW}


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="memory is read as Linux tells it")
def test_peers_are_measured_stored_and_shown(tmp_path):
    output = tmp_path / "peers.json"
    wanted = ["normals: sklearn_mcmd, default", "outliers: sklearn_mcmd"]
    wanted += ["regions: sklearn_mcmd, normals given"]
    arguments = ["--sizes", "2000", "--rounds", "1", "--threads", "1", "--output", output]
    command = [sys.executable, BENCHMARKS / "bench_peers.py", *arguments, "--jobs", *wanted]
    subprocess.run(command, check=True)
    assert not [run for run in json.loads(output.read_text())["runs"] if "left_out" in run]
    assert {"accuracy.csv", "costs.csv"} <= {path.name for path in tmp_path.iterdir()}


@pytest.mark.parametrize("name", ["peers", "segmentation"])
def test_the_stored_tables_are_those_of_the_stored_results(name, load):
    tables = load("bench_peers" if name == "peers" else "_region_peers").tables
    prefix = "" if name == "peers" else "segmentation_"
    for table, rows in tables(json.loads((STORED / f"{name}.json").read_text())).items():
        with open(STORED / f"{prefix}{table}.csv", newline="") as file:
            assert list(csv.reader(file)) == rows


def planes_by_loops(surface, labels):
    """The definitions of `plane_scores`, by sets of points."""
    known = set(np.flatnonzero(surface >= 0))
    surfaces = [set(np.flatnonzero(surface == i)) for i in range(surface.max() + 1)]
    segments = [set(np.flatnonzero(labels == i)) for i in range(labels.max() + 1)]
    segments = [s & known for s in segments if s & known and 2 * len(s & known) >= len(s)]
    surfaces = [s for s in surfaces if s]

    def overlap(a, b):
        return len(a & b) / len(a | b)

    def parts(one, others):
        return [other for other in others if overlap(one, other) >= 0.2]

    def lost(one, others, ones):
        mine = parts(one, others)
        return not mine or (
            len(mine) == 1 and overlap(one, mine[0]) <= 0.5 and len(parts(mine[0], ones)) == 1
        )

    pairs = [(a, b) for a in surfaces for b in segments]
    found = [pair for pair in pairs if overlap(*pair) > 0.5]
    strict = [pair for pair in pairs if overlap(*pair) >= 0.75]
    n, m = len(surfaces), len(segments)
    return {
        "precision": len(found) / m,
        "recall": len(found) / n,
        "f1": 2 * len(found) / (n + m),
        "f1_strict": 2 * len(strict) / (n + m),
        "under": sum(len(parts(b, surfaces)) > 1 for b in segments) / m,
        "over": sum(len(parts(a, segments)) > 1 for a in surfaces) / n,
        "noise": sum(lost(b, surfaces, segments) for b in segments) / m,
        "missed": sum(lost(a, segments, surfaces) for a in surfaces) / n,
        "iou": np.mean([max(overlap(a, b) for b in segments) for a in surfaces]),
        "dice": np.mean([2 * len(a & b) / (len(a) + len(b)) for a, b in found]) if found else 0,
    }


def test_planes_are_found_over_and_under_segmented_as_sets_of_points_say(load):
    plane_scores, rng, seen = load("_region_planes").plane_scores, np.random.default_rng(0), []
    for _ in range(300):
        surface = np.sort(rng.integers(-1, rng.integers(1, 6), 40))
        moved = rng.random(40) < rng.uniform(0, 0.6)
        labels = np.where(moved, rng.integers(-1, 5, 40), surface // rng.integers(1, 3))
        scores = plane_scores(surface, labels)
        assert scores == pytest.approx(planes_by_loops(surface, labels), abs=1e-4)
        seen.append(list(scores.values()))
    assert (np.ptp(seen, axis=0) > 0.3).all()  # each share takes small and large values
