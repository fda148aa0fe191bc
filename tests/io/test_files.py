"""Files in, files out: nothing lost, nothing half-written, one clear line when it fails."""

import os
import re
import sys
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
from sklearn_mcmd.io._text import read_text

pytest.importorskip("laspy")
pytest.importorskip("lazrs")
pytest.importorskip("plyfile")
pytest.importorskip("pypcd4")
pytest.importorskip("pye57")

WRITTEN = supported_extensions(written=True)
FLOAT64_EXACT = [
    e for e in WRITTEN if format_of(f"a{e}").results == ALL and not format_of(f"a{e}").tiles
]
NO_TEXT = [e for e in WRITTEN if format_of(f"a{e}").read is not read_text]
# XYZN and XYZRGB say so where they have nothing but coordinates.
bare = pytest.mark.filterwarnings("ignore:.*few programs read")


# ---- round trips -----------------------------------------------------------------------


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


@pytest.mark.parametrize("extension", [*FLOAT64_EXACT[:-1], ".las", ".laz"])
def test_results_come_back_under_their_names_with_the_same_values(tmp_path, cloud, extension):
    write_points(tmp_path / f"a{extension}", cloud)
    back = read_points(tmp_path / f"a{extension}")
    for name, values in cloud.attributes.items():
        assert_array_equal(back.attributes[name].astype(values.dtype), values, err_msg=name)


@pytest.mark.parametrize("extension", [".las", ".ply", ".pcd", ".csv"])
def test_tables_become_numbered_columns_and_normals_get_their_axes(tmp_path, extension):
    table = np.arange(12.0).reshape(4, 3)
    cloud = PointCloud(table).with_attributes(normals=table, eigenvalues=-table[:, :2])
    write_points(tmp_path / f"a{extension}", cloud)
    back = read_points(tmp_path / f"a{extension}").attributes
    assert_array_equal(back["normal_z"], table[:, 2])
    assert_array_equal(back["eigenvalues_1"], -table[:, 1])


def test_two_attributes_for_one_column_are_refused(tmp_path):
    cloud = PointCloud(np.eye(3)).with_attributes(normals=np.eye(3), normal_x=np.ones(3))
    with pytest.raises(PointFileError, match="two attributes would both be written as 'normal_x'"):
        write_points(tmp_path / "a.las", cloud)


@pytest.mark.parametrize("extension", FLOAT64_EXACT)
def test_noise_is_a_column_outlier_in_other_formats(tmp_path, cloud, extension):
    noise = np.arange(40) % 4 == 0
    write_points(tmp_path / f"a{extension}", PointCloud(cloud.xyz), noise=noise)
    assert_array_equal(read_points(tmp_path / f"a{extension}").attributes["outlier"], noise)


@bare
@pytest.mark.parametrize("extension", WRITTEN)
def test_extensions_are_known_in_any_case(tmp_path, cloud, extension):
    path = tmp_path / f"A{extension.upper()}"
    write_points(path, cloud.xyz)
    assert len(read_points(path)) == len(cloud)
    assert os.listdir(tmp_path) == [path.name]


@bare
@pytest.mark.parametrize("extension", WRITTEN)
def test_input_and_output_may_be_the_same_file(tmp_path, cloud, extension):
    path = tmp_path / f"a{extension}"
    write_points(path, cloud.xyz)
    first = read_points(path)
    write_points(path, first)
    assert_array_equal(read_points(path).xyz, first.xyz)


ODD = ["a b", "-dash", "%s%d", ".hidden", "üñ 点\u2028", "quote'", "x" * 251]
ODD_OF_POSIX = ["new\nline", 'quote"', "\x1b[31mred", "\udcff", "<script>alert(1)<script>", "*?"]


@bare
@pytest.mark.parametrize("extension", WRITTEN)
def test_odd_names_of_files_are_names_like_others(tmp_path, cloud, extension):
    for number, name in enumerate(ODD + ODD_OF_POSIX * (os.name == "posix")):
        path = tmp_path / str(number) / f"{name}{extension}"[-255:]
        path.parent.mkdir()
        write_points(path, cloud.xyz)
        assert len(read_points(path)) == len(cloud)
        assert os.listdir(path.parent) == [path.name]


@pytest.mark.parametrize("extension", [".npy", ".npz"])
def test_no_pickle_is_loaded(tmp_path, extension):
    loaded = tmp_path / "loaded"

    class Trap:
        def __reduce__(self):
            return os.mkdir, (str(loaded),)

    save = np.save if extension == ".npy" else np.savez
    save(tmp_path / f"a{extension}", np.array([[Trap()] * 3]))
    with pytest.raises(PointFileError, match="pickled objects, which are never loaded") as error:
        read_points(tmp_path / f"a{extension}")
    assert_one_clear_line(error, tmp_path / f"a{extension}")
    assert not loaded.exists()


