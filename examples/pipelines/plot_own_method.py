"""
How does my own method compare?
===============================

Write it as an outlier detector of scikit-learn: a class with `fit_predict`, or with `score_samples`
as well. Then it goes wherever ours go: into the same scenes, scores, pictures, pipelines and
searches.

The method here is a cell filter, as many tools have it: a point in a cell of 25 cm with fewer than
4 points is an outlier. It is quick, and does well where density is even. Where density falls with
range, it takes more of what is far.

.. code-block:: bash

    python plot_own_method.py --points 30000
"""

import argparse

import matplotlib.pyplot as plt
import numpy as np
from sklearn.base import BaseEstimator, OutlierMixin
from sklearn.metrics import average_precision_score
from sklearn.neighbors import LocalOutlierFactor

from sklearn_mcmd import MCMDOutlierDetector
from sklearn_mcmd.baselines import PlaneOutlierDetector
from sklearn_mcmd.datasets import make_street
from sklearn_mcmd.plotting import OutlierDisplay

parser = argparse.ArgumentParser()
parser.add_argument("--points", type=int, default=15_000, help="points of each scene")
n_points = parser.parse_args().points


# %%
# The method: 12 lines.
class CellFilter(OutlierMixin, BaseEstimator):
    """Points in cells of few points are outliers."""

    def __init__(self, cell=0.25, min_points=4):
        self.cell = cell
        self.min_points = min_points

    def fit(self, X, y=None):
        cells = np.floor(np.asarray(X) / self.cell)
        _, index, counts = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
        self.scores_ = -1.0 / counts[index.ravel()]  # larger is better, as in scikit-learn
        return self

    def fit_predict(self, X, y=None):
        return np.where(self.fit(X).scores_ < -1.0 / self.min_points, -1, 1)


# %%
# Two scenes and four methods, one of them the paper's RANSAC.
scenes = {
    "even street": make_street(n_points, random_state=0),
    "scan lines": make_street(n_points, sampling="scan_lines", tree=True, random_state=0),
}
methods = {
    "CellFilter": CellFilter(),
    "MCMDOutlierDetector": MCMDOutlierDetector(random_state=0),
    "RANSAC planes": PlaneOutlierDetector(method="ransac", random_state=0),
    "LocalOutlierFactor": LocalOutlierFactor(50),
}


def scores_of(method, X):
    for name in ("scores_", "negative_outlier_factor_"):
        if hasattr(method, name):
            return getattr(method, name)
    return method.score_samples(X)


verdicts = {}
print(f"{'found / lost, percent':<24}" + "".join(f"{name:>16}" for name in scenes))
average = {}
for name, method in methods.items():
    cells = []
    for scene, scan in scenes.items():
        wrong = scan.target == -1
        verdict = method.fit_predict(scan.data)
        verdicts[name, scene] = verdict
        scores = scores_of(method, scan.data)
        average[name, scene] = average_precision_score(wrong, -scores)
        found, lost = np.mean(verdict[wrong] == -1), np.mean(verdict[~wrong] == -1)
        cells.append(f"{100 * found:5.1f} / {100 * lost:4.1f}")
    print(f"{name:<24}" + "".join(f"{cell:>16}" for cell in cells))
print(f"\n{'average precision':<24}" + "".join(f"{name:>16}" for name in scenes))
for name in methods:
    print(f"{name:<24}" + "".join(f"{100 * average[name, scene]:>16.1f}" for scene in scenes))

# %%
# The pictures say why. Yellow points are real, and go.
figure, axes = plt.subplots(2, 2, figsize=(14, 10), layout="constrained")
for row, name in zip(axes, ("CellFilter", "MCMDOutlierDetector"), strict=True):
    for ax, (scene, scan) in zip(row, scenes.items(), strict=True):
        OutlierDisplay.from_predictions(
            scan.data, verdicts[name, scene], y_true=scan.target, view="perspective", ax=ax
        )
        ax.set_title(f"{name}, {scene}", fontsize=12)
plt.show()
