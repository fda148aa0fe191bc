"""How long do plane tests take, and how does that grow?

The program fits a plane of n points with a tenth of outliers (fuzzy) or exactly `--removals`
outliers (data snooping, one at a time). It prints seconds, memory for each point besides X itself,
and the exponent of growth from one size to the next (1 is linear). Each measurement runs in its
own process, because peak memory is that of a process.

    python benchmarks/bench_adjustment.py
    python benchmarks/bench_adjustment.py --sizes 10000 100000 --repeats 1
"""

import argparse
import json
import resource
import subprocess
import sys
import time

import numpy as np

METHODS = ("fuzzy", "data snooping", "data snooping, orthogonal", "batch")
KIBIBYTE = 1 if sys.platform == "darwin" else 1024  # unit of ru_maxrss


def cloud(n, n_outliers):
    """Plane z = 0.1 x - 0.2 y of 10 x 10 with noise 0.01 and outliers of 8 to 30 sigma."""
    rng = np.random.default_rng(0)
    X = rng.uniform(0, 10, (n, 3))
    X[:, 2] = 0.1 * X[:, 0] - 0.2 * X[:, 1] + rng.normal(0, 0.01, n)
    X[:n_outliers, 2] += rng.uniform(0.08, 0.3, n_outliers)
    return X


def measure(method, n, removals, repeats):
    """Best of some fits, and the first one's peak memory a point beyond X."""
    from sklearn_mcmd.adjustment import BaardaPlaneDetector, FuzzyPlaneDetector

    detector = {
        "fuzzy": FuzzyPlaneDetector(sigma0=0.01),
        "data snooping": BaardaPlaneDetector(sigma0=0.01),
        "data snooping, orthogonal": BaardaPlaneDetector(sigma0=0.01, surface="orthogonal"),
        "batch": BaardaPlaneDetector(sigma0=0.01, elimination="all"),
    }[method]
    X = cloud(n, n // 10 if method == "fuzzy" else min(removals, n // 5))
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    seconds, peak = [], 0
    for _ in range(repeats):
        start = time.perf_counter()
        detector.fit(X)
        seconds.append(time.perf_counter() - start)
        peak = peak or resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    removed = getattr(detector, "elimination_step_", detector.labels_ < 0)
    return {
        "seconds": min(seconds),
        "bytes": (peak - before) * KIBIBYTE / n,
        "removed": int(np.count_nonzero(removed)),
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sizes", type=int, nargs="+", default=[10**4, 10**5, 10**6, 10**7])
    parser.add_argument("--methods", nargs="+", default=METHODS, choices=METHODS)
    parser.add_argument("--removals", type=int, default=2000)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--one", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.one:
        return print(json.dumps(measure(*json.loads(arguments.one))))

    print(
        f"{'method':<28}{'points':>10}{'seconds':>10}{'growth':>8}{'bytes/pt':>10}{'removed':>10}"
    )
    for method in arguments.methods:
        last = None
        for n in arguments.sizes:
            one = json.dumps([method, n, arguments.removals, arguments.repeats])
            command = [sys.executable, __file__, "--one", one]
            result = json.loads(subprocess.run(command, check=True, capture_output=True).stdout)
            growth = ""
            if last:
                growth = f"{np.log(result['seconds'] / last[1]) / np.log(n / last[0]):.2f}"
            last = n, result["seconds"]
            print(
                f"{method:<28}{n:>10}{result['seconds']:>10.3f}{growth:>8}"
                f"{result['bytes']:>10.0f}{result['removed']:>10}",
                flush=True,
            )
    return None


if __name__ == "__main__":
    main()
