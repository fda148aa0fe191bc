"""The benchmark of normals by PCPNet's protocol: its measures, files, methods and table."""

import csv
import importlib
import sys
from pathlib import Path

import numpy as np
import pytest

from sklearn_mcmd import RobustNormalEstimator

BENCHMARKS = Path(__file__).parent.parent / "benchmarks"
ALL_KINDS = ["none", "0.12 %", "0.6 %", "1.2 %", "stripes", "gradient"]
MODULES = ("bench_normals", "_normal_methods", "_pcpnet")


@pytest.fixture
def bench(monkeypatch):
    monkeypatch.syspath_prepend(BENCHMARKS)
    yield importlib.import_module("bench_normals")
    for name in MODULES:
        sys.modules.pop(name, None)


@pytest.fixture
def methods(bench):
    return sys.modules["_normal_methods"]


@pytest.fixture
def pcpnet(bench):
    return sys.modules["_pcpnet"]


def ball(n, seed=0):
    """Points of a ball, and normals that are not of unit length."""
    normals = np.random.default_rng(seed).normal(size=(n, 3))
    points = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    return [1, 1, 2] * points, normals / [1, 1, 2]


def write_pair(folder, name, points, normals, rows=None):
    np.savetxt(folder / f"{name}.xyz", points)
    np.savetxt(folder / f"{name}.normals", normals)
    if rows is not None:
        np.savetxt(folder / f"{name}.pidx", rows, fmt="%d")


def test_measures_are_those_of_angles_made_by_hand(methods):
    found = methods.errors(np.array([0.0, 5.0, 6.0, 15.0, 30.0, 60.0, 45.0, 3.0]))
    assert found.rmse == pytest.approx(np.sqrt((25 + 36 + 225 + 900 + 3600 + 2025 + 9) / 8))
    shares = found.within_5, found.within_10, found.within_20, found.beyond_45
    assert shares == (37.5, 50.0, 62.5, 12.5)


def test_angles_forget_the_side_of_a_normal(methods):
    tilts = np.radians([0, 30, 90, 150, 180])
    found = np.column_stack([np.sin(tilts), np.zeros(5), np.cos(tilts)])
    angles = methods.unoriented_angles(found, np.tile([0.0, 0.0, 1.0 + 1e-12], (5, 1)))
    np.testing.assert_allclose(angles, [0, 30, 90, 30, 0], atol=1e-5)


def test_pca_is_that_of_the_estimator(methods):
    points, _ = ball(600)
    found = methods.estimates(points, np.tile([0.0, 0.0, 1.0], (600, 1)), np.arange(600))
    ours = RobustNormalEstimator(18, method="pca").fit(points).normals_
    angles = next(each.angles for each in found if each.method == "PCA, k = 18")
    np.testing.assert_allclose(angles, np.degrees(np.arccos(np.abs(ours[:, 2]))), atol=1e-5)


def test_a_jet_knows_the_normal_of_a_quadric_and_pca_does_not(methods):
    rng = np.random.default_rng(0)
    u, v = rng.uniform(-1, 1, (2, 20, 40))
    members = np.stack([u, v, 0.3 * u + 0.01 * (u * u - 0.5 * u * v + 0.2 * v * v)], axis=2)
    truth = np.tile(np.array([-0.3, 0.0, 1.0]) / np.hypot(0.3, 1), (20, 1))
    # Over the plane of least squares, which is tilted, the surface is a quadric but for 1e-4.
    assert methods.unoriented_angles(methods.jet_normals(members), truth).max() < 0.02
    assert methods.unoriented_angles(methods.pca_normals(members), truth).max() > 0.1


def test_a_neighborhood_of_copies_has_a_finite_jet(methods):
    assert np.isfinite(methods.jet_normals(np.zeros((1, 18, 3)))).all()


