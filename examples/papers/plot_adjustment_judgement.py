"""
Which plane test should I use?
==============================

The tables show masking (outliers missed) and swamping (good points flagged) of the plane tests, by
the place, number and size of the outliers. The clouds are 200 grid points with unit noise; sigma0
is known and alpha is 0.05. All methods get the same clouds.

The results:

* **Data snooping** (one point at a time, corrected level) is nearly always the best of the
  classical tests, if sigma0 is known.
* **Fuzzy** needs only one adjustment. If outliers and good points are separate groups, it swamps
  far fewer good points than a test that removes all rejected points at once. It is not better than
  data snooping at the same critical value. One huge outlier can mask the others.
  ``weighting="cut"`` prevents this, but swamps more.
* With an **estimated** scale (tau) both find nothing above about 5 % of outliers.
* Outliers **at one edge** tilt the plane. All tests that start from least squares fail there from
  20 to 30 % on. With ``robust_start=True`` 45 % of outliers of 10 sigma are found, and 40 % without
  knowing sigma. Outliers of 5 sigma at one edge are hard for every method from 20 % on.

.. code-block:: bash

    python plot_adjustment_judgement.py --runs 200
"""

import argparse
import itertools
import warnings

import matplotlib.pyplot as plt
import numpy as np
from adjustment_paper import simulate_cloud
from sklearn.linear_model import HuberRegressor, RANSACRegressor

from sklearn_mcmd.adjustment import (
    BaardaPlaneDetector,
    FuzzyPlaneDetector,
    critical_value,
    local_level,
)

parser = argparse.ArgumentParser()
parser.add_argument("--runs", type=int, default=2, help="clouds for each cell")
runs = parser.parse_args().runs

SHAPE = (20, 10)
N = SHAPE[0] * SHAPE[1]
PLACEMENTS = {
    "uniform +": ("uniform", False),
    "uniform +-": ("uniform", True),
    "ring +": ("ring", False),
    "strip +": ("strip", False),
    "corner +": ("corner", False),
}
SHARES = (0.01, 0.05, 0.10, 0.20, 0.30, 0.40, 0.45)
SIZES = (5.0, 10.0, 20.0)
LIMIT = critical_value("w", local_level(0.05, N), N)


def labels(detector):
    return lambda X: detector.fit(X).labels_ == -1


def removed(detector):
    return lambda X: detector.fit(X).elimination_step_ > 0


def ransac(X):
    model = RANSACRegressor(residual_threshold=LIMIT, random_state=0)
    return ~model.fit(X[:, :2], X[:, 2]).inlier_mask_


def huber(X):
    model = HuberRegressor(alpha=0).fit(X[:, :2], X[:, 2])
    return np.abs(X[:, 2] - model.predict(X[:, :2])) > LIMIT * model.scale_


METHODS = {
    "data snooping": labels(BaardaPlaneDetector()),
    "... robust start": labels(BaardaPlaneDetector(robust_start=True, random_state=0)),
    "... sigma0 auto": labels(BaardaPlaneDetector(sigma0="auto")),
    "... both": labels(BaardaPlaneDetector(sigma0="auto", robust_start=True, random_state=0)),
    "... tau": labels(BaardaPlaneDetector(test="tau")),
    "batch, Sidak": removed(BaardaPlaneDetector(elimination="all")),
    "batch, alpha (paper)": removed(BaardaPlaneDetector(correction="none", elimination="all")),
    "Fuzzy, width alpha": labels(FuzzyPlaneDetector(width=0.05)),
    "Fuzzy, width 1": labels(FuzzyPlaneDetector()),
    "Fuzzy, width 1, cut": labels(FuzzyPlaneDetector(weighting="cut")),
    "Fuzzy, tau": labels(FuzzyPlaneDetector(test="tau")),
    "RANSACRegressor": ransac,
    "HuberRegressor": huber,
}

