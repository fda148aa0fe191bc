"""Sizes of neighborhoods by tiles, and normals of these, are those in memory to the last bit."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn.base import clone

from sklearn_mcmd import RobustNormalEstimator
from sklearn_mcmd.datasets import make_street
from sklearn_mcmd.io import PointCloud, read_points, write_points
from sklearn_mcmd.io._point_cloud import with_results
from sklearn_mcmd.tiling import TilingError, _result_files, process_files
from sklearn_mcmd.tiling._result_files import normal_columns
from tiled import divide, is_killed, street

ESTIMATOR = RobustNormalEstimator("auto", random_state=0)
RNG = np.random.default_rng(0)


def noisy_floor(n, noise=0.05):
    """Two levels, noisy enough for a hundred neighbors, and a smooth part for few."""
    X = RNG.uniform(0, 4, (n, 3)) * [1, 1, 0]
    X[:, 2] = RNG.normal(0, np.where(X[:, 0] < 2, noise, noise / 10))
    X[: n // 5, 2] += 3
    return X


def far_apart():
    X = noisy_floor(2_000)
    X[1_000:, 0] += 1e4
    return np.vstack([X, RNG.uniform(-1e5, 1e5, (20, 3))])


SCENES = {
    "floor": lambda: noisy_floor(3_000),
    "copies in single precision": lambda: np.vstack([np.round(64 * noisy_floor(1_800)) / 64] * 2),
    "far apart": far_apart,
}

# These are tried as one tile, too. There only order, copies and precision count.
ONE_TILE = {"floor", "copies in single precision"}


def in_memory(source, target, estimator=ESTIMATOR):
    """Write what a run by tiles must equal; returns the numbers of neighbors."""
    cloud = read_points(source)
    single = cloud.xyz.astype(np.float32)
    exact = np.array_equal(single, cloud.xyz)
    fitted = clone(estimator).fit(single if exact else cloud.xyz)
    names, columns = normal_columns(fitted)
    write_points(target, with_results(cloud, dict(zip(names, columns.T.copy(), strict=True))))
    return fitted.n_neighbors_


@pytest.mark.parametrize("scene", SCENES)
def test_normals_are_those_of_memory_wherever_tiles_begin(scene, tmp_path):
    a, b, c = (tmp_path / name for name in ("a.las", "b.las", "c.las"))
    write_points(a, PointCloud(SCENES[scene]()))
    sizes = in_memory(a, b)
    if scene == "floor":
        assert np.ptp(sizes) > 40
    for tile_size, cut in ((800, 0.3), *[(10_000, 0.5)] * (scene in ONE_TILE)):
        divide(a, c, ESTIMATOR, tile_size=tile_size, cut=cut)
        assert c.read_bytes() == b.read_bytes()


@pytest.mark.parametrize(
    "params",
    [
        {"method": "pca", "radius": 0.3},
        {"method": "mcmd_md", "neighbor_planes": False},
        {"reweight": False, "features": ["normal_error", "mean_curvature"], "orientation": "mst"},
    ],
    ids=lambda params: "-".join(params),
)
def test_normals_are_those_of_memory_for_all_parameters(params, tmp_path):
    a, b, c = (tmp_path / name for name in ("a.las", "b.las", "c.las"))
    write_points(a, PointCloud(noisy_floor(2_000)))
    estimator = clone(ESTIMATOR).set_params(**params)
    in_memory(a, b, estimator)
    process_files(a, c, estimator, tile_size=700)
    assert c.read_bytes() == b.read_bytes()


@given(
    n=st.integers(1_000, 1_600),
    noise=st.floats(0.0, 0.4),
    digits=st.sampled_from([1, 2, 4]),
    tile_size=st.integers(150, 900),
    cut=st.floats(0.2, 0.8),
)
@settings(max_examples=2)
def test_normals_of_any_cloud_are_those_of_memory(n, noise, digits, tile_size, cut, tmp_path):
    a, b, c = (tmp_path / name for name in ("a.las", "b.las", "c.las"))
    write_points(a, PointCloud(np.round(noisy_floor(n, noise), digits)))
    in_memory(a, b)
    divide(a, c, ESTIMATOR, tile_size=tile_size, cut=cut)
    assert c.read_bytes() == b.read_bytes()


@pytest.mark.parametrize("n", [900, 30])
def test_small_clouds_have_the_normals_of_memory(n, tmp_path):
    a, b, c = (tmp_path / name for name in ("a.las", "b.las", "c.las"))
    write_points(a, street(n))
    in_memory(a, b)
    process_files(a, c, ESTIMATOR, tile_size=200)
    assert c.read_bytes() == b.read_bytes()


def test_many_points_at_few_places_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(_result_files, "MOST_COPIES", 1_000)
    write_points(tmp_path / "a.las", np.repeat(noisy_floor(600), 2, axis=0))
    with pytest.raises(TilingError, match="1,200 points at 600 places"):
        process_files(tmp_path / "a.las", tmp_path / "b.las", ESTIMATOR, tile_size=500)


def test_processes_and_attributes(tmp_path):
    a, b, c = (tmp_path / name for name in ("a.laz", "b.laz", "c.laz"))
    write_points(a, street(3_000))
    in_memory(a, b)
    report = process_files(a, c, ESTIMATOR, tile_size=1_200, n_jobs=2)
    assert c.read_bytes() == b.read_bytes()
    assert report.n_workers == 2
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.laz", "b.laz", "c.laz"]


# A run that kills itself within a sweep.
RUN = """
import os, signal, sys
from sklearn_mcmd import RobustNormalEstimator
from sklearn_mcmd.tiling import _planes, process_files

source, target, place = sys.argv[1:]

def die(*args, **kwargs):
    os.kill(os.getpid(), getattr(signal, "SIGKILL", signal.SIGTERM))

def twice(work, done=[]):
    def some(*args, **kwargs):
        done.append(work(*args, **kwargs) if len(done) < 2 else die())
    return some

setattr(_planes, place, twice(getattr(_planes, place)))
process_files(source, target, RobustNormalEstimator("auto", random_state=0), tile_size=1_200)
"""


@pytest.mark.parametrize(
    ("place", "n_resumed"),
    [
        ("find_larger", 0),
        ("_bend", 4),
        *(
            pytest.param(*case, marks=pytest.mark.slow)
            for case in (("find_neighbors", 0), ("_fit_own", 2), ("_tell_cell", 4))
        ),
    ],
)
def test_a_run_that_was_killed_goes_on(place, n_resumed, tmp_path):
    a, b, c = (tmp_path / name for name in ("a.las", "b.las", "c.las"))
    write_points(a, PointCloud(noisy_floor(3_000)))
    in_memory(a, b)
    assert is_killed(RUN, a, c, place)
    assert not c.exists()
    report = process_files(a, c, ESTIMATOR, tile_size=1_200)
    assert c.read_bytes() == b.read_bytes()
    assert report.n_resumed == n_resumed
    assert not (tmp_path / "c.las.tiles").exists()


@pytest.mark.slow
def test_many_points_have_the_normals_of_memory(tmp_path):
    a, b, c = (tmp_path / name for name in ("a.las", "b.las", "c.las"))
    X = make_street(40_000, outlier_share=0.1, random_state=1).data
    write_points(a, PointCloud(np.round(X, 3)))
    in_memory(a, b)
    divide(a, c, ESTIMATOR, tile_size=5_000, n_jobs=2)
    assert c.read_bytes() == b.read_bytes()
