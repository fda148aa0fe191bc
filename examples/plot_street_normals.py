"""
How far do outliers tilt the normals of a street?
=================================================

The cloud is a simulated vehicle scan of a road, a kerb, a facade and a pole. 10 % of its points are
wrong, such as mixed pixels at edges and ghosts. They tilt the normals of plain principal
components, which are also a mean of two faces near an edge. The robust normals are those of the
majority's plane: outliers hardly tilt them, and near an edge they are those of one face.
"""

import matplotlib.pyplot as plt
import numpy as np

from sklearn_mcmd import RobustNormalEstimator
from sklearn_mcmd.datasets import make_street
from sklearn_mcmd.metrics import bias_angle

street = make_street(40_000, random_state=0)
known = (street.target == 1) & np.isfinite(street.normals).all(axis=1)
near = known & (street.edge_distance < 0.08)

fig, axes = plt.subplots(1, 2, figsize=(10, 4), sharey=True, layout="constrained")
for method in ("pca", "mcmd_z", "mcmd_md"):
    estimator = RobustNormalEstimator(method=method, random_state=0, n_jobs=-1).fit(street.data)
    for ax, rows, title in zip(
        axes, (known, near), ("all regular points", "within 8 cm of an edge"), strict=True
    ):
        angles = np.sort(bias_angle(estimator.normals_[rows], street.normals[rows]))
        style = "--" if method == "mcmd_md" else "-"  # it all but covers "mcmd_z"
        ax.plot(angles, np.linspace(0, 100, len(angles)), style, label=method)
        ax.set(
            xscale="log", xlim=(0.1, 90), xlabel="angle to the true normal (degrees)", title=title
        )
        print(f"{title}, {method}: {100 * np.mean(angles < 10):.0f} % within 10 degrees")
axes[0].set_ylabel("points below (%)")
axes[0].legend()
for ax in axes:
    ax.grid(alpha=0.3)
    ax.axvline(10, color="0.6", linewidth=1)
plt.show()
