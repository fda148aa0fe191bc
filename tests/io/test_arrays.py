"""NumPy's formats: dtypes, tables, and arrays that are no attributes."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from sklearn_mcmd.io import read_points, write_points


@pytest.mark.parametrize("extension", [".npy", ".npz"])
def test_numpy_files_keep_dtypes_and_tables(tmp_path, cloud, extension):
    cloud = cloud.with_attributes(eigenvalues=np.arange(120.0).reshape(40, 3))
    write_points(tmp_path / f"a{extension}", cloud)
    back = read_points(tmp_path / f"a{extension}")
    assert {n: a.dtype for n, a in back.attributes.items()} == {
        n: a.dtype for n, a in cloud.attributes.items()
    }
    assert_array_equal(back.attributes["eigenvalues"], cloud.attributes["eigenvalues"])


@pytest.mark.parametrize("dtype", [np.float32, np.float64, np.int32])
def test_a_plain_array_gives_coordinates_and_numbered_columns(tmp_path, dtype):
    table = np.arange(10).reshape(2, 5).astype(dtype)
    np.save(tmp_path / "a.npy", table)
    cloud = read_points(tmp_path / "a.npy")
    assert cloud.xyz.dtype == np.float64
    assert_array_equal(cloud.xyz, table[:, :3])
    assert_array_equal(cloud.attributes["column_5"], table[:, 4])


def test_npz_arrays_of_another_length_are_kept_aside_and_not_applied(tmp_path):
    offset = np.array([1e6, 2e6, 0])
    np.savez(tmp_path / "a.npz", offset=offset, xyz=np.ones((5, 3)), label=np.arange(5))
    cloud = read_points(tmp_path / "a.npz")
    assert_array_equal(cloud.xyz, np.ones((5, 3)))
    assert list(cloud.attributes) == ["label"]
    write_points(tmp_path / "b.npz", cloud.subset(slice(2)))
    with np.load(tmp_path / "b.npz") as archive:
        assert_array_equal(archive["offset"], offset)


@pytest.mark.parametrize("arrays", [{"x": 0, "y": 1, "z": 2}, {"cloud": [0, 1, 2]}])
def test_npz_coordinates_may_have_other_names(tmp_path, arrays):
    table = np.arange(6.0).reshape(2, 3)
    np.savez(tmp_path / "a.npz", **{name: table[:, column] for name, column in arrays.items()})
    assert_array_equal(read_points(tmp_path / "a.npz").xyz, table)
