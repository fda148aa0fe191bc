"""Normals by tiles equal those in memory, and what goes wrong has a clear outcome."""

import os
import shutil
import signal

import laspy
import numpy as np
import pytest
from numpy.testing import assert_array_equal
from sklearn.base import clone

from sklearn_mcmd import RobustNormalEstimator
from sklearn_mcmd.io import PointFileError, read_points, write_points
from sklearn_mcmd.runtime import _interrupts
from sklearn_mcmd.tiling import (
    Catalog,
    TilingError,
    _outputs,
    _run,
    _sweeps,
    process_files,
)
from sklearn_mcmd.tiling._result_files import normal_columns
from tiled import ESTIMATOR, divide, in_memory, is_killed, street

TILE = 5_000


def files_in(folder):
    return sorted(path.name for path in folder.iterdir())


@pytest.mark.parametrize("tile_size", [2_000, TILE, 50_000])
def test_the_output_is_that_of_memory_for_any_tile_size(street_file, tmp_path, tile_size):
    source, expected = street_file
    report = process_files(source, tmp_path / "out.laz", ESTIMATOR, tile_size=tile_size)
    assert (tmp_path / "out.laz").read_bytes() == expected.read_bytes()
    assert report.n_tiles >= 12_000 / tile_size
    assert files_in(tmp_path) == ["out.laz"]


def test_numbers_of_numpy_are_parameters_as_those_of_python(street_file, tmp_path):
    source, expected = street_file
    estimator = clone(ESTIMATOR).set_params(n_neighbors=np.uint8(ESTIMATOR.n_neighbors))
    process_files(source, tmp_path / "out.laz", estimator, tile_size=TILE)
    assert (tmp_path / "out.laz").read_bytes() == expected.read_bytes()


@pytest.mark.parametrize("cut", [0.3, 0.45, 0.7])
def test_the_output_does_not_depend_on_where_tiles_begin(street_file, tmp_path, cut):
    source, expected = street_file
    divide(source, tmp_path / "out.laz", ESTIMATOR, tile_size=TILE, cut=cut)
    assert (tmp_path / "out.laz").read_bytes() == expected.read_bytes()


def test_the_output_does_not_depend_on_the_number_of_threads(street_file, tmp_path, monkeypatch):
    source, expected = street_file
    plan = _run.plan_run(12_000, 8e9, 1, tile_size=TILE)._replace(n_threads=2)
    monkeypatch.setattr(_run, "plan_run", lambda *args, **kwargs: plan)
    process_files(source, tmp_path / "out.laz", ESTIMATOR)
    assert (tmp_path / "out.laz").read_bytes() == expected.read_bytes()


def test_the_output_does_not_depend_on_the_number_of_processes(street_file, tmp_path):
    source, expected = street_file
    report = process_files(source, tmp_path / "out.laz", ESTIMATOR, tile_size=TILE, n_jobs=2)
    assert report.n_workers == 2
    assert (tmp_path / "out.laz").read_bytes() == expected.read_bytes()


def test_ctrl_c_while_temporary_files_are_removed_comes_too_late(small_file, tmp_path, monkeypatch):
    def remove_late(folder, remove=_run.WorkFolder.remove):
        signal.raise_signal(signal.SIGINT)
        remove(folder)

    monkeypatch.setattr(_interrupts, "_program", "mcmd")
    monkeypatch.setattr(_run.WorkFolder, "remove", remove_late)
    process_files(
        small_file, tmp_path / "out.las", RobustNormalEstimator(method="pca", random_state=0)
    )
    assert files_in(tmp_path) == ["out.las", "small.las"]


def test_zeros_amid_large_coordinates_are_named_as_in_memory(tmp_path):
    xyz = np.r_[street(3_000).xyz, np.zeros((2, 3))]
    las = laspy.create()
    las.header.scales = [0.01] * 3
    las.xyz = xyz
    las.write(tmp_path / "in.las")
    with pytest.warns(UserWarning, match="2 of 3,002 points are 0, 0, 0 .* is point 3001") as told:
        process_files(tmp_path / "in.las", tmp_path / "out.las", ESTIMATOR, tile_size=2_000)
    assert [warning.filename for warning in told if "0, 0, 0" in str(warning.message)] == [__file__]