def test_oracles_have_the_least_errors_over_the_cloud_and_at_each_point(methods):
    points, normals = ball(700)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    rows = np.arange(0, 700, 7)
    noisy = points + np.random.default_rng(1).normal(0, 0.03, points.shape)
    found = {each.method: each for each in methods.estimates(noisy, normals, rows)}
    pca = [found[f"PCA, k = {k}"] for k in methods.PCA_NEIGHBORS]
    of_cloud, of_points = found["PCA, best k of the cloud"], found["PCA, best k of each point"]
    least = min(methods.errors(each.angles).rmse for each in pca)
    assert methods.errors(of_cloud.angles).rmse <= least
    assert of_cloud.n_neighbors > 8  # the noise is half of the spacing
    assert (of_points.angles <= np.min([each.angles for each in pca], axis=0)).all()


def test_noise_has_its_share_of_the_diagonal(pcpnet, tmp_path):
    points, normals = ball(5000)
    write_pair(tmp_path, "ball", points, normals)
    clouds = {c.kind: c for c in pcpnet.benchmark_clouds(tmp_path, ALL_KINDS[:4])}
    diagonal = np.linalg.norm(np.ptp(points, axis=0))
    for kind, share in {"0.12 %": 0.0012, "0.6 %": 0.006, "1.2 %": 0.012}.items():
        noise = clouds[kind].points - clouds["none"].points
        # Four standard errors of a standard deviation of 5,000 numbers are 4 %.
        np.testing.assert_allclose(noise.std(axis=0), share * diagonal, rtol=0.04)
        np.testing.assert_allclose(clouds[kind].normals, clouds["none"].normals)
        assert clouds[kind].made
    assert not clouds["none"].made
    np.testing.assert_allclose(np.linalg.norm(clouds["none"].normals, axis=1), 1)


def test_clouds_depend_on_their_own_names_only(pcpnet, tmp_path):
    points, normals = ball(400)
    write_pair(tmp_path, "ball", points, normals)
    alone = list(pcpnet.benchmark_clouds(tmp_path, ["0.6 %", "stripes"], 50))
    write_pair(tmp_path, "another", points, normals)
    both = list(pcpnet.benchmark_clouds(tmp_path, ["stripes", "0.6 %"], 50))
    by_name = {(cloud.shape, cloud.kind): cloud for cloud in both}
    for cloud in alone:
        again = by_name["ball", cloud.kind]
        np.testing.assert_array_equal(cloud.points, again.points)
        np.testing.assert_array_equal(cloud.rows, again.rows)
        another = by_name["another", cloud.kind]
        assert not np.array_equal(cloud.rows, another.rows)
        assert not np.array_equal(cloud.points, another.points)


def test_made_density_varies_along_the_longest_side(pcpnet, tmp_path):
    rng = np.random.default_rng(0)
    points = rng.uniform(0, [1, 8, 1], (40_000, 3))
    write_pair(tmp_path, "bar", points, points + 1)
    stripes, gradient = pcpnet.benchmark_clouds(tmp_path, ["stripes", "gradient"])
    # Half a stripe is half a unit wide and holds 2,500 points.
    counts, _ = np.histogram(stripes.points[:, 1], np.linspace(0, 8, 17))
    np.testing.assert_allclose(counts[::2], 2500, rtol=0.1)
    np.testing.assert_allclose(counts[1::2], 250, rtol=0.3)
    counts, _ = np.histogram(gradient.points[:, 1], np.linspace(0, 8, 5))
    shares = 0.1 + 0.9 * np.array([1, 3, 5, 7]) / 8
    np.testing.assert_allclose(counts, 10_000 * shares, rtol=0.1)
    for cloud in (stripes, gradient):
        truth = (cloud.points + 1) / np.linalg.norm(cloud.points + 1, axis=1, keepdims=True)
        np.testing.assert_allclose(cloud.normals, truth)
        assert len(np.unique(cloud.rows)) == 5000


