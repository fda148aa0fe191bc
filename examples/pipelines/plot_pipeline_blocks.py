"""
Which number of neighbors suits a whole pipeline?
=================================================

Normals and regions are one object, and `GridSearchCV` asks how many neighbors suit it best. A part
of the street is labelled by hand, in six strips. Each strip is a fold: the pipeline segments it,
and the labels score it. The regions of a strip need no other strip, and nothing learns from labels,
so nothing leaks. Denoising drops rows, which steps of a scikit-learn Pipeline may not, so it comes
before the Pipeline.

.. code-block:: bash

    python plot_pipeline_blocks.py --points 40000
"""

import argparse

import matplotlib.pyplot as plt
import numpy as np
from sklearn.base import clone
from sklearn.model_selection import GridSearchCV
from sklearn.pipeline import make_pipeline

from sklearn_mcmd import MCMDOutlierDetector, RegionGrowing, RobustNormalEstimator
from sklearn_mcmd.datasets import make_street
from sklearn_mcmd.metrics import segmentation_scores
from sklearn_mcmd.plotting import SegmentationDisplay

parser = argparse.ArgumentParser()
parser.add_argument("--points", type=int, default=30_000, help="points of the street")
n_points = parser.parse_args().points

street = make_street(n_points, noise=0.008, random_state=0)
kept = MCMDOutlierDetector(random_state=0).fit_predict(street.data) == 1
X, y = street.data[kept], street.surface[kept]
strips = X[:, 0].argsort().argsort() * 6 // len(X)  # along the street

# %%
# The pipeline, and the search, which reads the labels of each fit. Points of no surface are -1 and
# do not count.
pipeline = make_pipeline(
    RobustNormalEstimator(random_state=0), RegionGrowing(normals="precomputed")
)


def score_segments(pipeline, X, y):
    scores = segmentation_scores(y, pipeline[-1].labels_)
    return {name: scores[name] for name in ("f_score", "adjusted_rand")}


neighbors = [10, 20, 30, 50, 80]
search = GridSearchCV(
    pipeline,
    {"robustnormalestimator__n_neighbors": neighbors},
    scoring=score_segments,
    cv=[(rows, rows) for rows in (np.flatnonzero(strips == strip) for strip in range(6))],
    refit=False,
).fit(X, y)
results = search.cv_results_
best = neighbors[np.argmin(results["rank_test_f_score"])]
print(f"{'neighbors':<12}{'F':>8}{'Rand':>8}")
for k, f, rand in zip(
    neighbors, results["mean_test_f_score"], results["mean_test_adjusted_rand"], strict=True
):
    print(f"{k:<12}{f:>8.3f}{rand:>8.3f}")

# %%
# The strips and the labels; below, the whole street with too few neighbors and with the best
# number.
figure, axes = plt.subplots(2, 2, figsize=(12, 9), layout="constrained")
SegmentationDisplay.from_predictions(X, strips, ax=axes[0, 0])
axes[0, 0].set_title("six strips", fontsize=12)
SegmentationDisplay.from_predictions(X[y >= 0], y[y >= 0], ax=axes[0, 1])
axes[0, 1].set_title("the labels", fontsize=12)
for ax, k in zip(axes[1], (neighbors[0], best), strict=True):
    chosen = clone(pipeline).set_params(robustnormalestimator__n_neighbors=k)
    labels = chosen.fit_predict(X)
    SegmentationDisplay.from_predictions(X, labels, ax=ax)
    ax.set_title(f"{k} neighbors: {labels.max() + 1} regions", fontsize=12)
plt.show()

# %%
# The pipeline with the best number. A notebook shows it as boxes. The question mark of a step leads
# to its page.
pipeline.set_params(robustnormalestimator__n_neighbors=best)
