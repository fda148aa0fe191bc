"""NumPy's formats: dtypes, tables, grids, and arrays that are no attributes."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from sklearn_mcmd.io import PointFileError, read_points, write_points


@pytest.mark.parametrize("extension", [".npy", ".npz"])
def test_numpy_files_keep_dtypes_and_tables(tmp_path, cloud, extension):
    cloud = cloud.with_attributes(eigenvalues=np.arange(120.0).reshape(40, 3))
    write_points(tmp_path / f"a{extension}", cloud)
    back = read_points(tmp_path / f"a{extension}").attributes
    assert {n: a.dtype for n, a in back.items()} == {
        n: a.dtype for n, a in cloud.attributes.items()
    }
    assert_array_equal(back["eigenvalues"], cloud.attributes["eigenvalues"])


@pytest.mark.parametrize("dtype", [np.float32, np.float64, np.int32])
def test_a_plain_array_gives_coordinates_and_numbered_columns(tmp_path, dtype):
    table = np.arange(10).reshape(2, 5).astype(dtype)
    np.save(tmp_path / "a.npy", table)
    for columns, axes, other in [(None, [0, 1, 2], 5), ({"x": 4, "y": 3, "z": 1}, [3, 2, 0], 2)]:
        cloud = read_points(tmp_path / "a.npy", columns=columns)
        assert cloud.xyz.dtype == np.float64
        assert_array_equal(cloud.xyz, table[:, axes])
        assert_array_equal(cloud.attributes[f"column_{other}"], table[:, other - 1])


def test_npz_arrays_of_another_length_are_kept_aside_and_not_applied(tmp_path):
    offset = np.array([1e6, 2e6, 0])
    np.savez(tmp_path / "a.npz", offset=offset, xyz=np.ones((5, 3)), label=np.arange(5))
    cloud = read_points(tmp_path / "a.npz")
    assert_array_equal(cloud.xyz, np.ones((5, 3)))
    assert list(cloud.attributes) == ["label"]
    write_points(tmp_path / "b.npz", cloud.subset(slice(2)))
    with np.load(tmp_path / "b.npz") as archive:
        assert_array_equal(archive["offset"], offset)


def test_npz_arrays_beside_xyz_that_are_called_like_coordinates_are_renamed(tmp_path):
    np.savez(tmp_path / "a.npz", xyz=np.ones((5, 3)), x=np.arange(5), Z=np.arange(3))
    cloud = read_points(tmp_path / "a.npz")
    assert list(cloud.attributes) == ["x_value"]
    assert list(cloud.metadata["npz_arrays"]) == ["Z"]
    np.savez(tmp_path / "a.npz", xyz=np.ones((5, 3)), x=np.arange(5), x_value=np.arange(5))
    with pytest.raises(PointFileError, match="arrays 'x' and 'x_value' would both be"):
        read_points(tmp_path / "a.npz")


@pytest.mark.parametrize("arrays", [{"x": 0, "y": 1, "z": 2}, {"cloud": [0, 1, 2]}])
def test_npz_coordinates_may_have_other_names(tmp_path, arrays):
    table = np.arange(6.0).reshape(2, 3)
    np.savez(tmp_path / "a.npz", **{name: table[:, column] for name, column in arrays.items()})
    assert_array_equal(read_points(tmp_path / "a.npz").xyz, table)


GRID = np.random.default_rng(0).random((4, 5, 3))
GRID[1, 2] = np.nan  # a cell without a point
AXES = dict(zip("xyz", np.moveaxis(GRID, 2, 0), strict=True))
RANGE = np.arange(20.0).reshape(4, 5)
FIELDS = np.zeros((4, 5), [(name, float) for name in ("x", "y", "z", "range")])
for name, values in (AXES | {"range": RANGE}).items():
    FIELDS[name] = values


@pytest.mark.parametrize(
    ("arrays", "has_range"),
    [(GRID, False), (FIELDS, True), ({"xyz": GRID, "range": RANGE}, True), (AXES, False)],
    ids=["a table", "fields", "xyz", "x, y, z"],
)
def test_organized_arrays_are_read_row_by_row(tmp_path, arrays, has_range):
    if isinstance(arrays, dict):
        np.savez(tmp_path / "a.npz", **arrays)
    else:
        np.save(tmp_path / "a.npy", arrays)
    (path,) = tmp_path.iterdir()
    cloud, kept = read_points(path), np.delete(np.arange(20), 7)
    assert_array_equal(cloud.xyz, GRID.reshape(-1, 3)[kept])
    assert cloud.n_dropped == 1
    assert cloud.metadata["grid_shape"] == (4, 5)
    assert_array_equal(cloud.attributes["row_index"], kept // 5)
    assert_array_equal(cloud.attributes["column_index"], kept % 5)
    assert ("range" in cloud.attributes) is has_range
    if has_range:
        assert_array_equal(cloud.attributes["range"], kept)


@pytest.mark.parametrize("n_columns", [4, 6])
def test_organized_arrays_keep_what_follows_x_y_z(tmp_path, n_columns):
    grid = np.random.default_rng(1).random((7, 8, n_columns))
    np.save(tmp_path / "a.npy", grid)
    cloud = read_points(tmp_path / "a.npy")
    assert_array_equal(cloud.xyz, grid[..., :3].reshape(-1, 3))
    assert_array_equal(cloud.attributes[f"column_{n_columns}"], grid[..., -1].ravel())
    assert cloud.metadata["grid_shape"] == (7, 8)


@pytest.mark.parametrize("shape", [(3, 4, 5), (2, 4, 5, 3), (4, 5, 2), (3, 40, 50)])
def test_arrays_whose_axes_are_not_clear_are_refused(tmp_path, shape):
    np.save(tmp_path / "a.npy", np.zeros(shape))
    with pytest.raises(PointFileError, match=r"or \(rows, columns, 3\), .* are needed"):
        read_points(tmp_path / "a.npy")


@pytest.mark.parametrize("n_rows", [3, 4])
def test_an_array_with_a_row_of_each_coordinate_is_refused(tmp_path, n_rows):
    np.save(tmp_path / "a.npy", np.ones((n_rows, 6000)))
    np.savez(tmp_path / "a.npz", np.ones((n_rows, 6000)))
    np.savez(tmp_path / "b.npz", xyz=np.ones((n_rows, 6000)))
    for name in ("a.npy", "a.npz", "b.npz"):
        with pytest.raises(PointFileError, match=f"{n_rows} points of 6,000 columns: transpose it"):
            read_points(tmp_path / name)


@pytest.mark.parametrize("shape", [(3, 7), (10, 40), (1, 12)])
def test_tables_of_few_points_are_read(tmp_path, shape):
    np.save(tmp_path / "a.npy", np.ones(shape))
    assert len(read_points(tmp_path / "a.npy")) == shape[0]
