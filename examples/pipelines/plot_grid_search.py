"""
Which parameters find the most outliers, and do other detectors do better?
==========================================================================

`GridSearchCV` searches ``n_neighbors``, ``max_outlier_rate`` and ``success_probability`` on a
labeled, simulated street. `LocalOutlierFactor` and `IsolationForest` are candidates in the same
search.

**The split.** A local detector judges a point by its neighbors. Random folds fit on a thinned
cloud. Blocks as groups score the points of a block by a cloud with a hole there. Both measure
another task. So all points are fitted and scored, ``cv=[(rows, rows)]``. No detector sees the truth
while it is fitted, so nothing leaks.

.. code-block:: bash

    python plot_grid_search.py --points 8000
"""

import argparse

import matplotlib.pyplot as plt
import numpy as np
from sklearn.base import clone
from sklearn.ensemble import IsolationForest
from sklearn.metrics import balanced_accuracy_score, roc_auc_score
from sklearn.model_selection import GridSearchCV
from sklearn.neighbors import LocalOutlierFactor
from sklearn.pipeline import Pipeline

from sklearn_mcmd import MCMDOutlierDetector
from sklearn_mcmd.datasets import make_street
from sklearn_mcmd.plotting import OutlierDisplay

parser = argparse.ArgumentParser()
parser.add_argument("--points", type=int, default=8000, help="points of each street")
n_points = parser.parse_args().points
SCORES = ["balanced_accuracy", "roc_auc"]

street = make_street(n_points, outlier_share=0.1, random_state=0)
X, y = street.data, street.target

# %%
# The search. Outlier rate and success probability only set the number of trials. A detector with
# 6 trials is nearly as good here as one with 69. The number of neighbors matters, and so does
# whether a point is judged by its own plane, as in the paper, or by surfaces and groups.
neighbors = [10, 20, 30, 50]
rate = {
    "detector__max_outlier_rate": [0.2, 0.5],
    "detector__success_probability": [0.95, 0.9999],
}
families = {
    "MCMD, own planes": (
        MCMDOutlierDetector(strictness=None, random_state=0),
        {"detector__n_neighbors": neighbors, **rate},
    ),
    "MCMD, surfaces and groups": (
        MCMDOutlierDetector(random_state=0),
        {
            "detector__n_neighbors": neighbors,
            "detector__strictness": ["isolated", "groups", "surfaces"],
        },
    ),
    "LocalOutlierFactor": (
        LocalOutlierFactor(novelty=True),
        {"detector__n_neighbors": neighbors, "detector__contamination": ["auto", 0.1]},
    ),
    "IsolationForest": (
        IsolationForest(random_state=0),
        {"detector__max_samples": [256, 1000], "detector__contamination": ["auto", 0.1]},
    ),
}
rows = np.arange(len(X))
search = GridSearchCV(
    Pipeline([("detector", MCMDOutlierDetector())]),
    [{"detector": [model], **grid} for model, grid in families.values()],
    scoring=SCORES,
    refit="balanced_accuracy",
    cv=[(rows, rows)],
).fit(X, y)

# %%
# The best of each family, and its scores on a street that the search has not seen.
results = search.cv_results_
kinds = np.array([id(params["detector"]) for params in results["params"]])
unseen = make_street(n_points, outlier_share=0.1, random_state=1)
best, verdicts = {}, {}
print(f"\n{'best of each family':<28}{'search':>14}{'unseen street':>20}")
for name, (model, _) in families.items():
    rows = np.flatnonzero(kinds == id(model))
    row = rows[np.argmax(results["mean_test_balanced_accuracy"][rows])]
    params = {k.removeprefix("detector__"): v for k, v in results["params"][row].items()}
    del params["detector"]
    chosen = clone(model).set_params(**params)
    if isinstance(chosen, LocalOutlierFactor):  # scikit-learn requires this for training data
        chosen.set_params(novelty=False)
        labels = chosen.fit_predict(unseen.data)
        scores = chosen.negative_outlier_factor_
    else:
        labels = chosen.fit(unseen.data).predict(unseen.data)
        scores = chosen.decision_function(unseen.data)
    searched = [results[f"mean_test_{score}"][row] for score in SCORES]
    final = [balanced_accuracy_score(unseen.target, labels), roc_auc_score(unseen.target, scores)]
    best[name] = (searched, final)
    verdicts[name] = labels
    print(f"{name:<28}{searched[0]:>7.3f}{searched[1]:>7.3f}{final[0]:>13.3f}{final[1]:>7.3f}")
    print(f"    {params}")

# %%
# The verdicts of the best of each family on that street.
figure, axes = plt.subplots(2, 2, figsize=(12, 9), layout="constrained")
OutlierDisplay.from_predictions(unseen.data, unseen.target, ax=axes[1, 1])
axes[1, 1].set_title("the truth", fontsize=13)
shown = [name for name in families if name != "MCMD, own planes"]
for ax, name in zip(axes.flat, shown, strict=False):
    OutlierDisplay.from_predictions(unseen.data, verdicts[name], y_true=unseen.target, ax=ax)
    ax.set_title(name, fontsize=13)
plt.show()

# %%
figure, axes = plt.subplots(1, 2, figsize=(11, 4), layout="constrained")
for name, (model, grid) in families.items():
    if "detector__n_neighbors" not in grid:
        continue
    rows = np.flatnonzero(kinds == id(model))
    k = np.array([results["params"][row]["detector__n_neighbors"] for row in rows])
    scores = results["mean_test_balanced_accuracy"][rows]
    (line,) = axes[0].plot(
        neighbors, [scores[k == size].max() for size in neighbors], "-", label=name
    )
    axes[0].plot(k, scores, ".", color=line.get_color())
axes[0].set(
    xlabel="n_neighbors", ylabel="balanced accuracy", title="All candidates; lines: the best"
)
axes[0].legend(loc="upper center", bbox_to_anchor=(0.5, -0.15), ncols=2, fontsize=8)
place = np.arange(len(best))
for shift, which, label in ((-0.2, 0, "balanced accuracy"), (0.2, 1, "ROC-AUC")):
    axes[1].barh(place + shift, [final[which] for _, final in best.values()], 0.38, label=label)
axes[1].set_yticks(place, list(best))
axes[1].invert_yaxis()
axes[1].set(xlim=(0.5, 1.0), title="The best of each family on an unseen street")
figure.legend(*axes[1].get_legend_handles_labels(), loc="outside lower right", ncols=2)
plt.show()
