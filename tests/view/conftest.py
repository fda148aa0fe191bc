"""A scan on a page, and the page in a browser."""

import numpy as np
import pytest

from pages import Tab
from sklearn_mcmd.io import PointCloud
from sklearn_mcmd.plotting import view

N = 100_000


@pytest.fixture(scope="module")
def scan():
    """A floor with a wall, far from the origin; every fiftieth point is an outlier."""
    rng = np.random.default_rng(0)
    xyz = rng.uniform(0, 20, (N, 3)) * [1, 1, 0]
    wall = np.arange(N) % 3 == 0
    xyz[wall, 1], xyz[wall, 2] = 20, rng.uniform(0, 6, wall.sum())
    outlier = np.arange(N) % 50 == 0
    xyz[outlier, 2] += rng.uniform(1, 4, outlier.sum())
    xyz = np.round(xyz, 3)
    xyz += [356_000, 5_640_000, 80]
    normals = np.where(wall[:, None], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0])
    return PointCloud(
        xyz,
        {
            "outlier_score": np.where(outlier, rng.uniform(4, 50, N), rng.uniform(0, 2.9, N)),
            "outlier": outlier,
            "region": np.where(outlier, -1, wall.astype(int)),
            "intensity": (np.arange(N) % 4000).astype(np.uint16),
            "normals": normals,
        },
    )


@pytest.fixture(scope="module")
def page_file(scan, tmp_path_factory):
    return view(scan, names=["scan"]).save(tmp_path_factory.mktemp("view") / "scan.html")


@pytest.fixture
def tab(chromium, page_file):
    opened = Tab(chromium, page_file)
    yield opened
    assert opened.said == []
    assert opened.asked in ([page_file.as_uri()], [page_file.as_uri(), "data:,"])
    opened.context.close()
