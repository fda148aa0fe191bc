"""
Which neighbors does a robust plane trust?
==========================================

Those of the majority that lie in one plane. Beside an edge the 50 neighbors of a point lie on two
faces. Least squares (PCA) trusts all of them and cuts the corner. The robust plane trusts the face
that most of the neighbors lie on, and lets the others go. Outliers go the same way.
"""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.lines import Line2D
from sklearn.neighbors import NearestNeighbors

from sklearn_mcmd import RobustNormalEstimator
from sklearn_mcmd.datasets import make_box
from sklearn_mcmd.metrics import bias_angle
from sklearn_mcmd.plotting import NormalsDisplay, normal_colors, plot_cloud

TRUSTED, LEFT, PCA, OURS = "#0072b2", "#e69f00", "#d55e00", "#009e73"

# %%
# Three faces of a box, and a few wrong points. The example point lies 1.5 spacings from an edge.
box = make_box(6000, noise=0.004, outlier_share=0.03, outlier_scale=0.05, random_state=0)
xyz = box.data
pca = RobustNormalEstimator(method="pca").fit(xyz)
ours = RobustNormalEstimator(random_state=0).fit(xyz)

regular = (box.target == 1) & (np.abs(box.normals[:, 2]) > 0.9)
edge = np.abs(box.edge_distance - 1.5 * box.spacing) + np.linalg.norm(
    xyz[:, [0]] - np.median(xyz[:, 0]), axis=1
)
point = np.argmin(np.where(regular, edge, np.inf))
neighbors = NearestNeighbors(n_neighbors=50).fit(xyz).kneighbors(xyz[[point]])[1][0]

# %%
# The section across the edge. Lines are the planes of both methods through their centers.
columns = ours.transform(xyz)[point]
normal, offset, scale = ours.normals_[point], columns[10], columns[11]
off = np.abs((xyz[neighbors] - xyz[point]) @ normal)
trusted = off <= 2.5 * max(scale, 1e-9) + np.abs(offset)
print(f"{trusted.sum()} of {len(neighbors)} neighbors are trusted")

figure = plt.figure(figsize=(14, 5.5), layout="constrained")
left, right = figure.subplots(1, 2)
colors = 0.45 * normal_colors(box.normals, view=(40, 35)) + 0.55
for rows, color in ((neighbors[trusted], TRUSTED), (neighbors[~trusted], LEFT)):
    colors[rows] = plt.matplotlib.colors.to_rgb(color)
plot_cloud(xyz, color=colors, view=(40, 35), ax=left)
left.set_title("50 neighbors of one point beside an edge", fontsize=12)

along = np.linalg.svd(np.vstack([normal, pca.normals_[point]]))[2][2]  # of the edge
u = np.cross(along, normal)
v = np.cross(u, along)
near = np.abs((xyz - xyz[point]) @ along) < 2.5 * box.spacing
near &= np.linalg.norm(xyz - xyz[point], axis=1) < 9 * box.spacing
places = (xyz - xyz[point]) @ np.column_stack([u, v]) / box.spacing
right.scatter(*places[near].T, s=8, c="0.8", linewidths=0)
right.scatter(*places[neighbors[trusted]].T, s=28, c=TRUSTED, linewidths=0)
right.scatter(*places[neighbors[~trusted]].T, s=28, c=LEFT, linewidths=0)
right.plot(0, 0, "k+", ms=14, mew=2)
reach = np.linspace(-6, 6, 2)
for estimator, color, members in ((pca, PCA, neighbors), (ours, OURS, neighbors[trusted])):
    slope = estimator.normals_[point] @ np.column_stack([u, v])
    direction = np.array([-slope[1], slope[0]]) / np.linalg.norm(slope)
    center = places[members].mean(axis=0)
    right.plot(*(center[:, None] + direction[:, None] * reach), color=color, lw=2.5)
    angle = bias_angle(estimator.normals_[[point]], box.normals[[point]])[0]
    print(f"{'PCA' if color == PCA else 'robust':<8} tilts by {angle:.1f} degrees")
right.set(aspect="equal", xlim=(-8, 8), ylim=(-8, 6), xlabel="spacings", ylabel="spacings")
right.legend(
    handles=[
        Line2D([], [], ls="", marker="o", color=TRUSTED, label="trusted neighbors"),
        Line2D([], [], ls="", marker="o", color=LEFT, label="neighbors left out"),
        Line2D([], [], color=PCA, lw=2.5, label="plane of all (PCA)"),
        Line2D([], [], color=OURS, lw=2.5, label="plane of the trusted"),
        Line2D([], [], ls="", marker="+", color="k", ms=10, label="the point"),
    ],
    loc="lower left",
    fontsize=9,
)
right.set_title("The same in a section across the edge", fontsize=12)
plt.show()

# %%
# What it means for the whole box: PCA's normals round all edges off, and wrong points dent the
# faces.
figure, axes = plt.subplots(1, 2, figsize=(13, 5), layout="constrained")
for ax, estimator, name in ((axes[0], pca, "PCA"), (axes[1], ours, "robust")):
    NormalsDisplay.from_estimator(estimator, xyz, view=(40, 35), ax=ax)
    ax.set_title(f"{name}: normals as colors", fontsize=12)
plt.show()
