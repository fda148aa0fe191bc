"""What all tests share."""

import os
import sys
from pathlib import Path

# Before scikit-learn is imported: without it two of its checks are skipped.
os.environ.setdefault("SCIPY_ARRAY_API", "1")

# Literal, slow forms of the papers' equations are modules beside the tests.
sys.path.insert(0, str(Path(__file__).parent))

import pytest


@pytest.fixture(scope="session")
def shared_data():
    """Folder of real point clouds beside the checkout; tests that need it skip without."""
    folder = Path(__file__).parents[2] / "shared" / "data"
    if not folder.is_dir():
        pytest.skip("no shared/data folder beside the checkout")
    return folder
