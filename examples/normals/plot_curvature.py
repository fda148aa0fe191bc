"""
How strongly is a surface bent, and how sure is that?
=====================================================

A quadric around each point gives the curvature in one over meters, with its standard error. Here is
a small bridge: a deck, a vault of 3 m radius, and two pipes of 30 and 60 cm diameter below the
deck. The radius follows from the curvature: one over the larger principal one.

.. code-block:: bash

    python plot_curvature.py --points 30000
"""

import argparse

import matplotlib.pyplot as plt
import numpy as np

from sklearn_mcmd import RobustNormalEstimator
from sklearn_mcmd.plotting import plot_cloud

parser = argparse.ArgumentParser()
parser.add_argument("--points", type=int, default=40_000, help="points of the bridge")
n_points = parser.parse_args().points
rng = np.random.default_rng(0)


def shell(n, radius, x, z, span=(0.0, 2 * np.pi), length=3.0):
    """Points of a part of a cylinder along y."""
    angle, along = rng.uniform(*span, n), rng.uniform(0, length, n)
    return np.column_stack([x + radius * np.cos(angle), along, z + radius * np.sin(angle)])


def sheet(n, low, high):
    return rng.uniform(low, high, (n, 3))


# %%
# Points per part follow from its area, so that all have one spacing.
parts = {
    "vault": (np.pi * 3.0 * 3, lambda n: shell(n, 3.0, 0, 0, (0, np.pi)), 1 / 3.0),
    "left wall": (2 * 3, lambda n: sheet(n, (-3, 0, -2), (-3, 3, 0)), 0.0),
    "right wall": (2 * 3, lambda n: sheet(n, (3, 0, -2), (3, 3, 0)), 0.0),
    "deck": (10 * 3, lambda n: sheet(n, (-5, 0, 3.8), (5, 3, 3.8)), 0.0),
    "pipe of 60 cm": (np.pi * 0.6 * 3, lambda n: shell(n, 0.3, -3.7, 2.7), 1 / 0.3),
    "pipe of 30 cm": (np.pi * 0.3 * 3, lambda n: shell(n, 0.15, 3.7, 2.9), 1 / 0.15),
}
total = sum(area for area, _, _ in parts.values())
clouds = [make(round(n_points * area / total)) for area, make, _ in parts.values()]
part = np.repeat(np.arange(len(parts)), [len(cloud) for cloud in clouds])
xyz = np.vstack(clouds) + rng.normal(scale=0.003, size=(len(part), 3))
print(f"spacing {100 * np.sqrt(total / n_points):.1f} cm, noise 3 mm")

# %%
# Curvatures are columns of the transformer, by name.
features = ["max_curvature", "min_curvature", "max_curvature_error", "min_curvature_error"]
estimator = RobustNormalEstimator(60, features=features, random_state=0)
table = estimator.fit_transform(xyz)
names = list(estimator.get_feature_names_out())
largest, least, largest_error, least_error = (table[:, names.index(f)] for f in features)
bent = np.abs(largest) >= np.abs(least)
curvature = np.where(bent, np.abs(largest), np.abs(least))
error = np.where(bent, largest_error, least_error)

print(f"{'part':<16}{'true':>8}{'median':>10}{'its error':>11}   (one over meters)")
for i, (name, (_, _, true)) in enumerate(parts.items()):
    rows = part == i
    print(
        f"{name:<16}{true:>8.2f}{np.median(curvature[rows]):>10.2f}{np.median(error[rows]):>11.2f}"
    )

# %%
# Left: the curvature. Right: how many standard errors it is from zero. A wall is not bent, and says
# so.
figure, axes = plt.subplots(1, 2, figsize=(15, 5.5), layout="constrained")
for ax, value, norm, palette, label in (
    (axes[0], curvature, plt.matplotlib.colors.LogNorm(0.1, 10), "viridis", "curvature (1/m)"),
    (axes[1], curvature / error, plt.Normalize(0, 10), "cividis", "curvature / its error"),
):
    shade = plt.cm.ScalarMappable(norm, palette)
    plot_cloud(xyz, color=shade.to_rgba(value)[:, :3], view=(-60, 8), scale_bar=True, ax=ax)
    figure.colorbar(shade, ax=ax, shrink=0.7, label=label, extend="both")
plt.show()

# %%
# More neighbors make the error smaller, as long as the surface is still a quadric. 15 neighbors are
# enough for the pipes and too few for the vault. 120 suit the vault. The error knows the noise, but
# not what a quadric cannot describe: 120 neighbors reach around half of the small pipe, and its
# curvature is too large by half.
figure, ax = plt.subplots(figsize=(8, 4), layout="constrained")
for i, name in ((0, "vault"), (4, "pipe of 60 cm"), (5, "pipe of 30 cm")):
    medians, errors, sizes = [], [], [15, 30, 60, 120, 240]
    for k in sizes:
        estimator = RobustNormalEstimator(k, features=features, random_state=0)
        rows = part == i
        table = estimator.fit_transform(xyz[rows])
        columns = [table[:, names.index(f)] for f in features]
        bent = np.abs(columns[0]) >= np.abs(columns[1])
        medians.append(np.median(np.where(bent, np.abs(columns[0]), np.abs(columns[1]))))
        errors.append(np.median(np.where(bent, columns[2], columns[3])))
    line = ax.errorbar(sizes, medians, errors, fmt="o-", capsize=4, label=name)
    ax.axhline(list(parts.values())[i][2], color=line[0].get_color(), ls=":", lw=1)
ax.set(xscale="log", yscale="log", xlabel="neighbors", ylabel="curvature (1/m)", ylim=(0.1, 30))
ax.set_xticks(sizes, sizes)
ax.minorticks_off()
ax.legend(title="dotted: true")
plt.show()
