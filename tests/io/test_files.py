"""Files in, files out: nothing lost, nothing half-written, one clear line when it fails."""

import errno
import os
import re
import stat
import warnings
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.testing import assert_array_equal

from scenes import REAL_CLOUDS
from sklearn_mcmd.io import PointCloud, PointFileError, _formats, read_points, write_points
from sklearn_mcmd.io._formats import ALL, format_of, supported_extensions

for library in ("laspy", "lazrs", "plyfile", "pypcd4", "pye57"):
    pytest.importorskip(library)

WRITTEN = supported_extensions(written=True)
FLOAT64_EXACT = [
    e for e in WRITTEN if format_of(f"a{e}").results == ALL and not format_of(f"a{e}").tiles
]


@pytest.mark.parametrize("extension", FLOAT64_EXACT)
@settings(max_examples=25)
@given(
    xyz=hnp.arrays(
        np.float64,
        st.tuples(st.integers(1, 6), st.just(3)),
        elements=st.floats(allow_nan=False, allow_infinity=False),
    )
)
@pytest.mark.filterwarnings("ignore:.*no returns", "ignore:.*degrees")  # of any numbers
def test_every_float64_survives_formats_that_can_hold_it(tmp_path, extension, xyz):
    write_points(tmp_path / f"a{extension}", xyz)
    assert_array_equal(read_points(tmp_path / f"a{extension}").xyz, xyz)


@pytest.mark.parametrize("extension", [".las", ".ply", ".pcd", ".csv"])
def test_tables_become_numbered_columns_and_normals_get_their_axes(tmp_path, extension):
    table = np.arange(12.0).reshape(4, 3)
    cloud = PointCloud(table).with_attributes(normals=table, eigenvalues=-table[:, :2])
    write_points(tmp_path / f"a{extension}", cloud)
    back = read_points(tmp_path / f"a{extension}").attributes
    assert_array_equal(back["normal_z"], table[:, 2])
    assert_array_equal(back["eigenvalues_1"], -table[:, 1])


NAMES = ["a b", "-dash", "%s%d", ".hidden", "üñ 点\u2028", "quote'", "x" * 251]
NAMES += ["new\nline", 'quote"', "\x1b[31mred", "\udcff", "<script>", "*?"] * (os.name == "posix")


@pytest.mark.parametrize("extension", WRITTEN)
def test_files_of_any_name_in_any_case_are_read_and_written_over(tmp_path, cloud, extension):
    paths = [tmp_path / str(i) / f"{name}{extension}"[-255:] for i, name in enumerate(NAMES)]
    for path in (*paths, tmp_path / "case" / f"A{extension.upper()}"):
        path.parent.mkdir()
        write_points(path, cloud.xyz)
        first = read_points(path)
        write_points(path, first)
        assert_array_equal(read_points(path).xyz, first.xyz)
        assert len(first) == len(cloud)
        assert os.listdir(path.parent) == [path.name]


@pytest.mark.parametrize("extension", [".las", ".ply", ".csv"])
def test_of_two_writers_each_leaves_a_whole_file(tmp_path, extension):
    path, clouds = tmp_path / f"a{extension}", (np.zeros((1_000, 3)), np.ones((3_000, 3)))
    write_points(path, clouds[0])
    read = set()
    with ThreadPoolExecutor(2) as pool:
        writers = [pool.submit(write_points, path, clouds[i % 2]) for i in range(40)]
        while not all(writer.done() for writer in writers):
            read.add((len(cloud := read_points(path)), cloud.xyz.min(), cloud.xyz.max()))
    assert read == {(1_000, 0, 0), (3_000, 1, 1)}
    assert not any(writer.exception() for writer in writers)
    assert os.listdir(tmp_path) == [path.name]


# ---- output that cannot be ---------------------------------------------------------------

ONES = np.ones(3)


@pytest.mark.parametrize(
    ("extension", "attributes", "message"),
    [
        (".las", {"a" * 33: ONES}, "longer than 32 bytes"),
        (".npz", {"file": ONES}, "'file' is reserved"),
        (".npz", {"a": np.array([None] * 3)}, "that hold Python objects cannot be stored"),
        (".csv", {"a\nb": ONES}, r"'a\\nb' has several lines"),
        (".las", {"a": np.array(list("abc"))}, "'a' of dtype <U1 cannot be stored in LAS"),
        (".ply", {"a": np.full(3, 2**60 + 1)}, "'a' of dtype int64 cannot be stored in PLY"),
        (".pcd", {"a": ONES * 1j}, "'a' of dtype complex128 cannot be stored in PCD"),
        (".las", {"normals": np.eye(3), "normal_x": ONES}, "two attributes .* as 'normal_x'"),
    ],
)
def test_attributes_that_a_format_cannot_hold_are_named(tmp_path, extension, attributes, message):
    path = tmp_path / f"a{extension}"
    with pytest.raises(PointFileError, match=message) as error:
        write_points(path, PointCloud(np.eye(3), attributes))
    assert str(error.value).startswith(f"{path}: ")
    assert "\n" not in str(error.value)
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize(
    ("name", "cloud", "options", "message"),
    [
        ("no/a.ply", np.eye(3), {}, r"the folder .*no does not exist"),
        ("folder.ply", np.eye(3), {}, "is a folder"),
        ("a.ply", np.empty((0, 3)), {}, "no points"),
        ("a.ply", np.full((2, 3), np.nan), {}, "NaN or infinity"),
        ("a.ply", np.eye(3), {"noise": [0, 1, 0]}, r"must be 0, 7 \(low\) or 18"),
        ("a.ply", np.eye(3), {"noise": [7.0, 0, 0]}, "noise must be a mask, or classes"),
        ("a.ply", np.eye(3), {"noise": [True]}, r"classes, \(3,\)"),
        ("x" * 260 + ".npy", np.eye(3), {}, "cannot be written: file name too long"),
    ],
)
def test_output_that_makes_no_sense_is_refused(tmp_path, name, cloud, options, message):
    (tmp_path / "folder.ply").mkdir()
    with pytest.raises(ValueError, match=message):
        write_points(tmp_path / name, cloud, **options)
    assert os.listdir(tmp_path) == ["folder.ply"]