@pytest.mark.parametrize("extension", [".las", ".ply", ".csv"])
def test_of_two_writers_each_leaves_a_whole_file(tmp_path, extension):
    path, clouds = tmp_path / f"a{extension}", (np.zeros((1_000, 3)), np.ones((3_000, 3)))
    write_points(path, clouds[0])
    found = set()
    with ThreadPoolExecutor(2) as pool:
        writers = [pool.submit(write_points, path, clouds[i % 2]) for i in range(40)]
        while not all(writer.done() for writer in writers):
            found.add((len(cloud := read_points(path)), cloud.xyz.min(), cloud.xyz.max()))
    assert found == {(1_000, 0, 0), (3_000, 1, 1)}
    assert not any(writer.exception() for writer in writers)
    assert os.listdir(tmp_path) == [path.name]


# ---- bad input -------------------------------------------------------------------------

BAD_TEXTS = {
    "words.xyz": ("hello\nworld\n", "holds no row of numbers"),
    "dates.csv": ("day,hour,who\n" + "May 1,one,A\n" * 12, "no x, y, z among the columns day, h"),
    "two.csv": ("1,2\n3,4\n", "line 1 has 2 column"),
    "na.csv": ("1,2,NA\n4,5,6\n", "line 1: 'NA' is not a number; write nan for a point that"),
    "stars.csv": ("***,2,3\n4,5,6\n", r"line 1: '\*\*\*' is not a number"),
    "below.csv": ("x,y,z\nNA,NA,NA\n4,5,6\n", "line 2: 'NA' is not a number"),
    "gap.csv": ("x,y,z\n1,2,3\n4,,6\n", "line 3: '' is not a number"),
    "underscore.csv": ("1,2,3\n4,5_0,6\n", "line 2: '5_0' is not a number"),
    "commas.xyz": ("1,5 2,5 3,5\n", "decimal commas"),
    "count.xyz": ("3\n1 2 3\n4 5 6\n", "line 1 promises 3 points, found 2"),
    "ragged.xyz": ("1 2 3\n\n4 5\n", "line 3 has 2 columns, line 1 has 3"),
    "late.xyz": ("1 2 3\n4 b 6\n", "line 2: 'b' is not a number"),
    "grid.asc": ("ncols 2\nnrows 1\ncellsize 5\n3 4\n", "is an ESRI ASCII grid: convert it to"),
    "twice.csv": ("x,y,z,a,a\n1,2,3,4,5\n", "two columns are named 'a'"),
    "flat.csv": ("x,y,t\n1,2,3\n", "no z among the columns x, y, t: say which they are"),
    "short.csv": ("x,y,z,a\n1,2,3\n", "names 4 columns, line 2 has 3"),
    "header.csv": ("x,y,z\n", "no points"),
    "nan.xyz": ("nan 1 2\n", r"no points with finite coordinates \(1 dropped\)"),
    "text.ply": ("hello\n", "damaged or is of another format"),
    "text.pcd": ("hello\n", "not a PCD file"),
    "text.laz": ("hello\n", "not a LAS/LAZ file"),
    "text.npy": ("hello\n", "NumPy's format NPY"),
    "text.npz": ("hello\n", "NumPy's format NPZ"),
    "text.e57": ("hello\n", "damaged or is of another format"),
    "empty.ply": ("ply\nformat ascii 1.0\nelement face 0\nend_header\n", "no element 'vertex'"),
    "a.foo": ("1 2 3\n", "unknown extension '.foo'; known are ."),
    "nothing": ("1 2 3\n", "no extension; known are"),
}


def assert_one_clear_line(error, path):
    message = str(error.value)
    assert message.startswith(f"{path}: ")
    assert "\n" not in message
    assert "allow_pickle=" not in message


@pytest.mark.parametrize("name", BAD_TEXTS)
def test_files_that_are_wrong_get_one_clear_line(tmp_path, name):
    text, message = BAD_TEXTS[name]
    (tmp_path / name).write_text(text)
    with pytest.raises(PointFileError, match=message) as error:
        read_points(tmp_path / name)
    assert_one_clear_line(error, tmp_path / name)


@pytest.mark.parametrize("extension", supported_extensions())
@pytest.mark.parametrize("content", [b"", np.random.default_rng(0).bytes(4000), b"\0" * 4000])
def test_junk_and_empty_files_get_one_clear_line(tmp_path, extension, content):
    path = tmp_path / f"a{extension}"
    path.write_bytes(content)
    with pytest.raises(PointFileError, match=None if content else "is empty") as error:
        read_points(path)
    assert_one_clear_line(error, path)


