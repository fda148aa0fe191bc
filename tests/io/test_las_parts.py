"""LAS and LAZ in parts hold what they hold as a whole, and several files become one."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from las_files import change, las_file, laspy
from sklearn_mcmd.io import PointCloud, PointFileError, read_points, write_points
from sklearn_mcmd.io._las import writing_parts
from sklearn_mcmd.io._las_joined import joined_cloud, joined_header
from sklearn_mcmd.io._las_parts import read_parts

N = 60  # points of `las_file`


@pytest.fixture(params=["a.las", "a.laz"])
def path(request, tmp_path):
    rng = np.random.default_rng(0)
    n = 120_000  # a chunk of LAZ has 50,000 points
    xyz = np.round(np.cumsum(rng.normal(size=(n, 3)), axis=0), 3)
    attributes = {"intensity": np.arange(n).astype(np.uint16), "beam": rng.integers(0, 9, n)}
    write_points(tmp_path / request.param, PointCloud(xyz, attributes))
    return tmp_path / request.param


def test_parts_together_are_the_whole(path):
    whole, parts = read_points(path), list(read_parts(path, 60_000))
    assert [len(part) for part in parts] == (
        [50_000, 50_000, 20_000] if path.suffix == ".laz" else [60_000, 60_000]
    )
    assert_array_equal(np.vstack([part.xyz for part in parts]), whole.xyz)
    for name, values in whole.attributes.items():
        assert_array_equal(np.concatenate([part.attributes[name] for part in parts]), values)


@pytest.mark.parametrize("name", ["b.las", "b.laz"])
def test_a_file_written_in_parts_is_the_one_written_at_once(path, name):
    n = len(read_points(path))
    score = np.linspace(0, 1, n, dtype=np.float32)
    expected, target = path.with_name(f"expected-{name}"), path.with_name(name)
    write_points(expected, read_points(path).with_attributes(score=score))
    first = 0
    with writing_parts(target) as write:
        for part in read_parts(path, 30_000):
            write(part.with_attributes(score=score[first : first + len(part)]))
            first += len(part)
    parted, whole = laspy.read(target), laspy.read(expected)
    assert parted.points.array.tobytes() == whole.points.array.tobytes()
    assert parted.points.array.dtype == whole.points.array.dtype
    # laspy states the least and most of extra dimensions by the first point of what it is given.
    for name in ("mins", "maxs", "scales", "offsets", "number_of_points_by_return", "uuid"):
        assert_array_equal(getattr(parted.header, name), getattr(whole.header, name))


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), KeyboardInterrupt()])
@pytest.mark.parametrize("name", ["b.las", "b.laz"])
def test_a_full_disk_and_ctrl_c_are_no_error_of_lazrs(tmp_path, monkeypatch, error, name):
    def fail(self, data):
        self.error = error
        raise error

    monkeypatch.setattr("sklearn_mcmd.io._las._Sink.write", fail)
    cloud = PointCloud(np.random.default_rng(0).random((100, 3)))
    with pytest.raises(type(error)) as raised, writing_parts(tmp_path / name) as write:
        write(cloud)
    assert raised.value is error


# ---- several files in one ----------------------------------------------------------------


def joined(*paths):
    """What the files hold together, their number in the name of the file that is written."""
    target, header = paths[0].with_name("all.laz"), joined_header(paths)
    with writing_parts(target) as write:
        for path in paths:
            for cloud in read_parts(path, 15):
                write(joined_cloud(cloud, header))
    return read_points(target)


@pytest.mark.parametrize("point_format", [0, 3, 6, 8])
def test_one_file_holds_the_bytes_of_files_that_are_alike(tmp_path, point_format):
    paths = [las_file(tmp_path / f"{i}.las", point_format, seed=i) for i in range(2)]
    together = joined(*paths)
    assert together.metadata["las_header"].point_format.id == point_format
    expected = [read_points(path).metadata["las_points"] for path in paths]
    assert together.metadata["las_points"].tobytes() == np.concatenate(expected).tobytes()


@pytest.mark.parametrize(
    ("grids", "atol"),
    [
        ([(0.01, 1000.0), (0.001, 1000.0), (0.01, 5.0)], 1e-9),
        ([(0.001, 1000.0), ([0.01, 0.001, 0.001], 1000.0)], 1e-9),
        ([(0.001, 0.0), (0.001, 3e6)], 1e-6),  # which get an offset between them
    ],
)
def test_scales_are_the_finest_and_coordinates_stay(tmp_path, grids, atol):
    paths = [
        las_file(tmp_path / f"{i}.las", scales=scale, offsets=offset, seed=i)
        for i, (scale, offset) in enumerate(grids)
    ]
    together = joined(*paths)
    assert_array_equal(together.metadata["las_header"].scales, 0.001)
    expected = np.vstack([read_points(path).xyz for path in paths])
    assert_allclose(together.xyz, expected, rtol=0, atol=atol)


@pytest.mark.parametrize(
    ("other", "message"),
    [
        ({"extra": [("beam", "f4")]}, r"b\.las: has another point format or other attributes"),
        ({"extra": [("beam", "u1")], "point_format": 0}, r"b\.las: has another point format"),
        ({"extra": [("beam", "u1")], "scales": 1e-7, "offsets": 9e5}, "span too much for one file"),
        ({"point_format": 9}, r"b\.las: wave packets"),
        ({}, r"b\.las: its GPS times"),
        ({"extra": [("beam", "u1")], "scales": 1e-6, "offsets": 1e5}, "outside the bounds"),
    ],
)
def test_what_cannot_be_one_file_is_named(tmp_path, other, message):
    a = las_file(tmp_path / "a.las", extra=[("beam", "u1")], scales=1e-6)
    b = las_file(tmp_path / "b.las", **other)
    if not other:
        change(b, 6, b"\x01")  # standard time, not that of the week
    elif "outside" in message:
        change(b, 179, np.array([1.0, 0.0] * 3).tobytes())  # bounds that are wrong
    with pytest.raises(PointFileError, match=message):
        joined(a, b)
