"""LAS and LAZ in parts hold what they hold as a whole."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from las_files import laspy
from sklearn_mcmd.io import PointCloud, read_points, write_points
from sklearn_mcmd.io._las import writing_parts
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
