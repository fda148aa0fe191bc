"""
How good are normals near edges?
================================

Least squares (PCA) mixes the faces of an edge, and each outlier tilts the normals around it. Robust
normals are those of one face. The picture shows the angle to the true normal at each point of a
simulated street: road, kerb, footpath, facade with a window and a door, a sign and a pole. A tenth
of its points are wrong; they are left out of the picture, but not of the neighborhoods.

``n_neighbors="auto"`` gives each point its own number of neighbors, by its noise. Here it takes
about 30. Faces are a little noisier, and the thin post of the sign is better. It pays most on
machined parts and on noisy scans.

.. code-block:: bash

    python plot_street_normals.py --points 60000
"""

import argparse

import matplotlib.pyplot as plt
import numpy as np

from sklearn_mcmd import RobustNormalEstimator
from sklearn_mcmd.datasets import make_street
from sklearn_mcmd.metrics import bias_angle
from sklearn_mcmd.plotting import NormalsDisplay, plot_cloud

parser = argparse.ArgumentParser()
parser.add_argument("--points", type=int, default=50_000, help="points of the street")
n_points = parser.parse_args().points

street = make_street(n_points, random_state=0)
known = (street.target == 1) & np.isfinite(street.normals).all(axis=1)
near = known & (street.edge_distance < 0.08)
estimators = {
    "PCA, 50 neighbors": RobustNormalEstimator(method="pca"),
    "robust, 50 neighbors": RobustNormalEstimator(random_state=0),
    'robust, "auto"': RobustNormalEstimator("auto", random_state=0),
}
angles = {
    name: bias_angle(estimator.fit(street.data).normals_[known], street.normals[known])
    for name, estimator in estimators.items()
}

# %%
# The last picture has the true normals as colors.
figure, axes = plt.subplots(2, 2, figsize=(13, 9), layout="constrained")
shade = plt.cm.ScalarMappable(plt.Normalize(0, 30), "magma_r")
for ax, (name, angle) in zip(axes.flat, angles.items(), strict=False):
    plot_cloud(street.data[known], color=shade.to_rgba(angle)[:, :3], view="perspective", ax=ax)
    ax.set_title(name, fontsize=13)
NormalsDisplay.from_predictions(street.data[known], street.normals[known], ax=axes[1, 1])
axes[1, 1].set_title("the true normals", fontsize=13)
figure.colorbar(
    shade, ax=axes, shrink=0.7, label="angle to the true normal (degrees)", extend="max"
)
plt.show()

# %%
# The same as curves, for all points and for those beside an edge.
figure, axes = plt.subplots(1, 2, figsize=(11, 4), sharey=True, layout="constrained")
for ax, rows, title in (
    (axes[0], known[known], "all real points"),
    (axes[1], near[known], "within 8 cm of an edge"),
):
    for name, angle in angles.items():
        chosen = np.sort(angle[rows])
        ax.plot(chosen, np.linspace(0, 100, len(chosen)), label=name)
        print(f"{title}, {name}: {100 * np.mean(chosen < 10):.0f} % within 10 degrees")
    ax.set(xscale="log", xlim=(0.1, 90), xlabel="angle to the true normal (degrees)", title=title)
    ax.axvline(10, color="0.6", linewidth=1)
    ax.grid(alpha=0.3)
axes[0].set_ylabel("points below (%)")
axes[0].legend()
plt.show()
