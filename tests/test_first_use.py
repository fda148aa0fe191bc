"""The first use of an estimator compiles no more functions than it needs."""

import os
import subprocess
import sys

import pytest

pytestmark = pytest.mark.slow
# Estimators in turn, each of which needs some functions that those before it have not compiled;
# then curvatures of a machined part without noise, whose folds rounding decides.
ESTIMATORS = """
import sys
from hashlib import sha256
import numpy as np
import sklearn_mcmd
from numba.core import event

compiled = event.RecordingListener()
event.register("numba:compile", compiled)
X = np.random.default_rng(0).uniform(size=(3000, 3)) * [1, 1, 0.01]
for name in sys.argv[2:]:
    before = len(compiled.buffer)
    getattr(sklearn_mcmd, name)(n_jobs=1, random_state=0).fit(X)
    print((len(compiled.buffer) - before) // 2)
X = np.load(sys.argv[1])["xyz"][:6000]
estimator = sklearn_mcmd.RobustNormalEstimator(features=["max_curvature"], random_state=0).fit(X)
print(sha256(estimator.transform(X).tobytes()).hexdigest())
"""
# Of Numba's own functions, such as `np.empty`, there is one for each kind of argument.
MOST = {
    "MCMDOutlierDetector": 80,
    "RobustNormalEstimator": 9,
    "RegionGrowing": 25,
    "SharpFeatureDetector": 3,
}


def printed(cache, code, *arguments):
    """The words that a process prints whose compiled functions are kept in a folder."""
    done = subprocess.run(
        [sys.executable, "-c", code, *map(str, arguments)],
        env=os.environ | {"NUMBA_CACHE_DIR": str(cache)},
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.split()


def test_few_functions_are_compiled_once_and_give_what_loaded_ones_give(tmp_path, shared_data):
    cloud = shared_data / "cad_angle_block" / "cloud.npz"
    *counts, first = printed(tmp_path, ESTIMATORS, cloud, *MOST)
    *later_counts, second = printed(tmp_path, ESTIMATORS, cloud, *MOST)
    for name, count in zip(MOST, counts, strict=True):
        assert 1 <= int(count) <= MOST[name], name
    assert later_counts == ["0", "0", "0", "0"]
    assert first == second