@pytest.mark.parametrize("part", [0.2, 0.6, 0.95])
@pytest.mark.parametrize("extension", NO_TEXT)
def test_truncated_files_get_one_clear_line(tmp_path, extension, part):
    path = tmp_path / f"a{extension}"
    write_points(path, np.random.default_rng(0).random((200, 3)))
    whole = path.read_bytes()
    path.write_bytes(whole[: int(part * len(whole))])
    with pytest.raises(PointFileError) as error:
        read_points(path)
    assert_one_clear_line(error, path)


@pytest.mark.parametrize("extension", NO_TEXT)
def test_damaged_headers_never_raise_anything_but_the_one_error(tmp_path, extension):
    path = tmp_path / f"a{extension}"
    write_points(path, np.random.default_rng(0).random((50, 3)))
    whole = path.read_bytes()
    rng = np.random.default_rng(1)
    refused = 0
    for _ in range(30):
        content = bytearray(whole)
        for position in rng.integers(0, min(len(whole), 400), 4):
            content[position] = rng.integers(256)
        path.write_bytes(content)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                read_points(path)
        except PointFileError:
            refused += 1
    assert refused > 0


def test_missing_files_and_folders_are_named(tmp_path):
    with pytest.raises(PointFileError, match=r"a\.las: no such file"):
        read_points(tmp_path / "a.las")
    with pytest.raises(PointFileError, match="is a folder"):
        read_points(tmp_path)


@pytest.mark.parametrize(
    ("extension", "module", "requirement"),
    [
        (".las", "laspy", "laspy[lazrs]>="),
        (".laz", "lazrs", "laspy[lazrs]>="),
        (".ply", "plyfile", "plyfile>="),
        (".pcd", "pypcd4", "pypcd4>="),
        (".e57", "pye57", "pye57>="),
    ],
)
def test_a_missing_library_is_named_with_the_command_that_installs_it(
    tmp_path, monkeypatch, extension, module, requirement
):
    path = tmp_path / f"a{extension}"
    write_points(path, np.eye(3))
    before = path.read_bytes()
    monkeypatch.setitem(sys.modules, module, None)
    message = re.escape(f'{module}, which is not installed: pip install "{requirement}')
    with pytest.raises(PointFileError, match=message):
        read_points(path)
    with pytest.raises(PointFileError, match=message):
        write_points(path, np.eye(3))
    assert path.read_bytes() == before


# ---- bad output ------------------------------------------------------------------------


def names_that_do_not_fit():
    ones = np.ones(3)
    return [
        (".las", {"a" * 33: ones}, "longer than the 32 bytes"),
        (".ply", {"a b": ones}, "'a b'"),
        (".pcd", {"a b": ones}, "'a b' cannot be stored in PCD"),
        (".npz", {"file": ones}, "'file' is reserved"),
        (".las", {"a": np.array(list("abc"))}, "'a' of dtype <U1 cannot be stored in LAS"),
        (".ply", {"a": np.full(3, 2**60 + 1)}, "'a' of dtype int64 cannot be stored in PLY"),
        (".pcd", {"a": ones * 1j}, "'a' of dtype complex128 cannot be stored in PCD"),
        (".csv", {"a": ones * 1j}, "'a' of dtype complex128 cannot be stored"),
    ]


@pytest.mark.parametrize(("extension", "attributes", "message"), names_that_do_not_fit())
def test_attributes_that_a_format_cannot_hold_are_named(tmp_path, extension, attributes, message):
    path = tmp_path / f"a{extension}"
    with pytest.raises(PointFileError, match=message) as error:
        write_points(path, PointCloud(np.eye(3), attributes))
    assert_one_clear_line(error, path)
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize(
    ("name", "cloud", "options", "message"),
    [
        ("no/a.ply", np.eye(3), {}, r"the folder .*no does not exist"),
        ("folder.ply", np.eye(3), {}, "is a folder"),
        ("a.foo", np.eye(3), {}, "unknown extension"),
        ("a.ply", np.empty((0, 3)), {}, "no points"),
        ("a.ply", np.full((2, 3), np.nan), {}, "NaN or infinity"),
        ("a.ply", np.eye(3), {"encoding": "binary_compressed"}, "known: ascii, binary"),
        ("a.las", np.eye(3), {"encoding": "ascii"}, "unknown for LAS and LAZ; known: only None"),
        ("a.ply", np.eye(3), {"noise": [0, 1, 0]}, r"must be 0, 7 \(low noise\) or 18"),
        ("a.ply", np.eye(3), {"noise": [True]}, r"shape \(3,\)"),
    ],
)
def test_output_that_makes_no_sense_is_refused(tmp_path, name, cloud, options, message):
    (tmp_path / "folder.ply").mkdir()
    with pytest.raises(ValueError, match=message):
        write_points(tmp_path / name, cloud, **options)
    assert os.listdir(tmp_path) == ["folder.ply"]


