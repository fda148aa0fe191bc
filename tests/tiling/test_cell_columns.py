"""Columns appear when they are whole."""

import numpy as np
import pytest

from sklearn_mcmd.io import PointFileError
from sklearn_mcmd.tiling import _cell_columns
from sklearn_mcmd.tiling._cell_columns import CellColumns


def test_a_column_stays_until_another_is_written(tmp_path, monkeypatch):
    columns, save = CellColumns(tmp_path), np.save
    columns.write(0, points=np.ones(10_000))

    def half(file, values):
        save(file, values[:5])
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(_cell_columns.np, "save", half)
        with pytest.raises(OSError, match="No space"):
            columns.write(0, points=np.zeros(10_000))
    assert columns.read(0, "points").sum() == 10_000
    columns.write(0, points=np.zeros(10_000))
    assert columns.read(0, "points").sum() == 0


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
