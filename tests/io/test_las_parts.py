"""LAS and LAZ in parts hold what they hold as a whole."""

import errno

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from sklearn_mcmd.io import PointCloud, PointFileError, read_points, write_points
from sklearn_mcmd.io._las import writing_parts
from sklearn_mcmd.io._las_parts import read_parts

laspy = pytest.importorskip("laspy")
pytest.importorskip("lazrs")


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
    found, wanted = laspy.read(target), laspy.read(expected)
    assert found.points.array.tobytes() == wanted.points.array.tobytes()
    assert found.points.array.dtype == wanted.points.array.dtype
    # laspy states the least and most of extra dimensions by the first point of what it is given.
    for name in ("mins", "maxs", "scales", "offsets", "number_of_points_by_return", "uuid"):
        assert_array_equal(getattr(found.header, name), getattr(wanted.header, name))


def test_a_truncated_file_is_named(path):
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.raises(PointFileError, match=rf"{path.name}: .*truncated"):
        list(read_parts(path, 30_000))


def test_a_full_disk_is_told_as_such(path, monkeypatch):
    from sklearn_mcmd.io import _las

    def fail(self, data):
        self.error = OSError(errno.ENOSPC, "No space left on device")
        raise self.error

    monkeypatch.setattr(_las._Sink, "write", fail)
    part = next(read_parts(path, 60_000))
    with (
        pytest.raises(OSError, match="No space left"),
        writing_parts(path.with_name("b.laz")) as write,
    ):
        write(part)