def test_single_precision_is_recognized_in_the_whole_cloud(tmp_path):
    rng = np.random.default_rng(0)
    xyz = rng.integers(0, 3000, (4_000, 3)) * [1, 1, 0.02] // 1 / 64
    write_points(tmp_path / "a.las", xyz)
    cloud = read_points(tmp_path / "a.las")
    assert_array_equal(cloud.xyz.astype(np.float32), cloud.xyz)
    fitted = clone(ESTIMATOR).fit(cloud.xyz.astype(np.float32))
    process_files(tmp_path / "a.las", tmp_path / "b.las", ESTIMATOR, tile_size=1_500)
    found = read_points(tmp_path / "b.las").attributes
    for name, values in zip(*columns_of(fitted), strict=True):
        assert_array_equal(found[name], values)


def columns_of(fitted):
    names, columns = normal_columns(fitted)
    return names, columns.T


def test_files_of_a_folder_are_one_cloud_and_have_an_output_each(tmp_path):
    whole = street(5_000)
    left = whole.xyz[:, 0] < np.median(whole.xyz[:, 0])
    (tmp_path / "in").mkdir()
    write_points(tmp_path / "in" / "a.laz", whole.subset(left))
    write_points(tmp_path / "in" / "b.las", whole.subset(~left))
    report = process_files(tmp_path / "in", tmp_path / "out", ESTIMATOR, tile_size=2_000)
    assert files_in(tmp_path / "out") == ["a.laz", "b.las"]
    parts = [read_points(tmp_path / "out" / name) for name in ("a.laz", "b.las")]
    inputs = [read_points(tmp_path / "in" / name) for name in ("a.laz", "b.las")]
    fitted = clone(ESTIMATOR).fit(np.vstack([p.xyz for p in inputs]))
    for name, values in zip(*columns_of(fitted), strict=True):
        assert_array_equal(np.concatenate([p.attributes[name] for p in parts]), values)
    for before, after in zip(inputs, parts, strict=True):
        assert_array_equal(before.attributes["intensity"], after.attributes["intensity"])
        assert_array_equal(before.metadata["las_points"]["X"], after.metadata["las_points"]["X"])
    removed = np.concatenate([p.attributes["removed_fraction"] for p in parts])
    assert report.removed_fraction == pytest.approx(removed.mean(dtype=float), rel=1e-9)


def test_mixed_point_formats_stay_as_they_are(tmp_path):
    (tmp_path / "in").mkdir()
    for seed, (name, colored) in enumerate({"a.las": False, "b.las": True}.items()):
        cloud = street(2_500, seed)
        colors = {c: np.zeros(len(cloud), np.uint16) for c in ("red", "green", "blue")}
        write_points(tmp_path / "in" / name, cloud.with_attributes(**(colors if colored else {})))
    process_files(tmp_path / "in", tmp_path / "out", ESTIMATOR, tile_size=2_000)
    formats = [
        laspy.open(tmp_path / "out" / name).header.point_format.id for name in ("a.las", "b.las")
    ]
    assert formats == [6, 7]


def test_the_same_points_in_two_files_count_once(tmp_path):
    (tmp_path / "in").mkdir()
    write_points(tmp_path / "in" / "a.las", street(3_000))
    shutil.copy(tmp_path / "in" / "a.las", tmp_path / "in" / "b.las")
    process_files(tmp_path / "in", tmp_path / "out", ESTIMATOR, tile_size=2_000)
    expected = in_memory(tmp_path / "in" / "a.las", tmp_path / "expected.las")
    # The step of rounding is the same too, since all values occur twice.
    for name in ("a.las", "b.las"):
        assert (tmp_path / "out" / name).read_bytes() == expected.read_bytes()


def test_bounds_in_the_header_do_not_matter(small_file, tmp_path):
    expected = in_memory(small_file, tmp_path / "expected.las")
    with open(small_file, "rb+") as file:
        file.seek(179)
        file.write(np.array([1.0, 0.0, 1.0, 0.0, 1.0, 0.0]).tobytes())
    process_files(small_file, tmp_path / "out.las", ESTIMATOR, tile_size=2_000)
    assert (tmp_path / "out.las").read_bytes() == expected.read_bytes()


