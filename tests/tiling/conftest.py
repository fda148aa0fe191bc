"""Clouds in files, their normals, and tiles that fail."""

import pytest

from sklearn_mcmd.io import write_points
from sklearn_mcmd.tiling import _planes
from tiled import in_memory, street


@pytest.fixture(scope="session")
def street_file(tmp_path_factory):
    """12,000 points, and the same with normals."""
    folder = tmp_path_factory.mktemp("street")
    write_points(folder / "street.laz", street(12_000))
    return folder / "street.laz", in_memory(folder / "street.laz", folder / "normals.laz")


@pytest.fixture
def small_file(tmp_path):
    """5,000 points."""
    write_points(tmp_path / "small.las", street(5_000))
    return tmp_path / "small.las"


@pytest.fixture
def failing(monkeypatch):
    """Cells whose tiles fail."""
    cells = set()

    def work(cell, job, fit=_planes._fit_own):
        if cell in cells:
            raise MemoryError("too much\nof it")
        return fit(cell, job)

    monkeypatch.setattr(_planes, "_fit_own", work)
    return cells
