"""
How many neighbors should I take?
=================================

Few neighbors follow the noise. Many neighbors reach across kerbs and frames. 50 is a good start:
about seven points across. Take fewer for narrow things, more for noise. ``"auto"`` chooses for each
point. :ref:`choosing` has a rule.

.. code-block:: bash

    python plot_choose_k.py --points 30000
"""

import argparse

import matplotlib.pyplot as plt
import numpy as np

from sklearn_mcmd import RobustNormalEstimator
from sklearn_mcmd.datasets import make_street
from sklearn_mcmd.metrics import bias_angle
from sklearn_mcmd.plotting import NormalsDisplay

parser = argparse.ArgumentParser()
parser.add_argument("--points", type=int, default=30_000, help="points of the street")
n_points = parser.parse_args().points

street = make_street(n_points, noise=0.008, outlier_share=0.02, random_state=0)
xyz = street.data
known = (street.target == 1) & np.isfinite(street.normals).all(axis=1)
near = street.edge_distance[known] < 0.08
window = (xyz[:, 2] > -0.2) & (xyz[:, 1] > 2.5) & (street.target == 1)

# %%
# The facade with 10, 50 and 300 neighbors. With 10 the noise shows on every wall. With 300 the
# sides of the window and the door have the normals of the wall, and the kerb has those of the road.
sizes = [10, 15, 25, 50, 100, 200, 300]
normals = {k: RobustNormalEstimator(k, random_state=0).fit(xyz).normals_ for k in sizes}
auto = RobustNormalEstimator("auto", random_state=0).fit(xyz)
figure, axes = plt.subplots(2, 2, figsize=(13, 8), layout="constrained")
for ax, k in zip(axes.flat, (10, 50, 300), strict=False):
    NormalsDisplay.from_predictions(xyz[window], normals[k][window], view=(-70, 12), ax=ax)
    ax.set_title(f"{k} neighbors", fontsize=13)
NormalsDisplay.from_predictions(xyz[window], street.normals[window], view=(-70, 12), ax=axes[1, 1])
axes[1, 1].set_title("the true normals", fontsize=13)
plt.show()

# %%
# The mean angle to the true normal. Away from edges more neighbors are better. Near edges there is
# a best number. Stars are "auto", at the median of the numbers that it chose.
figure, ax = plt.subplots(figsize=(7, 4.2), layout="constrained")
print(f"{'neighbors':<12}{'near edges':>12}{'elsewhere':>12}   (mean angle, degrees)")
errors = {k: bias_angle(normals[k][known], street.normals[known]) for k in sizes}
for rows, label, color in ((near, "within 8 cm of an edge", "C3"), (~near, "elsewhere", "C0")):
    ax.plot(sizes, [errors[k][rows].mean() for k in sizes], "o-", color=color, label=label)
    chosen = np.median(auto.n_neighbors_[known][rows])
    error = bias_angle(auto.normals_[known], street.normals[known])[rows].mean()
    ax.plot(chosen, error, "*", ms=14, color=color)
for k in sizes:
    print(f"{k:<12}{errors[k][near].mean():>12.1f}{errors[k][~near].mean():>12.1f}")
error = bias_angle(auto.normals_[known], street.normals[known])
print(f"{'auto':<12}{error[near].mean():>12.1f}{error[~near].mean():>12.1f}")
ax.set(xscale="log", yscale="log", xlabel="neighbors", ylabel="mean angle (degrees)")
ax.set_xticks(sizes, sizes)
ax.minorticks_off()
ax.grid(alpha=0.3)
ax.legend()
plt.show()