def test_a_file_comes_before_what_would_be_made(pcpnet, tmp_path):
    points, normals = ball(60)
    write_pair(tmp_path, "ball", points, normals, rows=[5, 3, 59, 0])
    write_pair(tmp_path, "ball_noise_white_5.00e-02", points + 1, normals, rows=[7, 8])
    write_pair(tmp_path, "ball_ddist_minmax_layers", points[:30], normals[:30])
    write_pair(tmp_path, "ball_noise_brown_5.00e-02", points, normals)
    clouds = {c.kind: c for c in pcpnet.benchmark_clouds(tmp_path, ALL_KINDS, 3)}
    assert list(clouds) == ALL_KINDS
    made = {"0.12 %", "1.2 %", "gradient"}
    assert {kind for kind, cloud in clouds.items() if cloud.made} == made
    assert {cloud.shape for cloud in clouds.values()} == {"ball"}
    np.testing.assert_allclose(clouds["0.6 %"].points, points + 1)
    assert clouds["none"].rows.tolist() == [5, 3, 59]  # the first ones of the file
    assert clouds["0.12 %"].rows.tolist() == [5, 3, 59]  # the same points, with noise
    assert clouds["0.6 %"].rows.tolist() == [7, 8]
    assert len(clouds["stripes"].points) == 30
    assert len(clouds["gradient"].rows) == 3


def test_a_list_names_the_files_to_take(pcpnet, tmp_path):
    for name in ("ball", "cup", "cup_noise_white_1.00e-02"):
        write_pair(tmp_path, name, *ball(30))
    names = ["cup_noise_white_1.00e-02"]
    (cloud,) = pcpnet.benchmark_clouds(tmp_path, ALL_KINDS, names=names)
    assert (cloud.shape, cloud.kind, cloud.made) == ("cup", "0.12 %", False)
    with pytest.raises(pcpnet.BenchmarkError, match=r"no pair mug\.xyz and mug\.normals"):
        list(pcpnet.benchmark_clouds(tmp_path, ALL_KINDS, names=["ball", "mug"]))


def test_arrays_of_npz_are_a_cloud_named_for_its_folder(pcpnet, tmp_path):
    folder = tmp_path / "bunny"
    folder.mkdir()
    points, normals = ball(30)
    np.savez(folder / "cloud.npz", xyz=points, normals=normals)
    (cloud,) = pcpnet.benchmark_clouds(folder, ["none"])
    assert cloud.shape == "bunny"
    np.testing.assert_array_equal(cloud.points, points)


def spoil(folder, fault):
    points, normals = ball(30)
    if fault == "no pair":
        np.savetxt(folder / "ball.xyz", points)
        return
    if fault == "rows":
        normals = normals[1:]
    if fault == "zero":
        normals[4:6] = 0
    if fault == "columns":
        points = points[:, :2]
    if fault == "nan":
        points[3, 1] = np.nan
    write_pair(folder, "ball", points, normals, rows=[30] if fault == "pidx" else None)
    if fault == "text":
        (folder / "ball.xyz").write_text("x y z\n")


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        ("no pair", "has no pair NAME.xyz and NAME.normals"),
        ("rows", "ball.xyz has 30 points, but 29 normals"),
        ("zero", "ball.normals has 2 normals of length zero"),
        ("columns", "ball.xyz needs three finite numbers in each line"),
        ("nan", "ball.xyz needs three finite numbers in each line"),
        ("pidx", "ball.pidx needs rows from 0 to 29"),
        ("text", "ball.xyz is no table of numbers"),
    ],
)
def test_a_fault_in_a_file_is_one_clear_line(bench, tmp_path, capsys, fault, message):
    spoil(tmp_path, fault)
    with pytest.raises(SystemExit) as end:
        bench.main(["pcpnet", str(tmp_path)])
    assert end.value.code == 2
    assert message in capsys.readouterr().err.splitlines()[-1]


def test_a_folder_that_is_not_there_is_named(bench, tmp_path, capsys):
    with pytest.raises(SystemExit):
        bench.main(["pcpnet", str(tmp_path / "nowhere")])
    assert "nowhere is no folder" in capsys.readouterr().err


