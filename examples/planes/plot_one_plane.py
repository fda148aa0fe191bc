"""
Which points of a wall are off its plane?
=========================================

Two tests answer for one plane. Baarda's data snooping removes the worst point and adjusts again,
until the worst is within the limit. The fuzzy test adjusts once, and draws the line between two
groups. A scanned wall has a bush in front of its foot and mixed pixels at its right end.

A wall is upright, so distances are taken along its normal (``surface="orthogonal"``).
``sigma0="auto"`` finds the noise of the scanner, and ``robust_start=True`` begins with the plane of
the majority. Data snooping is the better choice: the bush tilts the plane of the fuzzy test.
"""

import matplotlib.pyplot as plt
import numpy as np

from sklearn_mcmd import BaardaPlaneDetector, FuzzyPlaneDetector
from sklearn_mcmd.plotting import PlaneResidualDisplay, plot_cloud

rng = np.random.default_rng(0)
n, noise = 6000, 0.01  # meters

# %%
# A wall of 8 m by 4 m, turned by 30 degrees.
along, up = rng.uniform(0, 8, n), rng.uniform(0, 4, n)
off = rng.normal(scale=noise, size=n)
bush = (np.hypot((along - 2.2) / 1.8, up / 0.9) < 1) & (rng.uniform(size=n) < 0.6)
mixed = (along > 7.85) & (rng.uniform(size=n) < 0.7)
off[bush] += rng.uniform(0.06, 0.4, bush.sum())
off[mixed] -= rng.uniform(0.1, 0.6, mixed.sum())
turn = np.pi / 6
wall = np.column_stack(
    [np.cos(turn) * along + np.sin(turn) * off, np.sin(turn) * along - np.cos(turn) * off, up]
)
wrong = bush | mixed

# %%
# On the right the foot of the wall is seen from above, ten times as deep as it is. Lines are the
# planes. In the lower pictures colors are residuals, up to three standard deviations of what a test
# keeps. After data snooping they are noise: no place is redder than another. After the fuzzy test
# they lean, because its plane does. It takes good points for bad.
tests = {
    "Baarda, robust start": BaardaPlaneDetector(
        sigma0="auto", surface="orthogonal", robust_start=True, random_state=0
    ),
    "fuzzy": FuzzyPlaneDetector(sigma0="auto", surface="orthogonal", width=1.25),
}
figure, axes = plt.subplots(2, 2, figsize=(13, 8), layout="constrained")
plot_cloud(wall, outliers=wrong, view=(-100, 35), ax=axes[0, 0])
axes[0, 0].set_title(f"the wall, {wrong.sum()} wrong points in red", fontsize=12)
for ax, (name, test) in zip(axes[1], tests.items(), strict=True):
    test.fit(wall)
    found = test.labels_ == -1
    PlaneResidualDisplay.from_estimator(test, wall, ax=ax)
    ax.set_title(
        f"{name}: {found[wrong].sum()} found, {found[~wrong].sum()} good ones", fontsize=12
    )
    tilt = np.degrees(np.arccos(min(1, abs(test.normal_ @ [np.sin(turn), -np.cos(turn), 0]))))
    print(
        f"{name:<22} finds {found[wrong].sum()} of {wrong.sum()}, and {found[~wrong].sum()} good "
        f"points; sigma0 {1000 * test.sigma0_:.1f} mm, the plane leans by {tilt:.3f} degrees"
    )
foot = up < 0.5
ax = axes[0, 1]
ax.scatter(along[foot], off[foot], s=5, c=np.where(wrong[foot], "#d55e00", "0.6"), linewidths=0)
for (name, test), style in zip(tests.items(), ("-", "--"), strict=True):
    ends = np.array([0.0, 8.0])
    base = np.column_stack([np.cos(turn) * ends, np.sin(turn) * ends, [0.25, 0.25]])
    out = np.array([np.sin(turn), -np.cos(turn), 0.0])
    distance = (test.distance_ - base @ test.normal_) / (out @ test.normal_)
    ax.plot(ends, distance, style, color="k", label=name)
ax.set(xlabel="along the wall (m)", ylabel="off the wall (m)", ylim=(-0.12, 0.2))
ax.legend()
plt.show()
