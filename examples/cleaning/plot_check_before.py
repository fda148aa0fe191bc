"""
What should I check before I clean?
===================================

Two things spoil a cloud before any method sees it: rounded coordinates and copies.

**Rounded coordinates.** A file with a scale of 1 cm puts points on steps of 1 cm. The detector
finds the step if all axes lie on it, and takes one step for no error. If you turn or scale the
cloud after it was rounded, the step is hidden. So clean first, turn later. ``mcmd info`` tells the
digits of a file.

**Copies.** Some sensors write a beam without an echo as a point at one place, thousands of times. A
place that was measured that often keeps company with itself, and stays. Remove such places by their
coordinates.
"""

import matplotlib.pyplot as plt
import numpy as np

from sklearn_mcmd import MCMDOutlierDetector
from sklearn_mcmd.datasets import make_street
from sklearn_mcmd.plotting import OutlierDisplay

rng = np.random.default_rng(0)

# %%
# A road with a slope of 1 % and a noise of 2 mm, written with steps of 1 cm. The section is 25 cm
# wide and drawn 30 times as high as it is.
road = np.column_stack([rng.uniform(0, 6, (12_000, 2)), np.zeros(12_000)])
road[:, 2] = 0.01 * road[:, 0] + rng.normal(scale=0.002, size=len(road))
rounded = np.round(road, 2)
angle = np.radians(10)
turn = [[np.cos(angle), np.sin(angle), 0], [-np.sin(angle), np.cos(angle), 0], [0, 0, 1]]
tilt = np.radians(3)
tilted = [[np.cos(tilt), 0, np.sin(tilt)], [0, 1, 0], [-np.sin(tilt), 0, np.cos(tilt)]]
clouds = {
    "as scanned": road,
    "rounded to 1 cm": rounded,
    "rounded, then turned": rounded @ np.array(turn) @ np.array(tilted),
}
figure, axes = plt.subplots(3, 1, figsize=(11, 7), sharex=True, layout="constrained")
for ax, (name, cloud) in zip(axes, clouds.items(), strict=True):
    flagged = MCMDOutlierDetector(random_state=0).fit_predict(cloud) == -1
    section = np.abs(road[:, 1] - 3) < 0.12
    height = cloud[:, 2] - np.polyval(np.polyfit(cloud[:, 0], cloud[:, 2], 1), cloud[:, 0])
    height = height if "turned" in name else cloud[:, 2]
    ax.scatter(road[section & ~flagged, 0], 1000 * height[section & ~flagged], s=4, c="0.45")
    ax.scatter(road[section & flagged, 0], 1000 * height[section & flagged], s=14, c="#d55e00")
    ax.set(ylabel="height (mm)")
    ax.set_title(f"{name}: {flagged.sum():,} of {len(cloud):,} points flagged", fontsize=11)
    print(f"{name:<22} {100 * flagged.mean():.2f} % flagged")
axes[-1].set(xlabel="along the road (m)")
plt.show()

# %%
# Copies: a street in its scanner's coordinates, with 300 beams that had no echo. Count how often
# each place occurs.
street = make_street(30_000, sampling="scan_lines", outlier_share=0.02, random_state=0)
xyz = np.vstack([street.data - street.sensor_origins, np.zeros((300, 3))])
truth = np.append(street.target, np.full(300, -1))
places, index, counts = np.unique(xyz, axis=0, return_inverse=True, return_counts=True)
often = np.argsort(-counts)[:3]
for place, count in zip(places[often], counts[often], strict=True):
    print(f"{count:>5} times at {place.round(2)}")

copies = counts[index] > 10
figure, axes = plt.subplots(1, 2, figsize=(14, 5.5), layout="constrained")
for ax, rows, title in (
    (axes[0], np.ones(len(xyz), dtype=bool), "with the copies"),
    (axes[1], ~copies, "without"),
):
    verdict = MCMDOutlierDetector(random_state=0).fit_predict(xyz[rows])
    OutlierDisplay.from_predictions(xyz[rows], verdict, y_true=truth[rows], view="front", ax=ax)
    ax.plot(0, 0, "o", ms=16, mfc="none", mec="#0072b2", mew=2)
    n_copies = np.sum(copies[rows])
    text = f"{n_copies} points at one place" if n_copies else "none here"
    ax.annotate(text, (0.1, 0.1), (0.8, 1.1), arrowprops={"arrowstyle": "->"}, fontsize=11)
    ax.set_title(f"{title}, seen from the front", fontsize=12)
plt.show()
