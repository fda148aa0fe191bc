"""Settings of the tests of the command line."""

import numpy as np
import pytest

from sklearn_mcmd.cli import _messages
from sklearn_mcmd.io import write_points
from sklearn_mcmd.report import _rendering
from sklearn_mcmd.tiling import _memory
from tiled import shining_street


@pytest.fixture(autouse=True)
def patient(monkeypatch):
    """However slow the machine is, no line of progress comes between those a test asks for."""
    monkeypatch.setattr(_messages, "PATIENCE", 3600.0)


@pytest.fixture(autouse=True)
def small_maps(monkeypatch):
    """Maps of reports take most of their time for pixels."""
    monkeypatch.setattr(_rendering, "DPI", 20)


@pytest.fixture
def small_machine(monkeypatch):
    """A process takes nothing, so that 2 MB are tiles of few thousand points."""
    for name, value in {"PROCESS": 0, "PART": 1_000, "SMALLEST_CELL": 1_000}.items():
        monkeypatch.setattr(_memory, name, value)


@pytest.fixture
def source(tmp_path):
    """A street of 3,000 points in a file, whose ground has class 2, and some others class 3."""
    cloud = shining_street(3_000)
    height = cloud.xyz[:, 2] - 100
    classes = np.where(height < 0.1, 2, np.where(height > 3, 3, 1))
    write_points(tmp_path / "street.laz", cloud.with_attributes(classification=classes))
    return tmp_path / "street.laz"
