"""How long does the first use of each estimator take, with and without compiled code on disk?

Each row is a fresh process: it imports an estimator and fits it to 20,000 points of a street.
Seconds are of the processor and of the clock. `compiled` counts the functions that Numba compiled.

    python benchmarks/bench_first_use.py
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections import namedtuple

CODE = """
import json, sys, time

def now():
    return time.process_time(), time.perf_counter()

name, file = sys.argv[1:]
start = now()
import sklearn_mcmd
estimator = getattr(sklearn_mcmd, name)(n_jobs=1)
imported = now()
import numpy as np
from numba.core import event
X = np.load(file)
compiled = event.RecordingListener()
event.register("numba:compile", compiled)
before = now()
estimator.fit(X)
after = now()
times = [b - a for a, b in zip(start + before, imported + after)]
print(json.dumps([*times, len(compiled.buffer) // 2]))
"""
NAMES = ["MCMDOutlierDetector", "RobustNormalEstimator", "RegionGrowing", "SharpFeatureDetector"]
Times = namedtuple("Times", "import_cpu import_wall fit_cpu fit_wall compiled")


def first_use(name, file, cache):
    """Times of a fresh process."""
    environment = os.environ | {"NUMBA_CACHE_DIR": cache}
    command = [sys.executable, "-c", CODE, name, file]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    return Times(*json.loads(done.stdout))


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--points", type=int, default=20_000)
    options = parser.parse_args(arguments)
    import numpy as np

    from sklearn_mcmd.datasets import make_street

    print("estimator              cache  import: cpu   clock   fit: cpu   clock   compiled")
    with tempfile.TemporaryDirectory() as folder:
        file = os.path.join(folder, "street.npy")
        np.save(file, make_street(options.points, random_state=0).data)
        for name in NAMES:
            cache = os.path.join(folder, name)
            for state in ("empty", "full"):
                own = first_use(name, file, cache)
                print(
                    f"{name:22} {state:5}  {own.import_cpu:11.2f}  {own.import_wall:6.2f}"
                    f"  {own.fit_cpu:9.2f}  {own.fit_wall:6.2f}  {own.compiled:9}",
                    flush=True,
                )


if __name__ == "__main__":
    main()
