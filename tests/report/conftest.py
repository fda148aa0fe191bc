"""Settings of the tests of reports."""

import pytest

from sklearn_mcmd.report import _rendering


@pytest.fixture(autouse=True)
def small_maps(monkeypatch):
    """Maps take most of their time for pixels."""
    monkeypatch.setattr(_rendering, "DPI", 40)
