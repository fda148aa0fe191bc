"""The first use of an estimator compiles no more functions than it needs."""

import os
import subprocess
import sys

import pytest

from sklearn_mcmd.datasets import make_street
from sklearn_mcmd.io import PointCloud, write_points

# Estimators in turn, each of which needs some functions that those before it have not compiled.
CODE = """
import sys
import numpy as np
import sklearn_mcmd
from numba.core import event

compiled = event.RecordingListener()
event.register("numba:compile", compiled)
X = np.random.default_rng(0).uniform(size=(3000, 3)) * [1, 1, 0.01]
for name in sys.argv[1:]:
    before = len(compiled.buffer)
    getattr(sklearn_mcmd, name)(n_jobs=1, random_state=0).fit(X)
    print((len(compiled.buffer) - before) // 2)
"""


MOST = {
    "MCMDOutlierDetector": 70,
    "RobustNormalEstimator": 22,
    "RegionGrowing": 32,
    "SharpFeatureDetector": 12,
}


@pytest.mark.slow
def test_few_functions_are_compiled(tmp_path):
    """Counts include Numba's own functions, such as `np.empty`, for each kind of argument."""
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
    counts = []
    for _ in range(2):  # with an empty cache, then with a full one
        command = [sys.executable, "-c", CODE, *MOST]
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
        counts.append([int(count) for count in done.stdout.split()])
    for name, count in zip(MOST, counts[0], strict=True):
        assert 1 <= count <= MOST[name], name
    assert counts[1] == [0, 0, 0, 0]


CURVATURES = """
import sys
from hashlib import sha256
import numpy as np
from sklearn_mcmd import RobustNormalEstimator

X = np.load(sys.argv[1])["xyz"][:6000]
estimator = RobustNormalEstimator(features=["max_curvature"], random_state=0).fit(X)
print(sha256(estimator.transform(X).tobytes()).hexdigest())
"""


@pytest.mark.slow
def test_the_process_that_compiles_has_the_results_of_those_that_load(tmp_path, shared_data):
    """On a machined part without noise, whose folds rounding decides."""
    cloud = shared_data / "cad_angle_block" / "cloud.npz"
    command = [sys.executable, "-c", CURVATURES, cloud]
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
    first, second = (
        subprocess.run(command, env=environment, capture_output=True, check=True).stdout
        for _ in range(2)
    )
    assert first == second


VERB = """
import sys
from numba.core import event
from sklearn_mcmd.cli import app

compiled = event.RecordingListener()
event.register("numba:compile", compiled)
app(sys.argv[1:], standalone_mode=False)
print(len(compiled.buffer) // 2)
"""


@pytest.mark.slow
def test_nothing_is_compiled_after_warm_up(tmp_path):
    points = make_street(20_000, outlier_share=0.1, random_state=0).data
    write_points(tmp_path / "street.npy", PointCloud(points[:8_000], {}))
    write_points(tmp_path / "flight.laz", PointCloud(points, {}))
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache")}

    def n_compiled(*arguments):
        command = [sys.executable, "-c", VERB, *map(str, arguments)]
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
        return int(done.stdout.split()[-1])

    assert n_compiled("warm-up", "--quiet") > 50
    for verb in ("denoise", "normals", "segment", "edges"):
        for source in ("street.npy", "flight.laz"):
            out = tmp_path / f"{verb}.{source}"
            assert n_compiled(verb, tmp_path / source, out, "--quiet") == 0, (verb, source)