@pytest.mark.skipif(
    not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write everywhere"
)
def test_a_folder_without_permission_is_named(tmp_path):
    tmp_path.chmod(0o500)
    with pytest.raises(PointFileError, match="check the permissions"):
        write_points(tmp_path / "a.ply", np.eye(3))
    tmp_path.chmod(0o700)


def test_permission_errors_of_the_system_become_one_clear_line(tmp_path, monkeypatch):
    def touch(self, **kwargs):
        raise PermissionError(13, "Permission denied", str(self))

    monkeypatch.setattr("pathlib.Path.touch", touch)
    with pytest.raises(PointFileError, match="permission denied; check the permissions of"):
        write_points(tmp_path / "a.ply", np.eye(3))


@bare
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
    assert_one_clear_line(error, path)
    assert os.listdir(tmp_path) == []


def test_a_folder_that_can_only_be_read_is_named(tmp_path, monkeypatch):
    def refuse(self, **kwargs):
        raise OSError(30, "Read-only file system", str(self))

    for name in ("touch", "unlink"):
        monkeypatch.setattr(f"pathlib.Path.{name}", refuse)
    with pytest.raises(PointFileError, match="read-only file system; check the perm") as error:
        write_points(tmp_path / "a.ply", np.eye(3))
    assert_one_clear_line(error, tmp_path / "a.ply")


def test_a_name_that_is_too_long_is_named(tmp_path):
    path = tmp_path / ("x" * 260 + ".npy")
    with pytest.raises(PointFileError, match="cannot be written: file name too long") as error:
        write_points(path, np.eye(3))
    assert_one_clear_line(error, path)
    with pytest.raises(PointFileError, match="cannot be read: file name too long") as error:
        read_points(path)
    assert_one_clear_line(error, path)


def fail_midway(monkeypatch, error):
    """Let the writing of XYZ end in an error."""

    def writer(path, cloud):
        path.write_text("half of it")
        raise error

    failing = format_of("a.xyz")._replace(write=writer)
    monkeypatch.setitem(_formats._BY_EXTENSION, ".xyz", failing)


@pytest.mark.parametrize("error", [RuntimeError("boom"), OSError(28, "No space left on device")])
def test_a_failure_midway_leaves_the_old_file_and_nothing_else(tmp_path, monkeypatch, error):
    path = tmp_path / "a.xyz"
    path.write_text("1 2 3\n")
    fail_midway(monkeypatch, error)
    with pytest.raises(PointFileError, match=r"cannot be written: (boom|no space left)"):
        write_points(path, np.eye(3))
    assert path.read_text() == "1 2 3\n"
    assert os.listdir(tmp_path) == ["a.xyz"]


class Ending(BaseException):
    """What no error handling is asked about."""


@pytest.mark.parametrize("kind", [KeyboardInterrupt, SystemExit, Ending])
def test_an_interruption_midway_leaves_the_old_file_and_nothing_else(tmp_path, monkeypatch, kind):
    path = tmp_path / "a.xyz"
    path.write_text("1 2 3\n")
    fail_midway(monkeypatch, kind())
    with pytest.raises(kind):
        write_points(path, np.eye(3))
    assert path.read_text() == "1 2 3\n"
    assert os.listdir(tmp_path) == ["a.xyz"]


def test_a_failed_first_writing_leaves_no_file(tmp_path, monkeypatch):
    fail_midway(monkeypatch, RuntimeError("boom"))
    with pytest.raises(PointFileError):
        write_points(tmp_path / "a.xyz", np.eye(3))
    assert os.listdir(tmp_path) == []


@pytest.mark.skipif(os.name != "posix", reason="permission bits and links of POSIX")
def test_a_replaced_file_keeps_its_permissions_and_a_link_its_target(tmp_path):
    path = tmp_path / "a.xyz"
    path.write_text("1 2 3\n")
    path.chmod(0o640)
    (tmp_path / "link.xyz").symlink_to(path)
    write_points(tmp_path / "link.xyz", np.eye(3))
    assert (tmp_path / "link.xyz").is_symlink()
    assert path.stat().st_mode & 0o777 == 0o640
    assert len(read_points(path)) == 3


# ---- real clouds -----------------------------------------------------------------------


@pytest.mark.parametrize("folder", REAL_CLOUDS)
def test_real_files_hold_as_many_points_as_their_notes_say(shared_data, folder):
    notes = (shared_data / folder / "INFO.md").read_text(encoding="utf-8")
    n_points = int(re.search(r"- points: (\d+)", notes)[1])
    files = [
        p for p in (shared_data / folder).iterdir() if p.suffix.lower() in supported_extensions()
    ]
    assert files
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", ".*are 0, 0, 0.*left out")
        clouds = {p.name: read_points(p) for p in files}
    n_read = {name: len(cloud) + cloud.n_dropped for name, cloud in clouds.items()}
    assert n_read == {p.name: n_points for p in files}