def test_densities_may_differ_a_thousandfold(tmp_path):
    sparse, dense = street(3_000, 1).xyz, street(3_000, 2).xyz
    dense = np.round(dense.min(axis=0) + (dense - dense.min(axis=0)) / 30, 3)
    source = tmp_path / "uneven.las"
    write_points(source, np.vstack([sparse, dense]))
    expected = in_memory(source, tmp_path / "expected.las")
    process_files(source, tmp_path / "out.las", ESTIMATOR, tile_size=4_000)
    assert (tmp_path / "out.las").read_bytes() == expected.read_bytes()


def test_an_output_may_replace_its_input(small_file, tmp_path):
    expected = in_memory(small_file, tmp_path / "expected.las").read_bytes()
    process_files(small_file, small_file, ESTIMATOR, tile_size=2_000)
    assert small_file.read_bytes() == expected
    # Now there are columns of these names.
    process_files(small_file, small_file, ESTIMATOR, tile_size=2_500)
    assert small_file.read_bytes() == expected


# A run that kills itself: when all points are read, after two tiles, or at the first output.
RUN = """
import os, signal, sys
from sklearn_mcmd import RobustNormalEstimator
from sklearn_mcmd.tiling import _planes, _result_files, _run, process_files

source, target, place = sys.argv[1:]
work, done = _planes._fit_own, []

def die(*args):
    os.kill(os.getpid(), getattr(signal, "SIGKILL", signal.SIGTERM))

def two_tiles(*args, **params):
    done.append(work(*args, **params) if len(done) < 2 else die())
    return done[-1]

if place == "reading":
    _run.WorkFolder.finish_cells = die
elif place == "tiles":
    _planes._fit_own = two_tiles
else:
    _result_files.Results.take = die
process_files(source, target, RobustNormalEstimator(16, random_state=0), tile_size=1_500)
"""


@pytest.mark.parametrize(
    ("place", "n_resumed"),
    [
        pytest.param("reading", 0, marks=pytest.mark.slow),
        ("tiles", 2),
        pytest.param("writing", 4, marks=pytest.mark.slow),
    ],
)
def test_a_run_that_was_killed_goes_on(small_file, tmp_path, place, n_resumed):
    expected = in_memory(small_file, tmp_path / "expected.las").read_bytes()
    before, target = small_file.read_bytes(), tmp_path / "out.las"
    assert is_killed(RUN, small_file, target, place)
    assert not target.exists()
    report = process_files(small_file, target, ESTIMATOR, tile_size=1_500)
    assert (report.n_resumed, report.n_tiles) == (n_resumed, 4)
    assert target.read_bytes() == expected
    assert small_file.read_bytes() == before
    assert not (tmp_path / "out.las.tiles").exists()


def test_a_tile_that_fails_has_its_line_and_does_not_end_the_others(small_file, tmp_path, failing):
    target = tmp_path / "out.las"
    failing.add(1)
    with (
        pytest.warns(UserWarning, match=r"tile 1 failed \(x 36200\d.*\): MemoryError: too much of"),
        pytest.raises(TilingError, match=r"1 of 4 tiles failed; .*out\.las\.tiles, and"),
    ):
        process_files(small_file, target, ESTIMATOR, tile_size=2_000)
    assert files_in(tmp_path) == ["out.las.tiles", "small.las"]
    failing.clear()
    report = process_files(small_file, target, ESTIMATOR, tile_size=2_000)
    assert (report.n_resumed, report.n_tiles) == (3, 4)
    assert target.read_bytes() == in_memory(small_file, tmp_path / "e.las").read_bytes()