def test_a_list_that_is_not_there_is_named(bench, tmp_path, capsys):
    with pytest.raises(SystemExit):
        bench.main(["pcpnet", str(tmp_path), "--list", str(tmp_path / "none.txt")])
    assert "none.txt" in capsys.readouterr().err.splitlines()[-1]


def test_a_small_shape_gets_a_line_for_each_kind_and_method(bench, tmp_path, capsys):
    write_pair(tmp_path, "ball", *ball(300))
    table = tmp_path / "out.csv"
    bench.main(["pcpnet", str(tmp_path), "--points", "100", "--threads", "1", "--csv", str(table)])
    with open(table, newline="", encoding="utf-8") as file:
        lines = list(csv.DictReader(file))
    rmse = {(line["method"], line["kind"]): float(line["rmse"]) for line in lines}
    names = {line["method"] for line in lines}
    assert {"PCA, k = 8", "jet, k = 50", "ours, default", "ours, auto", "ours, k = 112"} <= names
    assert len(rmse) == len(lines) == len(names) * len(ALL_KINDS)
    assert all(line["judged"] == "100" for line in lines if line["points"] == "300")
    # Quadrics know that a ball bends, planes do not know how large their neighborhoods may be.
    assert rmse["jet, k = 18", "none"] < rmse["PCA, k = 50", "none"] < 20
    assert rmse["PCA, k = 8", "1.2 %"] > rmse["PCA, k = 8", "none"]

    *_, last = capsys.readouterr().out.strip().splitlines()
    mean = np.mean([rmse["ours, auto", kind] for kind in ALL_KINDS])
    assert last.startswith("ours, auto")
    assert float(last.split()[-1]) == pytest.approx(mean, abs=0.006)


def test_averages_weigh_shapes_within_a_kind_and_then_kinds(bench, methods, capsys):
    def result(shape, kind, rmse):
        of_method = methods.Errors(rmse, 0, 0, 0, 0)
        return bench.Result(shape, kind, False, 9, 9, "PCA, k = 8", 8, of_method)

    results = [result("a", "none", 4), result("b", "none", 8), result("a", "stripes", 12)]
    bench.print_averages(results, ["none", "stripes"])
    assert capsys.readouterr().out.splitlines()[-1].split()[-3:] == ["6.00", "12.00", "9.00"]


def test_the_other_commands_still_run(bench, tmp_path, capsys):
    points, normals = ball(300)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    path = tmp_path / "cloud.npz"
    np.savez(path, xyz=points, normals=normals, edge_dist=points[:, 0] + 2)
    bench.main(["clouds", str(path), "--n-neighbors", "20", "--threads", "1"])
    assert "least squares" in capsys.readouterr().out


def test_a_rounded_box_has_faces_edges_and_corners(bench):
    points, normals, is_round = bench.rounded_box(20_000, 0.1, np.random.default_rng(0))
    np.testing.assert_allclose(np.abs(points).max(axis=0), 0.5)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1)
    inner = points - 0.1 * normals
    # On the cube of side 0.8 a face has one coordinate at its limit, an edge two, a corner three.
    at_limit = np.isclose(np.abs(inner), 0.4, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(at_limit, normals != 0)
    np.testing.assert_array_equal(at_limit.sum(axis=1) > 1, is_round)
    faces = (at_limit.sum(axis=1) == 1).mean()
    area = 6 * 0.8**2 + 6 * np.pi * 0.1 * 0.8 + 4 * np.pi * 0.1**2
    assert faces == pytest.approx(6 * 0.8**2 / area, abs=0.02)


def test_fillets_print_a_row_for_each_radius_and_noise(bench, capsys):
    bench.main(["fillets", "--size", "3000", "--n-neighbors", "20", "--threads", "1"])
    head, *rows = capsys.readouterr().out.splitlines()
    assert head.split()[-1] == "quadric"
    assert len(rows) == 12
    assert all(float(value) < 90 for row in rows for value in row.split()[-5:])
