"""Table 1 and Figure 5 of the first paper, the comparators' rows, by many runs.

The rows of all methods, and Table 4, are in `tests/paper/test_experiments.py`.

The expected figures are those of a replication with independent code, or the paper's own where
that one did not reach them. ROBPCA's reading of the paper is the nearest of twelve variants, so
that its rows hold the code and do not prove the reading; see docs/reproduction.rst.

Bounds are four standard errors of the difference of two Monte-Carlo means, from the standard
deviations beside them. Rows are in random order: all
samples share one table of trials, which must not meet the outliers at the same positions each
time.
"""

from functools import cache

import numpy as np
import pytest

from sklearn_mcmd.baselines import Msac, Pca, Qsp, Ransac, Robpca
from sklearn_mcmd.datasets import make_contaminated_plane
from sklearn_mcmd.metrics import bias_angle

pytestmark = pytest.mark.slow
RUNS = 800
THEIRS = 1000
ERROR = 4 * np.sqrt(1 / RUNS + 1 / THEIRS)
# The paper typed the variance of the noise as its standard deviation.
ZULIANI = {"noise_scale": 0.01, "degrees_of_freedom": 3, "n_refits": 0}
OLD_MCD = {"small_sample": False, "consistency": "quantile"}


@cache
def simulated(n, share, outliers="clustered", runs=RUNS):
    """Points, their clean twins (runs, n, 3) and labels (runs, n)."""
    twins = [
        make_contaminated_plane(
            n,
            outlier_share=share,
            outliers=outliers,
            return_X_y=False,
            random_state=run,
        )
        for run in range(runs)
    ]
    orders = [np.random.default_rng(run).permutation(n) for run in range(runs)]
    return tuple(
        np.array([twin[name][rows] for twin, rows in zip(twins, orders, strict=True)])
        for name in ("data", "clean", "target")
    )


@cache
def bias_angles(method, outliers, **params):
    data, clean, _ = simulated(50, 0.2, outliers)
    # The clean twin's trials are others, as they were in the paper.
    normals = (
        method(**params).fit(X, random_state=seed).normals for seed, X in enumerate((data, clean))
    )
    return bias_angle(*normals)


def rates(method, share, **params):
    """Mean TPR and TNR in percent."""
    data, _, y = simulated(100, share)
    inliers = method(**params).fit(data, random_state=0).inliers
    return 100 * (~inliers[y == -1]).mean(), 100 * inliers[y == 1].mean()


@pytest.mark.parametrize(
    ("method", "params", "outliers", "mean", "median", "deviation"),
    [
        (Pca, {}, "clustered", 34.350, 33.988, 4.050),
        (Ransac, ZULIANI, "clustered", 1.214, 0.872, 1.166),
        (Msac, ZULIANI, "clustered", 1.140, 0.687, 1.215),  # the paper
        (Msac, ZULIANI, "uniform", 1.157, 0.730, 1.202),  # the paper
        (Robpca, OLD_MCD, "clustered", 0.694, 0.599, 0.489),  # the paper
        (Robpca, OLD_MCD, "clustered", 0.663, 0.547, 0.487),
        (Robpca, {"n_components": 2}, "clustered", 0.545, 0.444, 0.410),  # rrcov
    ],
)
def test_table_1_is_reproduced(method, params, outliers, mean, median, deviation):
    angles = bias_angles(method, outliers, **params)
    assert abs(angles.mean() - mean) < ERROR * deviation
    assert abs(np.median(angles) - median) < 1.25 * ERROR * deviation
    assert abs(angles.std() - deviation) < ERROR * deviation


@pytest.mark.parametrize("share", [0.05, 0.2, 0.4])
def test_ransac_with_the_right_noise_keeps_its_inliers(share):
    """96 to 98 % by the plane of three points, and the quantile's 99 % once it is refitted."""
    found, kept = rates(Ransac, share, noise_scale=0.1, n_refits=0)
    assert found > 99.95
    assert 95.5 < kept < 98.5
    found, kept = rates(Ransac, share, noise_scale=0.1)
    assert found > 99.95
    assert 98.7 < kept < 99.5


def breakdown(method, shares, failures, **params):
    """The first percentage at which that part of 100 runs is off by more than 5 degrees."""
    for percent in shares:
        data, _, _ = simulated(100, percent / 100, runs=100)
        normals = method(**params).fit(data, random_state=0).normals
        if (bias_angle(normals, [0, 0, 1]) > 5).mean() >= failures:
            return percent
    return None


def test_ransac_breaks_down_between_64_and_70_percent():
    """The replication, threshold .0258: fails in 5 % of the runs at 64, in 18 % at 70."""
    params = {"noise_scale": 0.01, "n_refits": 0}
    first = breakdown(Ransac, range(56, 80, 2), 0.05, **params)
    assert 62 <= first <= 68
    assert first < breakdown(Ransac, range(60, 80, 2), 0.18, **params) <= 72


@pytest.mark.parametrize(
    ("outliers", "mean", "median", "deviation"),
    [("clustered", 27.19, 34.09, 16.64), ("uniform", 6.97, 4.44, 7.91)],
)
def test_qsp_with_a_sample_of_five_is_as_replicated(outliers, mean, median, deviation):
    """A sample of five has no outlier in every third run: two modes, 0 and 34 degrees."""
    angles = bias_angles(Qsp, outliers, sample_size=5, contamination=0.2)
    assert abs(angles.mean() - mean) < ERROR * deviation
    assert abs(np.median(angles) - median) < 2 * ERROR * deviation
