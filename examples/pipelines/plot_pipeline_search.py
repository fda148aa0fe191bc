"""
Which angle and how many neighbors segment a street best?
=========================================================

`GridSearchCV` searches ``segment__max_angle`` and ``normals__n_neighbors`` of a Pipeline of normals
and segments, on simulated streets whose surfaces are known.

**Folds and scorer.** Segments are found in a whole cloud, without labels. So a fold is a whole
scene, which is fitted and scored. Clusterers cannot `predict`, so the scorer reads the labels of
the fit. With ``memory`` the normals of a scene are computed once for all angles. ``refit=False`` is
needed, because scenes in one array lie on top of each other. The winner is judged on a street that
the search has not seen.

.. code-block:: bash

    python plot_pipeline_search.py --points 25000
"""

import argparse
from tempfile import TemporaryDirectory

import matplotlib.pyplot as plt
import numpy as np
from sklearn.base import clone
from sklearn.model_selection import GridSearchCV
from sklearn.pipeline import Pipeline

from sklearn_mcmd import RegionGrowing, RobustNormalEstimator
from sklearn_mcmd.datasets import make_street
from sklearn_mcmd.metrics import segmentation_scores
from sklearn_mcmd.plotting import SegmentationDisplay

parser = argparse.ArgumentParser()
parser.add_argument("--points", type=int, default=15_000, help="points of each street")
n_points = parser.parse_args().points

streets = [make_street(n_points, outlier_share=0.0, random_state=seed) for seed in range(3)]
X = np.vstack([street.data for street in streets[:2]])
y = np.hstack([street.surface for street in streets[:2]])
SCORES = ["f_score", "adjusted_rand", "mean_iou"]


def score_segments(pipeline, X, surface):
    scores = segmentation_scores(surface, pipeline[-1].labels_)
    return {name: scores[name] for name in SCORES}


# %%
# The search computes several scores and ranks the candidates by each.
angles, neighbors = [5.0, 10.0, 15.0, 25.0, 40.0], [15, 30, 50]
with TemporaryDirectory() as cache:
    pipeline = Pipeline(
        [
            ("normals", RobustNormalEstimator(random_state=0)),
            ("segment", RegionGrowing(normals="precomputed")),
        ],
        memory=cache,
    )
    search = GridSearchCV(
        pipeline,
        {"segment__max_angle": angles, "normals__n_neighbors": neighbors},
        scoring=score_segments,
        cv=[(rows, rows) for rows in np.arange(2 * n_points).reshape(2, n_points)],
        refit=False,
    ).fit(X, y)

# %%
# The best by F (Eq. 28), by adjusted Rand index and by mean intersection over union, each judged on
# the unseen street.
results = search.cv_results_
unseen = streets[2]
pipeline.set_params(memory=None)
print(f"{'ranked by':<16}{'search':>8}{'unseen':>8}   parameters")
for name in SCORES:
    best = np.argmin(results[f"rank_test_{name}"])
    params = results["params"][best]
    chosen = clone(pipeline).set_params(**params).fit(unseen.data)
    final = score_segments(chosen, unseen.data, unseen.surface)
    searched = results[f"mean_test_{name}"][best]
    print(f"{name:<16}{searched:>8.3f}{final[name]:>8.3f}   {params}")
default = score_segments(pipeline.fit(unseen.data), unseen.data, unseen.surface)
print("defaults, unseen:", {name: round(value, 3) for name, value in default.items()})

# %%
# The unseen street with a small angle, the best one and a large one. With 5 degrees some narrow
# faces belong to none. From 10 degrees on little changes, because neighbors are linked only where
# their planes explain each other.
best_params = results["params"][np.argmin(results["rank_test_f_score"])]
changes = [{"segment__max_angle": 5.0}, {}, {"segment__max_angle": 40.0}]
figure, axes = plt.subplots(2, 2, figsize=(12, 9), layout="constrained")
SegmentationDisplay.from_predictions(unseen.data, unseen.surface, ax=axes[1, 1])
axes[1, 1].set_title("the truth", fontsize=13)
for ax, change in zip(axes.flat, changes, strict=False):
    chosen = clone(pipeline).set_params(**best_params | change)
    labels = chosen.fit_predict(unseen.data)
    SegmentationDisplay.from_predictions(unseen.data, labels, ax=ax)
    angle = chosen.get_params()["segment__max_angle"]
    ax.set_title(f"max_angle={angle:g}: {labels.max() + 1} regions", fontsize=13)
plt.show()

# %%
# The scores of all candidates.
figure, axes = plt.subplots(1, 2, figsize=(11, 4), layout="constrained", sharex=True)
chosen = np.array([params["normals__n_neighbors"] for params in results["params"]])
for ax, name in zip(axes, ("f_score", "adjusted_rand"), strict=True):
    for k in neighbors:
        ax.plot(angles, results[f"mean_test_{name}"][chosen == k], "o-", label=f"{k} neighbors")
    ax.set(xlabel="max_angle, degrees", ylabel=name.replace("_", " "), ylim=(0, 1.02))
axes[1].legend(title="of the normals")
plt.show()
