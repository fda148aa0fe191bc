"""
Which detector ranks outliers best?
===================================

A score ranks the points of a cloud. Flag the worst points first: precision is the share of real
outliers among the flagged points, recall is the share of the outliers that are flagged. A perfect
score keeps a precision of 100 % up to a recall of 100 %. No detector here is told the share of
outliers. The dots are the verdicts: of the default detector at its cutoff of 3, of statistical
outlier removal (SOR) at 2 standard deviations above the mean.

A tenth of the points are outliers. A quarter of these are mixed pixels. They lie in sheets as dense
as surfaces, and no detector ranks them before real points.

.. code-block:: bash

    python plot_outlier_precision_recall.py --points 40000
"""

import argparse

import matplotlib.pyplot as plt
from scipy.spatial import cKDTree
from sklearn.ensemble import IsolationForest
from sklearn.metrics import (
    average_precision_score,
    precision_recall_curve,
    precision_score,
    recall_score,
)
from sklearn.neighbors import LocalOutlierFactor

from sklearn_mcmd import MCMDOutlierDetector
from sklearn_mcmd.datasets import make_street

parser = argparse.ArgumentParser()
parser.add_argument("--points", type=int, default=40_000, help="points of each scan")
n_points = parser.parse_args().points

scans = {
    "street of even density": make_street(n_points, random_state=0),
    "street on scan lines": make_street(n_points, sampling="scan_lines", tree=True, random_state=0),
}


def default(X):
    detector = MCMDOutlierDetector(random_state=0).fit(X)
    return -detector.scores_, detector.scores_ < detector.offset_


def removal(X):
    distance = cKDTree(X).query(X, 21)[0][:, 1:].mean(axis=1)
    return distance, distance > distance.mean() + 2 * distance.std()


def lof(X):
    return -LocalOutlierFactor(20).fit(X).negative_outlier_factor_, None


def forest(X):
    return -IsolationForest(random_state=0).fit(X).score_samples(X), None


detectors = {
    "MCMDOutlierDetector()": default,
    "SOR, 20 neighbors": removal,
    "LocalOutlierFactor": lof,
    "IsolationForest": forest,
}

# %%
figure, axes = plt.subplots(1, 2, figsize=(11, 4.5), sharey=True, layout="constrained")
print(f"{'average precision, percent':<34}" + "".join(f"{name:>23}" for name in detectors))
for ax, (title, scan) in zip(axes, scans.items(), strict=True):
    truth = scan.target == -1
    values = []
    for name, judge in detectors.items():
        score, flagged = judge(scan.data)
        precision, recall, _ = precision_recall_curve(truth, score)
        (line,) = ax.plot(100 * recall, 100 * precision, label=name)
        if flagged is not None:
            at = 100 * recall_score(truth, flagged), 100 * precision_score(truth, flagged)
            ax.plot(*at, "o", color=line.get_color())
        values.append(100 * average_precision_score(truth, score))
    print(f"{title:<34}" + "".join(f"{value:23.1f}" for value in values))
    ax.set(title=title, xlabel="recall: outliers flagged (%)", ylim=(0, 103))
    ax.grid(alpha=0.3)
axes[0].set_ylabel("precision: outliers among the flagged (%)")
axes[0].legend(loc="lower left")
plt.show()
