"""
Do LocalOutlierFactor and IsolationForest find the same points?
===============================================================

No. All three get the same street of even density, with a tree. Scikit-learn's two detectors are
told how many outliers there are. The default of this package is not.

LocalOutlierFactor compares densities. It finds single points, and takes corners and leaves for
outliers as well. IsolationForest cuts the cloud by random planes. It flags what is far from the
middle, such as the far end of the wall. MCMDOutlierDetector asks whether a surface or other points
explain a point.

.. code-block:: bash

    python plot_compare_detectors.py --points 25000
"""

import argparse

import matplotlib.pyplot as plt
from sklearn.ensemble import IsolationForest
from sklearn.metrics import average_precision_score
from sklearn.neighbors import LocalOutlierFactor

from sklearn_mcmd import MCMDOutlierDetector
from sklearn_mcmd.datasets import make_street
from sklearn_mcmd.plotting import OutlierDisplay

parser = argparse.ArgumentParser()
parser.add_argument("--points", type=int, default=25_000, help="points of the street")
n_points = parser.parse_args().points

street = make_street(n_points, tree=True, outlier_share=0.05, random_state=0)
xyz, truth = street.data, street.target
share = 0.05

# %%
detectors = {
    "MCMDOutlierDetector, told nothing": MCMDOutlierDetector(random_state=0),
    "LocalOutlierFactor, told the share": LocalOutlierFactor(20, contamination=share),
    "IsolationForest, told the share": IsolationForest(contamination=share, random_state=0),
}
figure, axes = plt.subplots(2, 2, figsize=(12, 9), layout="constrained")
OutlierDisplay.from_predictions(xyz, truth, ax=axes[0, 0])
axes[0, 0].set_title("the truth", fontsize=12)
for ax, (name, detector) in zip(axes.flat[1:], detectors.items(), strict=True):
    labels = detector.fit_predict(xyz)
    if isinstance(detector, LocalOutlierFactor):
        scores = -detector.negative_outlier_factor_
    else:
        scores = -detector.score_samples(xyz)
    found = ((labels == -1) & (truth == -1)).sum() / (truth == -1).sum()
    right = ((labels == -1) & (truth == -1)).sum() / (labels == -1).sum()
    precision = average_precision_score(truth == -1, scores)
    print(
        f"{name:<36} finds {100 * found:4.1f} %, {100 * right:4.1f} % of the flagged are outliers, "
        f"average precision {100 * precision:4.1f} %"
    )
    OutlierDisplay.from_predictions(xyz, labels, y_true=truth, ax=ax)
    ax.set_title(name, fontsize=12)
plt.show()
