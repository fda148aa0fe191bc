"""Tiles on the workers of dask give what one process gives."""

import os
import signal
import threading
import time
import warnings

import joblib
import pytest

from sklearn_mcmd import RobustNormalEstimator, SharpFeatureDetector
from sklearn_mcmd.tiling import TilingError, _tiled_normals, process_files
from sklearn_mcmd.tiling._memory import plan_run, usual_memory
from tiled import ESTIMATOR, in_memory

dask, distributed = (pytest.importorskip(name) for name in ("dask", "distributed"))

# A warning that is an error would be lost in a thread of dask, and the test would wait for it.
pytestmark = pytest.mark.filterwarnings("default")
LOCAL = {"host": "127.0.0.1", "dashboard_address": "127.0.0.1:0", "threads_per_worker": 1}


@pytest.fixture
def client():
    """Of a cluster of two workers in this process.

    They are not paused when the memory of this process, with what earlier tests left in it,
    reaches their limit: they would wait for ever.
    """
    params = {"n_workers": 2, "processes": False, "protocol": "tcp", "memory_limit": "1.5GB"}
    with (
        dask.config.set({"distributed.worker.memory.pause": False}),
        distributed.LocalCluster(**params, **LOCAL) as cluster,
        distributed.Client(cluster) as client,
    ):
        yield client


def test_sweeps_on_dask_give_the_output_of_this_process(client, small_file, tmp_path):
    a, b = tmp_path / "a.las", tmp_path / "b.las"
    normals = RobustNormalEstimator("auto", random_state=0)
    estimator = SharpFeatureDetector(12, normal_estimator=normals, random_state=0)
    process_files(small_file, a, estimator, tile_size=2_000)
    with joblib.parallel_config(backend="dask"):
        report = process_files(small_file, b, estimator, tile_size=2_000)
    assert report.n_workers == 2
    assert a.read_bytes() == b.read_bytes()


def test_the_memory_is_that_of_the_workers(client):
    with joblib.parallel_config(backend="dask"):
        assert usual_memory() == pytest.approx(1.5e9)
        assert plan_run(10**9, 8e9).n_workers == 2
        assert plan_run(10**9, 8e9, 1).n_workers == plan_run(10**9, 9e8).n_workers == 1


def lose_a_worker(folder, pid):
    """Kill a process once a tile is done."""
    end = time.monotonic() + 600
    while time.monotonic() < end and not list(folder.glob("*.results.npy")):
        time.sleep(0.01)
    os.kill(pid, signal.SIGKILL)


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="kill -9")
def test_a_worker_that_is_lost_loses_nothing(street_file, tmp_path):
    source, expected = street_file
    with (
        distributed.LocalCluster(n_workers=2, processes=True, **LOCAL) as cluster,
        distributed.Client(cluster) as client,
    ):
        pids = client.run(os.getpid)
        arguments = (tmp_path / "out.laz.tiles" / "results", next(iter(pids.values())))
        killer = threading.Thread(target=lose_a_worker, args=arguments)
        killer.start()
        with joblib.parallel_config(backend="dask"), warnings.catch_warnings():
            warnings.simplefilter("error")  # no tile fails
            report = process_files(source, tmp_path / "out.laz", ESTIMATOR, tile_size=1_500)
        killer.join()
        assert set(client.run(os.getpid).values()) != set(pids.values())
    assert report.n_tiles >= 8
    assert (tmp_path / "out.laz").read_bytes() == expected.read_bytes()
    assert [path.name for path in tmp_path.iterdir()] == ["out.laz"]


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="kill -9")
def test_a_tile_that_kills_its_process_ends_the_run_with_one_line(
    small_file, tmp_path, monkeypatch
):
    def die(*args, **params):  # within, so that it is pickled with its code
        os.kill(os.getpid(), signal.SIGKILL)

    target = tmp_path / "out.las"
    monkeypatch.setattr(_tiled_normals, "_fit_own", die)
    with pytest.raises(TilingError, match=r"(?s)terminated.*SIGKILL.*; what was done is kept in"):
        process_files(small_file, target, ESTIMATOR, tile_size=2_000, n_jobs=2)
    assert not target.exists()
    monkeypatch.undo()
    process_files(small_file, target, ESTIMATOR, tile_size=2_000)
    assert target.read_bytes() == in_memory(small_file, tmp_path / "expected.las").read_bytes()
