"""``--scheduler`` in the command line."""

import socket

import pytest

from commands import done, error_line, files_in, run
from sklearn_mcmd.cli import _cloud_verb

distributed = pytest.importorskip("distributed")

# A warning that is an error would be lost in a thread of dask, and the test would wait for it.
pytestmark = pytest.mark.filterwarnings("default")
LOCAL = {"host": "127.0.0.1", "dashboard_address": "127.0.0.1:0"}


def test_a_scheduler_divides_the_work(source, tmp_path):
    plain, divided = tmp_path / "a.laz", tmp_path / "b.laz"
    options = ("--n-neighbors", 16)
    done("normals", source, plain, *options)
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, protocol="tcp", **LOCAL
    ) as cluster:
        address = cluster.scheduler_address
        result = done("normals", source, divided, *options, "--scheduler", address)
        plan = run("normals", source, divided, "--scheduler", address, "--dry-run")
    assert "tiles" in result.stdout
    assert "processes  1" in plan.stdout
    assert plain.read_bytes() == divided.read_bytes()
    assert files_in(tmp_path) == ["a.laz", "b.laz", "street.laz"]


def free_port():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        return taken.getsockname()[1]


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:{}", "no://127.0.0.1:{}"])
def test_an_address_that_does_not_answer_is_said_soon(address, source, tmp_path, monkeypatch):
    monkeypatch.setattr(_cloud_verb, "SECONDS", 0.3)
    address = address.format(free_port())
    line = error_line(run("normals", source, tmp_path / "b.laz", "--scheduler", address))
    assert f"--scheduler {address}: no scheduler of dask answers" in line
    assert files_in(tmp_path) == ["street.laz"]


@pytest.mark.parametrize(
    ("address", "encrypt", "words"),
    [("tcp://127.0.0.1:1", True, "encryption required"), ("tls://127.0.0.1:1", False, "TLS")],
)
def test_an_address_that_does_not_fit_the_settings_of_tls_is_said(
    address, encrypt, words, source, tmp_path
):
    dask = pytest.importorskip("dask")
    with dask.config.set({"distributed.comm.require-encryption": encrypt}):
        line = error_line(run("normals", source, tmp_path / "b.laz", "--scheduler", address))
    assert f"--scheduler {address}: no scheduler of dask answers: " in line
    assert words in line


def test_a_scheduler_without_workers_is_said(source, tmp_path, monkeypatch):
    monkeypatch.setattr(_cloud_verb, "SECONDS", 0.5)
    with distributed.LocalCluster(n_workers=0, processes=False, protocol="tcp", **LOCAL) as cluster:
        address = cluster.scheduler_address
        line = error_line(run("normals", source, tmp_path / "b.laz", "--scheduler", address))
    assert f"--scheduler {address}: has no workers" in line
