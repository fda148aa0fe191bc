"""mcmd demo: the files it writes and the accuracy it claims."""

import csv
import re
import sys

import numpy as np
import pytest

from commands import done, error_line, files_in, run
from sklearn_mcmd.cli import _demo
from sklearn_mcmd.io import read_points

# Whoever runs README's first command has run it, too.
WHOLE = pytest.mark.slow


@pytest.fixture(scope="module")
def demo(tmp_path_factory):
    folder = tmp_path_factory.mktemp("demo") / "new" / "folder"
    pytest.importorskip("matplotlib")
    return folder, run("demo", folder)


@WHOLE
def test_demo_prints_the_accuracy_that_its_files_have_and_the_position_finds_most(demo):
    folder, result = demo
    assert result.exit_code == 0, result.output
    assert files_in(folder) == sorted(_demo.FILES)
    truth = read_points(folder / "street.laz").attributes["true_outlier"] == 1
    shares = []
    told = result.stdout.split("against the truth")[1:]
    for name, text in zip(("clean.laz", "clean_sensor.laz"), told, strict=True):
        left = read_points(folder / name).attributes["true_outlier"] == 1
        shares.append((truth.sum() - left.sum()) / truth.sum())
        kept = (~left).sum() / (~truth).sum()
        assert f"outliers found       {100 * shares[-1]:.1f} %" in text
        assert f"regular points kept  {100 * kept:.1f} %" in text
        right = (truth.sum() - left.sum() + (~left).sum()) / len(truth)
        assert f"accuracy             {100 * right:.1f} %" in text
    assert shares[0] < 0.8 < 0.9 < shares[1]


@WHOLE
def test_demo_prints_how_far_its_normals_are_from_the_truth(demo):
    folder, result = demo
    attributes = read_points(folder / "normals.laz").attributes
    normal, truth = (
        np.column_stack([attributes[f"{name}_{axis}"] for axis in "xyz"])
        for name in ("normal", "true_normal")
    )
    angles = np.degrees(np.arccos(np.clip(np.abs((normal * truth).sum(axis=1)), 0, 1)))
    median, high = np.nanquantile(angles, [0.5, 0.95])
    told = re.search(r"degrees +median (\S+), 95 % below (\S+)\n", result.stdout)
    assert float(told[1]) == pytest.approx(median, abs=0.02)
    assert float(told[2]) == pytest.approx(high, abs=0.1)
    assert high < 10


@WHOLE
def test_the_stored_run_that_pages_quote_has_the_shares_of_this_one(demo):
    figures = pytest.importorskip("benchmarks.demo_figures", reason="a checkout is needed")
    with open(figures.DOCS / "benchmarks" / "demo.csv", newline="") as file:
        stored = list(csv.reader(file))
    fresh = figures.table(demo[0])
    assert stored[0] == fresh[0]
    for old, new in zip(stored[1:], fresh[1:], strict=True):
        assert old[0] == new[0]
        # Another processor or library may round otherwise: a tenth of a percent of each kind.
        np.testing.assert_allclose(np.float64(old[1:]), np.float64(new[1:]), rtol=0, atol=0.1)


def test_the_demo_replaces_a_file_only_by_force_and_gives_the_same_again(tmp_path, monkeypatch):
    monkeypatch.setattr(_demo, "N_POINTS", 2_000)
    done("demo", tmp_path)
    files = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    names = ", ".join(_demo.FILES)
    assert f"already holds {names}; name another" in error_line(run("demo", tmp_path))
    for name in files.keys() - {"street.laz", "clean.laz"}:
        (tmp_path / name).unlink()
    (tmp_path / "street.laz").write_bytes(b"mine")
    (tmp_path / "clean.laz").unlink()
    (tmp_path / "clean.laz").symlink_to(tmp_path / "nowhere")
    assert "already holds street.laz, clean.laz; name" in error_line(run("demo", tmp_path))
    assert (tmp_path / "street.laz").read_bytes() == b"mine"
    assert files_in(tmp_path) == ["clean.laz", "street.laz"]
    (tmp_path / "clean.laz").unlink()
    done("demo", tmp_path, "--force")
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == files
    assert "cannot be made" in error_line(run("demo", tmp_path / "street.laz"))


def test_without_matplotlib_the_demo_says_so_before_its_work(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    line = error_line(run("demo", tmp_path / "demo"))
    assert "the picture needs matplotlib, which is not installed: pip install" in line
    assert files_in(tmp_path) == []
