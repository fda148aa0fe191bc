"""Settings of the tests of reports."""

import pytest

from sklearn_mcmd.report import _maps


@pytest.fixture(autouse=True)
def small_maps(monkeypatch):
    """Maps take most of their time for pixels."""
    monkeypatch.setattr(_maps, "DPI", 40)
