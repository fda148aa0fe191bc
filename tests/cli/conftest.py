"""Settings of the tests of the command line."""

import pytest

from sklearn_mcmd.cli import _waiting


@pytest.fixture(autouse=True)
def patient(monkeypatch):
    """However slow the machine is, no line of progress comes between those a test asks for."""
    monkeypatch.setattr(_waiting, "PATIENCE", 3600.0)
