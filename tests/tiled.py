"""Clouds in files, results in memory to compare with, and runs that are killed."""

import os
import subprocess
import sys
from functools import cache

import numpy as np
from sklearn.base import clone

from sklearn_mcmd import (
    MCMDOutlierDetector,
    RegionGrowing,
    RobustNormalEstimator,
    SharpFeatureDetector,
)
from sklearn_mcmd.datasets import make_street
from sklearn_mcmd.io import PointCloud, read_points, write_points
from sklearn_mcmd.tiling import process_files
from sklearn_mcmd.tiling._verbs import normal_columns

# Few neighbors, so that the halo of small cells is narrow.
ESTIMATOR = RobustNormalEstimator(16, random_state=0)
PCA = RobustNormalEstimator(16, method="pca", random_state=0)  # where results do not matter
OUTLIERS = MCMDOutlierDetector(16, random_state=0)
TREE = RobustNormalEstimator(16, orientation="mst", features="all", random_state=0)
REGIONS = RegionGrowing(20, normal_estimator=RobustNormalEstimator(24, random_state=0))
EDGES = SharpFeatureDetector(12, random_state=0)
VERBS = {"outliers": OUTLIERS, "normals": ESTIMATOR, "tree": TREE, "regions": REGIONS}
VERBS["edges"] = EDGES


def but(estimator, **params):
    """An estimator with some other parameters."""
    return clone(estimator).set_params(**params)


def street(n, seed=0):
    """A part of a street in national coordinates, in millimeters, with copies and attributes."""
    xyz = np.round(_made(n, seed) + np.array([362_000, 5_157_000, 100]), 3)
    xyz[-50:] = xyz[:50]
    return PointCloud(xyz, {"intensity": np.arange(n).astype(np.uint16)})


@cache
def _made(n, seed):
    return make_street(n, outlier_share=0.03, random_state=seed).data


def shining_street(n):
    """A street without copies, where stray points are dark."""
    cloud, rng = street(n + 50).subset(slice(0, n)), np.random.default_rng(0)
    off, xyz = cloud.xyz[:, 2] > 101.5, cloud.xyz.copy()
    xyz[off] += rng.normal(0, 1.0, (off.sum(), 3))
    light = np.where(off, rng.integers(0, 9, n), rng.integers(5, 200, n)).astype(np.uint16)
    return PointCloud(np.round(xyz, 3), {"intensity": light})


def written(folder, cloud):
    """A file of points or a cloud."""
    write_points(folder / "a.las", cloud)
    return folder / "a.las"


def two_files(folder, cloud):
    """A folder in which a cloud has a file for each of its halves, and these as they are read."""
    left = cloud.xyz[:, 0] < np.median(cloud.xyz[:, 0])
    (folder / "in").mkdir()
    parts = []
    for name, rows in {"a.laz": left, "b.las": ~left}.items():
        write_points(folder / "in" / name, cloud.subset(rows))
        parts.append(read_points(folder / "in" / name))
    return folder / "in", parts


def names_in(folder):
    return sorted(path.name for path in folder.iterdir())


def goes_on(source, target, estimator=PCA, **options):
    """The report of a run, whose output is that of an undisturbed one, and nothing else is left."""
    report = process_files(source, target, estimator, **options)
    asked = hash(source.read_bytes()), target.suffix, repr(estimator), repr(options)
    if asked not in _undisturbed:
        expected = target.with_name(f"expected{target.suffix}")
        process_files(source, expected, estimator, **options)
        _undisturbed[asked] = expected.read_bytes()
        expected.unlink()
    assert target.read_bytes() == _undisturbed[asked]
    assert not list(target.parent.glob("*.tiles"))
    return report


_undisturbed: dict = {}  # outputs of runs that were asked for before


def fit_in_memory(xyz, estimator=ESTIMATOR, **given):
    """An estimator fitted as by tiles: in single precision, if the file has it."""
    single = xyz.astype(np.float32)
    return clone(estimator).fit(single if np.array_equal(single, xyz) else xyz, **given)


def values_of(fitted):
    """The results of a fitted estimator, as those by tiles are before they are written."""
    if isinstance(fitted, RegionGrowing):
        return fitted.labels_[:, None]
    if isinstance(fitted, RobustNormalEstimator):
        return normal_columns(fitted)[1]
    sign = -1 if isinstance(fitted, MCMDOutlierDetector) else 1
    return sign * fitted.scores_[:, None]


# A run that kills itself when a function of a module of tiling is called once too often.
RUN = """
import os, signal, sys
from importlib import import_module
from sklearn_mcmd import *
from sklearn_mcmd.tiling import process_files

source, target, place, n_calls, estimator, options = sys.argv[1:]
module, *owners, name = place.split(".")
owner = import_module("sklearn_mcmd.tiling." + module)
for attribute in owners:
    owner = getattr(owner, attribute)
work, calls = getattr(owner, name), []

def die_late(*args, **kwargs):
    calls.append(name)
    if len(calls) > int(n_calls):
        os.kill(os.getpid(), getattr(signal, "SIGKILL", signal.SIGTERM))
    return work(*args, **kwargs)

setattr(owner, name, die_late)
process_files(source, target, eval(estimator), **eval(options))
"""


def run_is_killed(source, target, place, n_calls, estimator, **options):
    """If a run is killed at a place, ``"module.function"``, after so many calls of it."""
    return is_killed(RUN, source, target, place, n_calls, repr(estimator), repr(options))


def is_killed(code, *arguments):
    """If a process that runs the code is killed: a fork of this one, which has all imports."""
    arguments = [str(argument) for argument in arguments]
    if sys.platform != "linux":
        return subprocess.run([sys.executable, "-c", code, *arguments]).returncode not in (0, 1)
    child = os.fork()
    if child == 0:
        try:
            sys.argv[1:] = arguments
            exec(code, {})
        finally:
            os._exit(1)
    return os.WIFSIGNALED(os.waitpid(child, 0)[1])
