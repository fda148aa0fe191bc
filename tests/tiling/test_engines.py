"""Tiles on the workers of dask give what one process gives."""

import os
import signal
import socket
import subprocess
import sys
import time

import joblib
import pytest

from sklearn_mcmd.io import write_points
from sklearn_mcmd.tiling import TilingError, _base, process_files
from sklearn_mcmd.tiling._memory import plan_run, usual_memory
from tiled import ESTIMATOR, REGIONS, goes_on, names_in, street

dask, distributed = (pytest.importorskip(name) for name in ("dask", "distributed"))

# A warning that is an error would be lost in a thread of dask, and the test would wait for it.
pytestmark = pytest.mark.filterwarnings("default")
LOCAL = {"host": "127.0.0.1", "dashboard_address": "127.0.0.1:0", "threads_per_worker": 1}


def kills(test):
    """Marks of a test that kills processes."""
    return pytest.mark.slow(pytest.mark.skipif(os.name != "posix", reason="kill -9")(test))


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


# These workers are threads of one process, which leave their filters of warnings in any order: what
# a tile ignores would be an error now and then.
@pytest.mark.filterwarnings("ignore")
def test_tiles_on_dask_give_the_output_of_this_process_in_the_memory_of_workers(
    client, small_file, tmp_path
):
    a, b = tmp_path / "a.las", tmp_path / "b.las"
    process_files(small_file, a, REGIONS, tile_size=800)
    with joblib.parallel_config(backend="dask"):
        report = process_files(small_file, b, REGIONS, tile_size=800)
        assert report.n_workers == 2
        assert a.read_bytes() == b.read_bytes()
        assert usual_memory() == pytest.approx(1.5e9)
        assert plan_run(10**9, 8e9, None, None, 2_000).n_workers == 2
        assert plan_run(10**9, 8e9, 1, None, 2_000).n_workers == 1


RUN = """
import sys
import joblib
from distributed import Client
from sklearn_mcmd import *
from sklearn_mcmd.tiling import process_files

source, target, address, estimator = sys.argv[1:]
with Client(address) as client, joblib.parallel_config(backend="dask"):
    client.wait_for_workers(2)  # with one, this process does the work
    process_files(source, target, eval(estimator), tile_size=700)
"""


class Cluster:
    """A scheduler of dask and workers, each a process of its own, as on machines of their own."""

    def __init__(self, folder):
        self.folder, self.processes = folder, []
        self.start_scheduler()

    def start(self, *command):
        with open(self.folder / "log.txt", "a") as log:
            self.processes.append(subprocess.Popen([sys.executable, *command], stderr=log))
        return self.processes[-1]

    def start_scheduler(self):
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        self.address = f"tcp://127.0.0.1:{port}"
        command = "-m", "distributed.cli.dask_scheduler", "--host", "127.0.0.1"
        self.scheduler = self.start(*command, "--port", str(port), "--no-dashboard")

    def start_worker(self):
        command = "-m", "distributed.cli.dask_worker", self.address, "--nthreads", "1"
        options = "--no-nanny", "--no-dashboard", "--memory-limit", "2GB", "--local-directory"
        return self.start(*command, *options, str(self.folder))

    def start_run(self, source, target):
        return self.start("-c", RUN, source, target, self.address, repr(ESTIMATOR))

    def kill(self, process):
        process.send_signal(signal.SIGKILL)
        process.wait()


@pytest.fixture(scope="module")
def street_file(tmp_path_factory):
    """20,000 points, so that tiles are left when others are done, and the same with normals."""
    folder = tmp_path_factory.mktemp("street")
    write_points(folder / "street.laz", street(20_000))
    process_files(folder / "street.laz", folder / "normals.laz", ESTIMATOR, tile_size=700)
    return folder / "street.laz", folder / "normals.laz"


@pytest.fixture
def cluster(tmp_path_factory):
    cluster = Cluster(tmp_path_factory.mktemp("cluster"))
    yield cluster
    for process in cluster.processes:
        cluster.kill(process)


def wait_for(folder, n_tiles, run):
    """Wait until so many tiles are done, as reports in the folder of a run say."""
    end = time.monotonic() + 600
    while len(list(folder.glob("*.tiles/results-*/*.fit.json"))) < n_tiles:
        assert time.monotonic() < end
        assert run.poll() is None
        time.sleep(0.01)


@kills
def test_workers_that_are_killed_one_by_one_lose_nothing(street_file, tmp_path, cluster):
    source, expected = street_file
    workers = [cluster.start_worker() for _ in range(3)]
    run = cluster.start_run(source, tmp_path / "out.laz")
    for n_tiles in (1, 3, 5):
        wait_for(tmp_path, n_tiles, run)
        cluster.kill(workers.pop(0))
        workers.append(cluster.start_worker())
    assert run.wait(600) == 0
    assert "failed" not in (cluster.folder / "log.txt").read_text()
    assert (tmp_path / "out.laz").read_bytes() == expected.read_bytes()
    assert names_in(tmp_path) == ["out.laz"]


@kills
@pytest.mark.parametrize("whom", ["scheduler", "run"])
def test_the_same_command_goes_on_when_all_else_was_killed(street_file, tmp_path, cluster, whom):
    source, expected = street_file
    workers = [cluster.start_worker() for _ in range(2)]
    run = cluster.start_run(source, tmp_path / "out.laz")
    wait_for(tmp_path, 2, run)
    cluster.kill(cluster.scheduler if whom == "scheduler" else run)
    if whom == "scheduler":
        assert run.wait(120) != 0  # it ends by itself
        assert "the same run goes on from there" in (cluster.folder / "log.txt").read_text()
        cluster.start_scheduler()
        for worker in workers:
            worker.wait(120)  # it ends, too
            cluster.start_worker()
    assert cluster.start_run(source, tmp_path / "out.laz").wait(600) == 0
    assert (tmp_path / "out.laz").read_bytes() == expected.read_bytes()
    assert names_in(tmp_path) == ["out.laz"]


@kills
def test_a_tile_that_kills_its_process_ends_the_run_with_one_line(
    small_file, tmp_path, monkeypatch
):
    def die(*args, **params):  # within, so that it is pickled with its code
        os.kill(os.getpid(), signal.SIGKILL)

    target = tmp_path / "out.las"
    monkeypatch.setattr(_base, "fit_cell", die)
    with pytest.raises(TilingError, match=r"(?s)terminated.*SIGKILL.*; what was done is kept in"):
        process_files(small_file, target, ESTIMATOR, tile_size=800, n_jobs=2)
    assert not target.exists()
    monkeypatch.undo()
    goes_on(small_file, target, tile_size=800)