@pytest.mark.parametrize("change", ["parameters", "input", "restart"])
def test_other_parameters_or_inputs_begin_anew(small_file, tmp_path, failing, change):
    failing.add(1)
    with pytest.warns(match="tile 1 failed"), pytest.raises(TilingError):
        process_files(small_file, tmp_path / "out.las", ESTIMATOR, tile_size=2_000)
    failing.clear()
    k = 20 if change == "parameters" else 16
    if change == "input":
        os.utime(small_file, (1, 1))
    estimator = RobustNormalEstimator(k, random_state=0)
    report = process_files(
        small_file, tmp_path / "out.las", estimator, tile_size=2_000, restart=change == "restart"
    )
    assert report.n_resumed == 0
    expected = in_memory(small_file, tmp_path / "e.las", RobustNormalEstimator(k, random_state=0))
    assert (tmp_path / "out.las").read_bytes() == expected.read_bytes()


def test_an_input_that_vanishes_is_named(small_file, tmp_path):
    catalog = Catalog(small_file)
    small_file.rename(tmp_path / "elsewhere.las")
    with pytest.raises(PointFileError, match=r"small\.las: cannot be read: no such file"):
        process_files(catalog, tmp_path / "out.las", ESTIMATOR, tile_size=2_000)
    assert files_in(tmp_path) == ["elsewhere.las"]


@pytest.mark.parametrize("how", ["changes", "vanishes"])
def test_an_input_that_changes_during_the_run_is_noticed(small_file, tmp_path, monkeypatch, how):
    compute = _sweeps.compute_cells

    def change(*args):
        compute(*args)
        if not small_file.exists() or (tmp_path / "before.las").exists():
            return
        small_file.rename(tmp_path / "before.las")
        if how == "changes":
            write_points(small_file, street(5_000))

    monkeypatch.setattr(_sweeps, "compute_cells", change)
    message = r"small\.las: (has changed|cannot be read: no such file).*kept in .*out\.las\.tiles"
    with pytest.raises(TilingError, match=message):
        process_files(small_file, tmp_path / "out.las", ESTIMATOR, tile_size=2_000)
    assert not (tmp_path / "out.las").exists()
    monkeypatch.undo()
    (tmp_path / "before.las").replace(small_file)
    report = process_files(small_file, tmp_path / "out.las", ESTIMATOR, tile_size=2_000)
    assert report.n_resumed == report.n_tiles


def test_a_damaged_chunk_is_named_and_leaves_nothing(tmp_path):
    path = tmp_path / "damaged.laz"
    write_points(path, np.random.default_rng(0).uniform(size=(120_000, 3)))  # three chunks
    content = bytearray(path.read_bytes())
    third = len(content) // 3
    content[third : 2 * third] = bytes(third)
    path.write_bytes(content)
    with pytest.raises(PointFileError, match=r"damaged\.laz: .*damaged"):
        process_files(path, tmp_path / "out.laz", ESTIMATOR, tile_size=TILE)
    assert files_in(tmp_path) == ["damaged.laz"]
    assert path.read_bytes() == content


@pytest.mark.parametrize(
    ("target", "message"),
    [
        ("nowhere/out.las", "does not exist"),
        ("out.ply", r"\.las or \.laz only"),
        ("out.copc.laz", "COPC can be read"),
        (".", "is a folder"),
    ],
)
def test_a_target_that_cannot_be_is_refused_before_the_work(small_file, tmp_path, target, message):
    with pytest.raises(PointFileError, match=message):
        process_files(small_file, tmp_path / target, ESTIMATOR)
    assert files_in(tmp_path) == ["small.las"]


@pytest.mark.parametrize("name", ["out.ply", "out.TXT"])
def test_a_folder_is_not_named_as_a_file_of_another_format(small_file, tmp_path, name):
    with pytest.raises(PointFileError, match=r"become a folder, or one \.las or \.laz"):
        process_files(tmp_path, tmp_path / name, ESTIMATOR)
    assert files_in(tmp_path) == ["small.las"]