def test_a_folder_that_cannot_be_written_to_is_named(tmp_path, monkeypatch):
    def refuse(self, **kwargs):
        raise OSError(30, "Read-only file system")

    for name in ("touch", "unlink"):
        monkeypatch.setattr(f"pathlib.Path.{name}", refuse)
    message = r"a\.ply: cannot be written: read-only file system; check the permissions of"
    with pytest.raises(PointFileError, match=message):
        write_points(tmp_path / "a.ply", np.eye(3))


@pytest.mark.parametrize("extension", WRITTEN)
def test_a_file_for_which_there_is_no_room_is_named(tmp_path, extension):
    resource = pytest.importorskip("resource")
    path = tmp_path / f"a{extension}"
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (8192, before[1]))  # as full as a disk can be
    try:
        with pytest.raises(PointFileError, match=r"file too large|the disk may be full") as error:
            write_points(path, np.random.default_rng(0).random((20_000, 3)))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert str(error.value).startswith(f"{path}: ")
    assert os.listdir(tmp_path) == []


class Ending(BaseException):
    """What no error handling is asked about."""


@pytest.mark.parametrize("old", ["1 2 3\n", None])
@pytest.mark.parametrize(
    "error", [RuntimeError("boom"), OSError(28, "No space left"), KeyboardInterrupt(), Ending()]
)
def test_a_failure_midway_leaves_the_old_file_and_nothing_else(tmp_path, monkeypatch, error, old):
    path = tmp_path / "a.xyz"
    if old is not None:
        path.write_text(old)

    def writer(path, cloud):
        path.write_text("half of it")
        raise error

    failing = format_of("a.xyz")._replace(write=writer)
    monkeypatch.setitem(_formats._BY_EXTENSION, ".xyz", failing)
    words = "(?i)cannot be written: (boom|no space left)" if isinstance(error, Exception) else None
    with pytest.raises(PointFileError if words else type(error), match=words):
        write_points(path, np.eye(3))
    assert {p.name: p.read_text() for p in tmp_path.iterdir()} == ({"a.xyz": old} if old else {})


@pytest.mark.skipif(os.name != "posix", reason="permission bits and links of POSIX")
def test_a_file_is_on_the_disk_before_it_takes_its_name_and_so_is_the_name_then(
    tmp_path, monkeypatch
):
    target, seen, rename = tmp_path / "a.xyz", [], os.replace

    def sync(descriptor):
        is_folder = stat.S_ISDIR(os.fstat(descriptor).st_mode)
        seen.append("names" if is_folder else os.pread(descriptor, 99, 0))

    monkeypatch.setattr(os, "fsync", sync)
    monkeypatch.setattr(os, "replace", lambda *paths: seen.append("renamed") or rename(*paths))
    write_points(target, [[0, 0, 0]])
    assert seen == [target.read_bytes(), "renamed", "names"][: 3 if os.name == "posix" else 2]


def test_a_disk_that_cannot_sync_names_is_no_error(tmp_path, monkeypatch):
    def sync(descriptor):
        if stat.S_ISDIR(os.fstat(descriptor).st_mode):
            raise OSError(errno.EINVAL, "Invalid argument")

    monkeypatch.setattr(os, "fsync", sync)
    write_points(tmp_path / "a.xyz", [[0, 0, 0]])
    assert [path.name for path in tmp_path.iterdir()] == ["a.xyz"]


def test_a_replaced_file_keeps_its_permissions_and_a_link_its_target(tmp_path):
    path = tmp_path / "a.xyz"
    path.write_text("1 2 3\n")
    path.chmod(0o640)
    (tmp_path / "link.xyz").symlink_to(path)
    write_points(tmp_path / "link.xyz", np.eye(3))
    assert (tmp_path / "link.xyz").is_symlink()
    assert path.stat().st_mode & 0o777 == 0o640
    assert len(read_points(path)) == 3


# ---- clouds ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda c: c.subset(np.ones(3, dtype=bool)), "mask must have shape"),
        (lambda c: c.with_attributes(score=np.ones(3)), "needs 40 entries"),
        (lambda c: c.with_attributes(x=np.ones(40)), "is for coordinates"),
        (lambda c: PointCloud(np.ones((4, 2))), r"of \(4, 2\)"),
        (lambda c: PointCloud([["a", "b", "c"]]), "must be numbers"),
    ],
)
def test_clouds_that_make_no_sense_are_refused(cloud, call, message):
    with pytest.raises(ValueError, match=message):
        call(cloud)


@pytest.mark.parametrize("folder", REAL_CLOUDS)
def test_real_files_hold_as_many_points_as_their_notes_say(shared_data, folder):
    notes = (shared_data / folder / "INFO.md").read_text(encoding="utf-8")
    n_points = int(re.search(r"- points: (\d+)", notes)[1])
    paths = (shared_data / folder).iterdir()
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", ".*are 0, 0, 0.*left out")
        clouds = [read_points(p) for p in paths if p.suffix.lower() in supported_extensions()]
    assert {len(cloud) + cloud.n_dropped for cloud in clouds} == {n_points}
