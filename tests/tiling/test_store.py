"""What tiles keep on disk, points in cells and columns of places, is named where it is damaged."""

import numpy as np
import pytest

from sklearn_mcmd.io import PointFileError
from sklearn_mcmd.tiling._cells import Cells, CellWriter
from sklearn_mcmd.tiling._stored_columns import CellColumns


@pytest.fixture
def cells(tmp_path):
    """A thousand points in a few cells."""
    writer = CellWriter(tmp_path, 300)
    writer.add(np.random.default_rng(0).random((1_000, 3)), np.arange(1_000))
    return writer.close()


@pytest.mark.parametrize(
    "change", [lambda data: data[:-3], lambda data: data[:-32], lambda data: b""]
)
def test_a_cell_that_is_not_as_it_was_written_is_named(cells, tmp_path, change):
    (path,) = tmp_path.glob(f"{cells._names[1]}.*")
    path.write_bytes(change(path.read_bytes()))
    with pytest.raises(PointFileError, match=rf"{path.name}: is damaged; begin anew \(restart\)"):
        cells.read(1)


@pytest.mark.parametrize("content", [b"", b"PK", b"[]"])
@pytest.mark.usefixtures("cells")
def test_damaged_boxes_are_named(tmp_path, content):
    (tmp_path / "cells.npz").write_bytes(content)
    with pytest.raises(PointFileError, match=r"cells\.npz: cannot be read"):
        Cells(tmp_path)


@pytest.mark.parametrize("content", [b"", b"{", b"\x93NUMPY\x01\x00", b"\xff"])
def test_damaged_columns_and_reports_are_named(tmp_path, content):
    columns = CellColumns(tmp_path)
    for name, read in (("0.points.npy", columns.read), ("0.points.json", columns.report)):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(PointFileError, match=rf"{name}: cannot be read"):
            read(0, "points")


def test_no_pickle_is_loaded(tmp_path):
    np.save(tmp_path / "0.points.npy", np.array([print, None]), allow_pickle=True)
    with pytest.raises(PointFileError, match="Object arrays cannot be loaded"):
        CellColumns(tmp_path).read(0, "points")
