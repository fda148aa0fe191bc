"""
What do both methods mark on a wall and on a simulated plane?
=============================================================

These are counterparts of Figures 2 to 5 of Arabsheibani et al. They show the outliers that the
paper's Baarda (all rejected points at once, uncorrected level) and the fuzzy approach find, first
on a scanned wall, then on a simulated grid. The paper's scan is not public. The wall here is
simulated, with a bush in front of its lower edge and mixed pixels at its right edge.

A wall is upright, so residuals are distances along its normal.
"""

import matplotlib.pyplot as plt
import numpy as np
from adjustment_paper import simulate

from sklearn_mcmd.adjustment import BaardaPlaneDetector, FuzzyPlaneDetector

rng = np.random.default_rng(0)
SIGMA = 0.01  # meters


def make_wall(n=1115):
    """A wall of 8 m by 4 m at 30 degrees to the axes, with 1115 points as in the paper's set A."""
    along, up = rng.uniform(0, 8, n), rng.uniform(0, 4, n)
    off = rng.normal(scale=SIGMA, size=n)
    bush = (up < 0.3) & (rng.uniform(size=n) < 0.5)
    mixed = (along > 7.9) & (rng.uniform(size=n) < 0.7)
    off[bush] += rng.uniform(0.08, 0.3, bush.sum())
    off[mixed] -= rng.uniform(0.1, 0.6, mixed.sum())
    c, s = np.cos(np.pi / 6), np.sin(np.pi / 6)
    return np.column_stack([c * along - s * off, s * along + c * off, up]), bush | mixed


def draw(ax, X, found, truth, title):
    """The cloud from the side, with outliers in red and rings around flagged good points."""
    ax.scatter(*X[~found].T, s=2, c="tab:blue")
    ax.scatter(*X[found].T, s=10, c="tab:red")
    swamped = found & ~truth
    ax.scatter(*X[swamped].T, s=30, facecolors="none", edgecolors="k", linewidths=0.6)
    ax.set_title(f"{title}\n{found.sum()} found, {swamped.sum()} of them good", fontsize=10)


# %%
# Figures 2 and 3: the wall. Figures 4 and 5: set A of the simulation, 100 outliers of 500.
# Real data snooping is shown beside them.
def detectors(**parameters):
    return {
        "paper's Baarda (batch, alpha)": BaardaPlaneDetector(
            correction="none", elimination="all", **parameters
        ),
        "Fuzzy, width 1.25": FuzzyPlaneDetector(width=1.25, **parameters),
        "data snooping": BaardaPlaneDetector(**parameters),
    }


wall, wall_truth = make_wall()
grid, grid_truth = simulate("A", 100, 0)
figure = plt.figure(figsize=(15, 9), layout="constrained")
for i, (name, detector) in enumerate(
    detectors(alpha=0.1, sigma0=SIGMA, surface="orthogonal").items()
):
    detector.fit(wall)
    found = getattr(detector, "elimination_step_", detector.labels_ == -1)
    found = found > 0 if found.dtype.kind == "i" else found
    ax = figure.add_subplot(2, 3, i + 1, projection="3d", elev=15, azim=-50)
    draw(ax, wall, found, wall_truth, f"wall, {name}")
    ax.set(xlabel="x [m]", ylabel="y [m]", zlabel="z [m]")
    print(
        f"wall: {name:<30} finds {found[wall_truth].sum():4d} of {wall_truth.sum()} outliers, "
        f"and {found[~wall_truth].sum():4d} good points"
    )
for i, (name, detector) in enumerate(detectors(alpha=0.15).items()):
    detector.fit(grid)
    found = getattr(detector, "elimination_step_", detector.labels_ == -1)
    found = found > 0 if found.dtype.kind == "i" else found
    ax = figure.add_subplot(2, 3, i + 4, projection="3d", elev=15, azim=-50)
    draw(ax, grid, found, grid_truth, f"simulated plane, {name}")
    ax.set(xlabel="x", ylabel="y", zlabel="z [s0]")
    print(
        f"grid: {name:<30} finds {found[grid_truth].sum():4d} of {grid_truth.sum()} outliers, "
        f"and {found[~grid_truth].sum():4d} good points"
    )
plt.show()
