"""Settings and fixtures that several test modules share."""

import os
from pathlib import Path

# Before SciPy is imported: without it scikit-learn skips its array API checks.
os.environ.setdefault("SCIPY_ARRAY_API", "1")

import numpy as np
import pytest

from sklearn_mcmd.io import PointCloud


@pytest.fixture(scope="session")
def shared_data():
    """The folder of real point clouds next to the checkout; tests skip where it is absent."""
    folder = Path(__file__).resolve().parents[2] / "shared" / "data"
    if not folder.is_dir():
        pytest.skip("the folder shared/data with real point clouds is not beside the checkout")
    return folder


@pytest.fixture
def cloud():
    """A small cloud in national coordinates with the results that callers write."""
    rng = np.random.default_rng(0)
    n = 40
    normals = rng.normal(size=(n, 3)).astype(np.float32)
    return PointCloud(
        rng.uniform(0, 50, (n, 3)) + np.array([362_000, 5_157_000, 100]),
        {
            "outlier": rng.random(n) < 0.2,
            "score": rng.random(n).astype(np.float32),
            "normal_x": normals[:, 0],
            "normal_y": normals[:, 1],
            "normal_z": normals[:, 2],
            "surface_variation": rng.random(n),
            "region": rng.integers(-1, 9, n),
        },
    )
