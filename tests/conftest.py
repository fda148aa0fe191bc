"""Settings and fixtures that several test modules share."""

import gc
import os
import shutil
import signal
import sys
import threading
import time
from importlib import import_module
from pathlib import Path

# Before NumPy and SciPy are imported. Without the first scikit-learn skips its array API checks.
os.environ.setdefault("SCIPY_ARRAY_API", "1")
# pytest-xdist starts a worker for each core. Threads of BLAS and OpenMP on top of these wait for
# each other: a scene of 4,000 points then takes five times the processor time.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("MKL_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import pytest
from hypothesis import HealthCheck, settings
from hypothesis.database import DirectoryBasedExampleDatabase

from sklearn_mcmd import MCMDOutlierDetector, RobustNormalEstimator, SharpFeatureDetector
from sklearn_mcmd.io import PointCloud, write_points
from sklearn_mcmd.planes import _local_planes

# Failing assertions of helpers show their values, as those of tests do.
pytest.register_assert_rewrite("commands")


# Every run has the same examples. `--hypothesis-profile random`, of the nightly job, draws others.
# No test fails because the machine is slow, and folders of a test serve all its examples.
UNTIMED = settings(
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture],
)
settings.register_profile("fixed", UNTIMED, derandomize=True, database=None)
FOUND = DirectoryBasedExampleDatabase(".hypothesis/examples")
settings.register_profile("random", UNTIMED, derandomize=False, database=FOUND, print_blob=True)
settings.load_profile("fixed")

N_ROOM, N_STRAY = 900, 30
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
# WebGL in software, for machines without a graphics card.
FLAGS = [
    *("--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader"),
    *("--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"),
]
OF_ESTIMATORS = {
    *("baselines", "edges", "normals", "outliers", "planes", "properties", "segmentation"),
    "test_common",  # its read-only arrays would be compiled for, which takes 24 s
}


def pytest_configure(config):
    """Hand neighboring tests to the same worker: they share the fixtures of their module.

    Fixed examples do not depend on which modules a worker has imported: Hypothesis also draws
    numbers that it reads in their code.

    Programs that tests start inherit ignored signals. A run in the background (`&`, nohup) ignores
    some, which are tests' subject: they are put back.
    """
    gc.disable()  # until all tests are collected: else it takes a third of that time
    if threading.current_thread() is threading.main_thread():
        for name, handler in (("SIGINT", signal.default_int_handler), ("SIGHUP", signal.SIG_DFL)):
            number = getattr(signal, name, None)  # Windows has no SIGHUP
            if number is not None and signal.getsignal(number) is signal.SIG_IGN:
                signal.signal(number, handler)
    providers = sys.modules.get("hypothesis.internal.conjecture.providers")  # None in old versions
    if config.getoption("--hypothesis-profile") is None and providers is not None:
        providers._get_local_constants = lambda: providers._local_constants  # none
    if getattr(config.option, "dist", None) == "load":  # what -n asks for by itself
        config.option.dist = "worksteal"


def pytest_collection_finish(session):
    """What is collected stays to the end: it is not looked through again and again."""
    gc.enable()
    gc.freeze()


@pytest.fixture(scope="session", autouse=True)
def _compiled(request, tmp_path_factory):
    """Two of pytest-xdist's workers compile half of the functions each, and the others wait.

    Else each would compile all of them, at the same time.
    """
    worker = getattr(request.config, "workerinput", {"workercount": 1})
    if worker["workercount"] == 1 or len(request.session.items) < 1_000:
        return
    X = np.random.default_rng(0).uniform(size=(2_000, 3)) * [1, 1, 0.01]
    done = [tmp_path_factory.getbasetemp().parent / f"compiled_{half}" for half in (0, 1)]
    if worker["workerid"] == "gw0":
        MCMDOutlierDetector(random_state=0).fit(X)
        done[0].touch()
    elif worker["workerid"] == "gw1":
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(_local_planes, "COMPILE_FROM", 10**9)
            RobustNormalEstimator("auto", features="all", random_state=0).fit(X[:400])
            SharpFeatureDetector(random_state=0).fit(X[:400])
        done[1].touch()
    end = time.monotonic() + 300
    while not all(half.exists() for half in done) and time.monotonic() < end:
        time.sleep(0.1)


@pytest.fixture(scope="session", autouse=True)
def _unsynced():
    """No power fails meanwhile, and to wait for the disk takes 3 ms for each file."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "fsync", lambda descriptor: None)
        yield


@pytest.fixture(scope="module", autouse=True)
def _quick_planes(request):
    """Some hundred points have compiled planes in a tenth of NumPy's time.

    Tests of estimators have NumPy's; one of the planes says that both are the same.
    """
    with pytest.MonkeyPatch.context() as patch:
        if OF_ESTIMATORS.isdisjoint({request.path.parent.name, request.path.stem}):
            patch.setattr(_local_planes, "COMPILE_FROM", 0)
        yield


@pytest.fixture(autouse=True)
def _own_numbers(request, monkeypatch):
    """A module's RNG gives a test the same numbers, whichever tests this process ran before."""
    if hasattr(request.module, "RNG"):
        monkeypatch.setattr(request.module, "RNG", np.random.default_rng(0))


@pytest.fixture(scope="session")
def shared_data():
    """The folder of real point clouds next to the checkout; tests skip where it is absent."""
    folder = Path(__file__).resolve().parents[2] / "shared" / "data"
    if not folder.is_dir():
        pytest.skip("the folder shared/data with real point clouds is not beside the checkout")
    return folder


@pytest.fixture
def load(monkeypatch):
    """Imports a module of benchmarks/, which a checkout has."""
    monkeypatch.syspath_prepend(Path(__file__).parents[1] / "benchmarks")
    return import_module


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


@pytest.fixture
def room():
    """A floor and a wall with stray points in the air, numbered by their intensity."""
    rng = np.random.default_rng(0)
    floor = rng.uniform(0, 2, (N_ROOM // 2, 3)) * [1, 1, 0]
    wall = rng.uniform(0, 2, (N_ROOM // 2, 3)) * [1, 0, 1] + [0, 2, 0]
    stray = rng.uniform(0.3, 1.7, (N_STRAY, 3))
    surfaces = np.vstack([floor, wall]) + rng.normal(0, 0.003, (N_ROOM, 3))
    xyz = np.round(np.vstack([surfaces, stray]), 4)
    return PointCloud(xyz, {"intensity": np.arange(len(xyz), dtype=np.uint16)})


@pytest.fixture
def room_file(tmp_path, room):
    path = tmp_path / "room.laz"
    write_points(path, room)
    return path


@pytest.fixture(scope="module")
def chromium():
    """A browser, if one is installed."""
    path = next(filter(None, map(shutil.which, BROWSERS)), None)
    if path is None:
        pytest.skip("no Chromium is installed")
    playwright = pytest.importorskip("playwright.sync_api")
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=path, args=FLAGS)
        yield browser
        browser.close()
