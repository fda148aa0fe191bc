"""The scripts of benchmarks/ run, their comparators are right, their tables are the stored ones."""

import csv
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


def test_planes_are_found_over_and_under_segmented_as_sets_of_points_say(load):
    """Of five faces of ten points one is whole, one in halves, two are in one segment, one is
    missed."""
    labels = np.repeat([0, 1, 2, 3, -1], [10, 5, 5, 20, 10])
    known = {"precision": 1 / 4, "recall": 1 / 5, "f1": 2 / 9, "f1_strict": 2 / 9, "under": 1 / 4}
    known |= {"over": 1 / 5, "noise": 0, "missed": 1 / 5, "iou": 0.5, "dice": 1}
    scores = load("_region_planes").plane_scores(np.repeat(np.arange(5), 10), labels)
    assert scores == pytest.approx(known, abs=1e-4)
