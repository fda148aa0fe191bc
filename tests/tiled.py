"""Clouds in files and their normals in memory, which those by tiles must equal."""

import os
import subprocess
import sys
from functools import cache
from unittest.mock import patch

import numpy as np
from sklearn.base import clone

from sklearn_mcmd import RobustNormalEstimator
from sklearn_mcmd.datasets import make_street
from sklearn_mcmd.io import PointCloud, read_points, write_points
from sklearn_mcmd.io._point_cloud import with_results
from sklearn_mcmd.tiling import _run, process_files
from sklearn_mcmd.tiling._result_files import normal_columns

# Few neighbors, so that little lies around small tiles.
ESTIMATOR = RobustNormalEstimator(16, random_state=0)


def street(n, seed=0):
    """A part of a street in national coordinates, in millimeters, with copies and attributes."""
    xyz = np.round(_made(n, seed) + np.array([362_000, 5_157_000, 100]), 3)
    xyz[-50:] = xyz[:50]
    return PointCloud(xyz, {"intensity": np.arange(n).astype(np.uint16)})


@cache
def _made(n, seed):
    return make_street(n, outlier_share=0.03, random_state=seed).data


def in_memory(source, target, estimator=ESTIMATOR):
    """Write what a run by tiles must equal."""
    cloud = read_points(source)
    names, columns = normal_columns(clone(estimator).fit(cloud.xyz))
    write_points(target, with_results(cloud, dict(zip(names, columns.T.copy(), strict=True))))
    return target


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


def divide(source, target, estimator, *, cut=0.5, **options):
    """`process_files` with tiles that begin elsewhere: `cut` is the share left of a division."""
    with patch.object(_run, "CUT", cut):
        return process_files(source, target, estimator, **options)
