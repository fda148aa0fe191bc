"""mcmd demo: the files it writes and the accuracy it claims."""

import csv
import sys

import numpy as np
import pytest

from commands import done, error_line, files_in, run
from sklearn_mcmd.cli import _demo
from sklearn_mcmd.io import read_points, write_points


@pytest.fixture(scope="module")
def demo(tmp_path_factory):
    folder = tmp_path_factory.mktemp("demo") / "new" / "folder"
    pytest.importorskip("matplotlib")
    return folder, run("demo", folder)


def test_demo_writes_its_files(demo):
    folder, result = demo
    assert result.exit_code == 0, result.output
    names = "clean.laz", "clean_sensor.laz", "demo.png", "normals.laz", "street.laz"
    assert files_in(folder) == list(names)
    assert (folder / "demo.png").stat().st_size < 400_000


def test_demo_prints_the_accuracy_that_its_files_have_and_the_position_finds_most(demo):
    folder, result = demo
    truth = read_points(folder / "street.laz").attributes["true_outlier"] == 1
    shares = []
    told = result.stdout.split("against the truth")[1:]
    for name, text in zip(("clean.laz", "clean_sensor.laz"), told, strict=True):
        left = read_points(folder / name).attributes["true_outlier"] == 1
        shares.append((truth.sum() - left.sum()) / truth.sum())
        kept = (~left).sum() / (~truth).sum()
        assert f"outliers found       {100 * shares[-1]:.1f} %" in text
        assert f"regular points kept  {100 * kept:.1f} %" in text
    assert shares[0] < 0.8 < 0.9 < shares[1]


def test_demo_normals_are_nearer_to_the_truth_than_principal_components(demo):
    _, result = demo
    high = {
        line.split()[0]: float(line.split("below")[1].split()[0])
        for line in result.stdout.splitlines()
        if "95 % below" in line
    }
    assert high["mcmd_z"] < 0.5 * high["pca"]


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


def test_the_picture_that_pages_show_is_the_one_that_the_demo_makes(demo):
    figures = pytest.importorskip("benchmarks.demo_figures", reason="a checkout is needed")
    stored = n_red(figures.DOCS / "images" / "demo.png")
    assert stored == pytest.approx(n_red(demo[0] / "demo.png"), rel=0.01)  # and not one of 40,000


def n_red(picture):
    """Pixels of outliers in each quarter; another matplotlib may draw some otherwise."""
    image = pytest.importorskip("PIL.Image")
    red, green, blue = np.moveaxis(np.asarray(image.open(picture).convert("RGB"), int), 2, 0)
    outlier = (red > 180) & (green < 90) & (blue < 90)
    half = np.array_split(outlier, 2)
    return [int(quarter.sum()) for part in half for quarter in np.array_split(part, 2, axis=1)]


@pytest.mark.slow
def test_demo_in_the_same_folder_replaces_its_files_and_gives_the_same_again(tmp_path, monkeypatch):
    monkeypatch.setattr(_demo, "N_POINTS", 4_000)
    accuracy, files = [], []
    for _ in range(2):
        result = done("demo", tmp_path)
        accuracy.append(result.stdout.split("Outliers by")[1].split("Normals of")[0])
        files.append({path.name: path.read_bytes() for path in tmp_path.iterdir()})
    assert len(files[0]) == 5
    assert (accuracy[0], files[0]) == (accuracy[1], files[1])


@pytest.mark.parametrize("name", ["clean.laz", "street.laz"])
def test_the_demo_replaces_no_files_of_others(name, room_file, tmp_path):
    room_file.rename(tmp_path / name)
    before = (tmp_path / name).read_bytes()
    assert f"already holds {name}, of no earlier demo" in error_line(run("demo", tmp_path))
    assert (tmp_path / name).read_bytes() == before
    assert files_in(tmp_path) == [name]
    assert "cannot be made" in error_line(run("demo", tmp_path / name))


@pytest.fixture
def earlier(tmp_path, monkeypatch):
    """The folder of an earlier demo, and its files."""
    pytest.importorskip("matplotlib")
    monkeypatch.setattr(_demo, "N_POINTS", 2_000)
    done("demo", folder := tmp_path / "earlier")
    return folder, {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.mark.parametrize("name", ["clean.laz", "normals.laz", "demo.png"])
def test_beside_an_earlier_street_the_demo_replaces_no_files_of_others(name, earlier, tmp_path):
    folder, files = earlier
    mine = b"mine" if name == "demo.png" else scan_of_others(tmp_path)
    (folder / name).write_bytes(mine)
    assert f"already holds {name}, of no earlier demo" in error_line(run("demo", folder))
    assert {p.name: p.read_bytes() for p in folder.iterdir()} == files | {name: mine}


def scan_of_others(folder):
    write_points(folder / "mine.laz", [[0, 0, 0], [1, 2, 3]])
    return (folder / "mine.laz").read_bytes()


def test_the_demo_replaces_no_link_and_no_folder(earlier, tmp_path):
    folder, files = earlier
    (folder / "clean.laz").rename(tmp_path / "kept.laz")
    (folder / "clean.laz").symlink_to(tmp_path / "kept.laz")
    (folder / "demo.png").unlink()
    (folder / "demo.png").mkdir()
    assert "clean.laz, demo.png, of no earlier demo" in error_line(run("demo", folder))
    assert (tmp_path / "kept.laz").read_bytes() == files["clean.laz"]


def test_without_matplotlib_the_demo_says_so_before_its_work(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    line = error_line(run("demo", tmp_path / "demo"))
    assert "the picture needs matplotlib, which is not installed: pip install" in line
    assert files_in(tmp_path) == []