def test_outputs_that_were_written_before_are_not_written_again(tmp_path, monkeypatch):
    (tmp_path / "in").mkdir()
    for seed, name in enumerate(("a.las", "b.las")):
        write_points(tmp_path / "in" / name, street(2_500, seed))
    replacing, ready = _outputs.replacing, []

    def fail_at_second(target):
        ready.append(target.name)
        if len(ready) == 2:
            raise OSError(28, "No space left on device", str(target))
        return replacing(target)

    monkeypatch.setattr(_outputs, "replacing", fail_at_second)
    with pytest.raises(TilingError, match=r"No space left .*out\.tiles"):
        process_files(tmp_path / "in", tmp_path / "out", ESTIMATOR, tile_size=2_000)
    assert files_in(tmp_path / "out") == ["a.las"]
    report = process_files(tmp_path / "in", tmp_path / "out", ESTIMATOR, tile_size=2_000)
    assert ready == ["a.las", "b.las", "b.las"]
    assert report.n_resumed == report.n_tiles
    removed = [
        read_points(tmp_path / "out" / n).attributes["removed_fraction"] for n in ("a.las", "b.las")
    ]
    assert report.removed_fraction == pytest.approx(np.concatenate(removed).mean(dtype=float))


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write")
def test_a_read_only_output_is_refused_before_the_work(small_file, tmp_path):
    target = tmp_path / "out.las"
    target.touch(mode=0o400)
    with pytest.raises(PointFileError, match="write-protected"):
        process_files(small_file, target, ESTIMATOR)


def test_what_files_cannot_become_is_refused_before_the_work(tmp_path):
    (tmp_path / "x").mkdir()
    paths = [tmp_path / "a.las", tmp_path / "x" / "a.las"]
    for path in paths:
        write_points(path, street(50))
    (tmp_path / "out.ply").touch()
    for target, message in (
        ("out.ply", "several outputs need a folder"),
        ("out", "several files have this name"),
        ("a.las", "is one of the inputs"),
    ):
        with pytest.raises(PointFileError, match=message):
            process_files(paths, tmp_path / target, ESTIMATOR)
    assert files_in(tmp_path) == ["a.las", "out.ply", "x"]


def test_several_files_may_become_one(tmp_path):
    (tmp_path / "in").mkdir()
    paths = [tmp_path / "in" / "b.laz", tmp_path / "in" / "a.las"]
    for seed, path in enumerate(paths):
        write_points(path, street(2_500, seed))
    process_files(paths, tmp_path / "joined.laz", ESTIMATOR, tile_size=2_000)
    clouds = [read_points(path) for path in paths]
    fitted = clone(ESTIMATOR).fit(np.vstack([cloud.xyz for cloud in clouds]))
    joined = read_points(tmp_path / "joined.laz")
    for name, values in zip(*columns_of(fitted), strict=True):
        assert_array_equal(joined.attributes[name], values)
    assert_array_equal(joined.xyz, np.vstack([cloud.xyz for cloud in clouds]))
    intensity = np.concatenate([cloud.attributes["intensity"] for cloud in clouds])
    assert_array_equal(joined.attributes["intensity"], intensity)
    assert files_in(tmp_path) == ["in", "joined.laz"]


def waves(path, n_channels):
    """A street with wave packets, which are compressed well for one scanner channel only."""
    xyz, n = street(2_500).xyz, 2_500
    header = laspy.LasHeader(version="1.4", point_format=9)
    header.scales, header.offsets = [0.001] * 3, np.floor(xyz[0])
    las = laspy.LasData(header)
    las.xyz = xyz
    las.scanner_channel = np.arange(n) % n_channels
    las.points.array["wavepacket_offset"] = 60 + 256 * np.arange(n)
    las.points.array["wavepacket_size"] = 256
    las.write(path)
    return path


@pytest.mark.parametrize("name", ["out.las", "out.laz"])
def test_wave_packets_are_kept(tmp_path, name):
    source = waves(tmp_path / "a.las", 1)
    process_files(source, tmp_path / name, ESTIMATOR, tile_size=2_000)
    found, given = (laspy.read(path).points.array for path in (tmp_path / name, source))
    for dimension in given.dtype.names:
        assert_array_equal(found[dimension], given[dimension])


def test_wave_packets_that_would_change_are_refused(tmp_path):
    source = waves(tmp_path / "a.las", 2)
    with pytest.raises(TilingError, match="lazrs cannot compress these wave packets"):
        process_files(source, tmp_path / "out.laz", ESTIMATOR, tile_size=2_000)
    assert not (tmp_path / "out.laz").exists()
