"""Settings and fixtures that several test modules share."""

import os
from pathlib import Path

# Before SciPy is imported: without it scikit-learn skips its array API checks.
os.environ.setdefault("SCIPY_ARRAY_API", "1")

import pytest


@pytest.fixture(scope="session")
def shared_data():
    """The folder of real point clouds next to the checkout; tests skip where it is absent."""
    folder = Path(__file__).resolve().parents[2] / "shared" / "data"
    if not folder.is_dir():
        pytest.skip("the folder shared/data with real point clouds is not beside the checkout")
    return folder