# %%
# The rates of every method in every cell.
warnings.filterwarnings("ignore", message="The tests reject")
cells = list(itertools.product(PLACEMENTS, SHARES, SIZES))
rates = {name: np.zeros((len(cells), 2)) for name in METHODS}
for i, (place, share, size) in enumerate(cells):
    placement, two_sided = PLACEMENTS[place]
    for seed in range(runs):
        outliers = {"placement": placement, "size": size, "two_sided": two_sided}
        X, truth = simulate_cloud(
            round(share * N), shape=SHAPE, noise=1.0, random_state=seed, **outliers
        )
        for name, find in METHODS.items():
            found = find(X)
            rates[name][i] += (~found[truth]).mean() / runs, found[~truth].mean() / runs

# %%
# Masking / swamping, mean over sizes and over shares from 5 to 30 %.
print("masking / swamping, shares 5-30 %, sizes 5-20 sigma")
print(f"{'':<22}" + "".join(f"{place:>15}" for place in PLACEMENTS))
for name in METHODS:
    line = f"{name:<22}"
    for place in PLACEMENTS:
        chosen = [cell[0] == place and 0.05 <= cell[1] <= 0.3 for cell in cells]
        line += "{:>15}".format("{:.3f}/{:.3f}".format(*rates[name][chosen].mean(axis=0)))
    print(line)

# %%
# The largest share of outliers at which at most 15 % of them are missed and at most 7 % of the good
# points are flagged, for outliers of 5, 10 and 20 sigma.
print("\nbreakdown [%] at 5/10/20 sigma")
print(f"{'':<22}" + "".join(f"{place:>15}" for place in PLACEMENTS))
breakdown = {}
for name in METHODS:
    line = f"{name:<22}"
    for place in PLACEMENTS:
        for size in SIZES:
            largest = 0.0
            for share in SHARES:
                missed, flagged = rates[name][cells.index((place, share, size))]
                if missed > 0.15 or flagged > 0.07:
                    break
                largest = share
            breakdown[name, place, size] = 100 * largest
        line += f"{'/'.join(f'{breakdown[name, place, size]:.0f}' for size in SIZES):>15}"
    print(line)

# %%
# A picture for outliers of 10 sigma.
figure, ax = plt.subplots(figsize=(10, 5), layout="constrained")
table = np.array([[breakdown[name, place, 10.0] for place in PLACEMENTS] for name in METHODS])
image = ax.imshow(table, cmap="RdYlGn", vmin=0, vmax=45, aspect="auto")
ax.set_xticks(range(len(PLACEMENTS)), PLACEMENTS)
ax.set_yticks(range(len(METHODS)), METHODS)
for (i, j), value in np.ndenumerate(table):
    ax.text(j, i, f"{value:.0f}", ha="center", va="center")
ax.set_title("Largest share of 10-sigma outliers that is found [%]")
figure.colorbar(image)

# %%
# The effect of a robust start: a strip of 30 % of outliers at one edge, seen from the side.
X, truth = simulate_cloud(60, shape=SHAPE, noise=1.0, placement="strip", size=10.0, random_state=0)
figure, axes = plt.subplots(1, 2, figsize=(11, 4), sharey=True, layout="constrained")
for ax, robust in zip(axes, (False, True), strict=True):
    detector = BaardaPlaneDetector(robust_start=robust, random_state=0).fit(X)
    found = detector.labels_ == -1
    for mask, color in ((~found, "tab:blue"), (found, "tab:red")):
        ax.scatter(X[mask, 0], X[mask, 2] - X[mask, :2] @ [0.3, -0.2], s=8, c=color)
    ends = np.array([0.0, SHAPE[0] - 1])
    middle = X[:, 1].mean()
    slope = detector.coef_ - [0.3, -0.2]
    ax.plot(ends, slope[0] * ends + slope[1] * middle + detector.intercept_, "k")
    ax.set(
        title=f"robust_start={robust}: {found[truth].sum()} of 60 found, "
        f"{found[~truth].sum()} good points flagged",
        xlabel="x",
        ylabel="height above the true plane [sigma]",
    )
plt.show()
