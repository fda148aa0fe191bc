"""The first use of an estimator compiles no more functions than it needs."""

import os
import subprocess
import sys

import pytest

pytest.importorskip("numba")

CODE = """
import sys
import numpy as np
import sklearn_mcmd
from numba.core import event

compiled = event.RecordingListener()
event.register("numba:compile", compiled)
X = np.random.default_rng(0).uniform(size=(3000, 3)) * [1, 1, 0.01]
getattr(sklearn_mcmd, sys.argv[1])(n_jobs=1, random_state=0).fit(X)
print(len(compiled.buffer) // 2)
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "most"),
    [
        ("MCMDOutlierDetector", 70),
        ("RobustNormalEstimator", 88),
        ("RegionGrowing", 101),
        ("SharpFeatureDetector", 94),
    ],
)
def test_few_functions_are_compiled(name, most, tmp_path):
    """Counts include Numba's own functions, such as `np.empty`, for each kind of argument."""
    for least, limit in [(1, most), (0, 0)]:  # with an empty cache, then with a full one
        command = [sys.executable, "-c", CODE, name]
        environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
        assert least <= int(done.stdout) <= limit
