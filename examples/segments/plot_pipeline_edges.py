"""
Where are the edges of a noisy roof?
====================================

The Pipeline has two steps, normals and edges. ``SharpFeatureDetector(normals="precomputed")`` takes
the columns of the `RobustNormalEstimator` before it. It drops outliers for its own use. Then it
searches lines in which the planes of two faces meet. With coordinates alone it does both steps
itself.

.. code-block:: bash

    python plot_pipeline_edges.py --points 3000
"""

import argparse

import matplotlib.pyplot as plt
import numpy as np
from sklearn.metrics import f1_score, roc_auc_score
from sklearn.pipeline import make_pipeline

from sklearn_mcmd import RobustNormalEstimator, SharpFeatureDetector
from sklearn_mcmd.datasets import make_crown_roof
from sklearn_mcmd.plotting import plot_cloud

parser = argparse.ArgumentParser()
parser.add_argument("--points", type=int, default=3000, help="points of the roof")
n_points = parser.parse_args().points

roof = make_crown_roof(n_points, outlier_share=0.1, random_state=0)
# The truth: points within two spacings of a ridge. Outliers belong to no edge.
on_edge = np.nan_to_num(roof.edge_distance, nan=np.inf) < 2 * roof.spacing

# %%
# Three ways: a Pipeline, coordinates alone, and the paper's Eq. 25 on PCA's eigenvalues.
detectors = {
    "Pipeline": make_pipeline(
        RobustNormalEstimator(n_neighbors=30, random_state=0),
        SharpFeatureDetector(normals="precomputed", random_state=0),
    ),
    "coordinates": SharpFeatureDetector(random_state=0),
    "Eq. 25, PCA": SharpFeatureDetector(
        30,
        criterion="eigenvalue",
        threshold="mean",
        outlier_detector="passthrough",
        random_state=0,
    ),
}
found = {}
for name, detector in detectors.items():
    found[name] = detector.fit_predict(roof.data) == -1
    area = roc_auc_score(on_edge, -detector.score_samples(roof.data))
    print(f"{name:<12} F1 {f1_score(on_edge, found[name]):.2f}, area under ROC {area:.3f}")

# %%
figure, axes = plt.subplots(2, 2, figsize=(12, 9), layout="constrained")
plot_cloud(roof.data, color="#b8bec9", outliers=on_edge, view=(-60, 45), size=3.0, ax=axes[1, 1])
axes[1, 1].set_title(f"the truth: {on_edge.sum()} points of edges")
for ax, (name, flagged) in zip(axes.flat, found.items(), strict=False):
    plot_cloud(roof.data, color="#b8bec9", outliers=flagged, view=(-60, 45), size=3.0, ax=ax)
    ax.set_title(f"{name}: {flagged.sum()} points of edges")
plt.show()
