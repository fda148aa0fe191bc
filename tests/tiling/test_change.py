"""What has moved by cells, beside memory."""

from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial import cKDTree

from sklearn_mcmd import CloudChange, RobustNormalEstimator
from sklearn_mcmd.io import PointCloud, PointFileError, read_points, write_points
from sklearn_mcmd.planes._indexed_cloud import IndexedCloud
from sklearn_mcmd.tiling import _change, process_files
from sklearn_mcmd.tiling._cells import Cells, CellWriter
from sklearn_mcmd.tiling._halo import HOPS, part_within
from tiled import but, goes_on, run_is_killed

N = 4_500
CHANGE = CloudChange(20, random_state=0)
EXACT = ("distance", "reason")  # by planes alone; all others ask noise that is alike nearby


def bay(rng, moved=0.0, n=N):
    """A floor and two walls, of which one moved, in national coordinates."""
    sides = [rng.uniform(0.02, 1, (n // 3, 3)) * [6, 4, 3] for _ in range(3)]
    for axis, side in enumerate(sides):
        side[:, axis] = moved * (axis == 0)
    xyz = np.vstack(sides) + rng.normal(0, 0.002, (n, 3)) + [362_000, 5_157_000, 100]
    return np.round(xyz, 4)


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder, rng = tmp_path_factory.mktemp("scans"), np.random.default_rng(0)
    for name, moved in (("before.laz", 0.0), ("after.las", 0.02)):
        write_points(folder / name, bay(rng, moved))
    return folder / "before.laz", folder / "after.las"


def in_memory(files, estimator=CHANGE):
    before, after = (read_points(path).xyz for path in files)
    return estimator.fit(before).compare(after)


@pytest.mark.parametrize(
    ("tile_size", "correction"), [(None, "none"), (None, "fdr"), (None, "sidak"), (2_000, "fdr")]
)
def test_distances_of_cells_are_those_of_memory(files, tmp_path, tile_size, correction):
    out, estimator = tmp_path / "out.las", but(CHANGE, correction=correction)
    report = process_files(files[0], out, estimator, second=files[1], tile_size=tile_size)
    written, expected = read_points(out).attributes, in_memory(files, estimator)
    assert (report.n_tiles == 1) == (tile_size is None)
    assert report.n_proven > 0.98 * N
    differ = np.abs(written["distance"] - expected.distance) > 1e-7
    assert np.count_nonzero(differ | (written["reason"] != expected.reason)) <= N - report.n_proven
    # Noise alike nearby is found among other pairs: one in cells, four thousand in memory.
    near = 1e-6 if tile_size is None else 0.15
    assert_allclose(report.change["alike"], expected.alike, rtol=near)
    for name in ("distance_error", "level_of_detection"):
        assert_allclose(written[name][~differ], getattr(expected, name)[~differ], rtol=near)
    if tile_size is None:  # p-values are rounded up
        told = expected.reason == 0
        ratio = (written["pvalue"][told] + 1e-30) / (expected.pvalue[told] + 1e-30)
        assert ratio.min() > 1 - 1e-4
        assert ratio.max() < 1 + 2**-11 + 1e-4
    same = written["significant"] == expected.significant
    assert np.mean(same) > (0.999 if tile_size is None else 0.97)
    assert report.change["n_significant"] == np.count_nonzero(written["significant"])
    counts = np.bincount(written["reason"], minlength=4)
    assert_array_equal(report.change["reasons"], counts)
    median = np.nanmedian(written["distance"])
    assert report.change["distance"] == pytest.approx(median, abs=1e-6)


def test_each_cloud_has_the_step_of_its_own_coordinates(tmp_path):
    rng, paths = np.random.default_rng(0), []
    for digits in (3, 4):
        floor = rng.uniform(0, 10, (4_000, 3)) * [1, 1, 0] + rng.normal(0, 5e-4, (4_000, 3))
        write_points(tmp_path / f"{digits}.las", np.round(floor, digits))
        paths.append(tmp_path / f"{digits}.las")
    report = process_files(paths[0], tmp_path / "out.las", CHANGE, second=paths[1], tile_size=2_500)
    assert report.n_proven == 4_000
    written = read_points(tmp_path / "out.las").attributes
    assert_allclose(written["distance"], in_memory(paths).distance, rtol=1e-6, atol=1e-9)


def test_walls_that_moved_are_named_by_thinned_clouds(files, tmp_path):
    estimator = but(CHANGE, registration="auto")
    report = process_files(
        files[0], tmp_path / "out.las", estimator, second=files[1], tile_size=2_000
    )
    expected = in_memory(files, estimator).bodies
    assert_allclose(report.change["bodies"]["offset"], expected.offset, atol=1e-5)
    assert_allclose(report.change["bodies"]["motion"], expected.motion, atol=1e-4)


def test_a_run_that_was_killed_goes_on_with_the_same_bytes(files, tmp_path):
    asked = {"second": str(files[1]), "tile_size": 2_000}
    target = tmp_path / "out.las"
    assert run_is_killed(files[0], target, "_change.measure", 1, CHANGE, **asked)
    report = goes_on(files[0], target, CHANGE, **asked)
    assert 0 < report.n_resumed < report.n_tiles
    process_files(files[0], tmp_path / "two.las", CHANGE, n_jobs=2, **asked)
    assert (tmp_path / "two.las").read_bytes() == target.read_bytes()


def test_a_second_cloud_that_changed_is_read_anew(files, tmp_path):
    after, target = tmp_path / "after.las", tmp_path / "out.las"
    after.write_bytes(files[1].read_bytes())
    asked = {"second": str(after), "tile_size": 2_000}
    assert run_is_killed(files[0], target, "_outputs._move", 0, CHANGE, **asked)
    write_points(after, bay(np.random.default_rng(5)))
    report = process_files(files[0], target, CHANGE, **asked)
    assert report.n_resumed == 0
    assert abs(report.change["distance"]) < 0.002


def test_a_hole_of_the_second_cloud_has_no_distance_and_folders_are_one_cloud(files, tmp_path):
    after = read_points(files[1]).xyz
    hole = (after[:, 0] > 362_003) & (after[:, 2] < 100.5)
    (tmp_path / "in").mkdir()
    for i, part in enumerate(np.array_split(after[~hole], 2)):
        write_points(tmp_path / "in" / f"{i}.laz", part)
    out = tmp_path / "out.las"
    process_files(files[0], out, CHANGE, second=tmp_path / "in", tile_size=2_000)
    before, reason = read_points(out).xyz, read_points(out).attributes["reason"]
    inside = (before[:, 0] > 362_003.6) & (before[:, 1] > 5_157_000.6) & (before[:, 2] < 100.2)
    assert inside.any()
    assert (reason[inside] == 1).all()


def test_what_cannot_be_compared_is_refused(files, tmp_path):
    out = tmp_path / "out.las"
    with pytest.raises(ValueError, match="second=None: CloudChange compares"):
        process_files(files[0], out, CHANGE)
    with pytest.raises(ValueError, match=r"second=.* has no meaning for RobustNormalEstimator"):
        process_files(files[0], out, RobustNormalEstimator(random_state=0), second=files[1])
    write_points(tmp_path / "far.las", read_points(files[1]).xyz + 1_000)
    with pytest.raises(
        ValueError, match=r"nowhere within a reach .* the second from 363000\.\d+, 515"
    ):
        process_files(files[0], out, CHANGE, second=tmp_path / "far.las")
    with pytest.raises(PointFileError, match=r"gone\.las"):
        process_files(files[0], out, CHANGE, second=tmp_path / "gone.las")
    write_points(tmp_path / "few.las", read_points(files[1]).xyz[:3])
    with pytest.raises(ValueError, match=r"n_samples=3 is too few"):
        process_files(files[0], out, CHANGE, second=tmp_path / "few.las")
    assert not out.exists()
    assert not list(tmp_path.glob("*.tiles"))


def test_no_output_replaces_the_second_cloud(files, tmp_path):
    (tmp_path / "in").mkdir()
    for source, name in zip(files, ("in/a.las", "a.las"), strict=True):
        write_points(tmp_path / name, read_points(source))
    after, content = tmp_path / "a.las", (tmp_path / "a.las").read_bytes()
    for source, target, second in (
        (tmp_path / "in", tmp_path, after),  # whose outputs have the names of the inputs
        (files[0], after, tmp_path),
    ):
        with pytest.raises(PointFileError, match=r"a\.las: is of the second cloud"):
            process_files(source, target, CHANGE, second=second)
    assert after.read_bytes() == content


@pytest.mark.filterwarnings("ignore:.* far sparser|.* of the core points")
def test_a_stray_point_takes_no_large_part_of_the_second_cloud(tmp_path, monkeypatch):
    rng, sizes = np.random.default_rng(0), []
    before, after = (
        rng.uniform(-half, half, (n, 3)) * [1, 1, 1e-3] for n, half in ((1_500, 1), (9_000, 40))
    )
    before[:2, :2] = [[-35, -35], [35, 35]]
    for name, xyz in (("before.las", before), ("after.las", after)):
        write_points(tmp_path / name, xyz)

    def counted(*args):
        sizes.append(len((part := part_within(*args)).rows))
        return part

    monkeypatch.setattr(_change, "part_within", counted)
    asked = {"second": tmp_path / "after.las", "tile_size": 250}
    report = process_files(tmp_path / "before.las", tmp_path / "out.las", CHANGE, **asked)
    assert max(sizes) < 3_000
    assert report.n_proven < 1_500
    assert list(read_points(tmp_path / "out.las").attributes["reason"][:2]) == [2, 2]


def test_copies_and_sparse_clouds_are_warned_of(files, tmp_path):
    write_points(tmp_path / "sparse.las", PointCloud(read_points(files[1]).xyz[::40]))
    far, nothing = "second cloud is far sparser", "% of the core points have nothing"
    with pytest.warns(UserWarning, match=far), pytest.warns(UserWarning, match=nothing):
        process_files(files[0], tmp_path / "a.las", CHANGE, second=tmp_path / "sparse.las")
    with pytest.warns(UserWarning, match="Both clouds are equal"):
        process_files(
            files[0], tmp_path / "a.las", CHANGE, second=files[0], tile_size=2_000, restart=True
        )


def test_a_point_is_proven_only_if_its_rings_in_both_clouds_are_in_the_part(tmp_path):
    """However few points of the second cloud are asked."""
    X, k = bay(np.random.default_rng(1), n=30_000), 8
    parts = []
    for capacity in (len(X), 10_000):  # the first cloud is in one cell
        (folder := tmp_path / str(capacity)).mkdir()
        writer = CellWriter(folder, capacity)
        writer.add(X, np.arange(len(X)))
        writer.close()
        parts.append(part_within(Cells(folder), 0, 0.02))
    near, second = cKDTree(X).query(X, k)[1], parts[1]
    known = np.isin(near, second.rows).all(axis=1)
    proven = known
    for _ in range(HOPS - 1):
        proven = known & proven[near].all(axis=1)
    beside = second.own & (second.depth > 0.15) & (second.depth < 0.3)  # the border, not at it
    others = np.resize(np.flatnonzero(beside), len(X))
    told = SimpleNamespace(others=others, reason=np.zeros(len(X), int))
    n_proven = _change.count_proven(parts, (k, k), told, 1)
    assert n_proven <= np.count_nonzero(proven[second.rows[others]])
    of_all = np.zeros(len(second.rows), bool)
    of_all[second.own], _ = second.proven(IndexedCloud.of(second.xyz), k, HOPS, 1)
    assert n_proven == np.count_nonzero(of_all[others]) > 0.3 * len(X)
