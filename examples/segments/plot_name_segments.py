"""
Which points are road, kerb, wall and post?
===========================================

Region growing finds the surfaces, without names. Names follow from what a surface is like: its
slope, its height and its size. A few lines are enough for a street: what is level and low is road,
what is level and higher is footpath, what is upright and lower than a step is kerb, what is upright
and thin is post, and the rest is wall.

A kerb is 13 cm high, seven rows of points. It stays apart from road and footpath, because neighbors
are linked only where their planes explain each other.

.. code-block:: bash

    python plot_name_segments.py --points 60000
"""

import argparse

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.lines import Line2D

from sklearn_mcmd import MCMDOutlierDetector, RegionGrowing, RobustNormalEstimator
from sklearn_mcmd.datasets import make_street
from sklearn_mcmd.plotting import SegmentationDisplay, plot_cloud

parser = argparse.ArgumentParser()
parser.add_argument("--points", type=int, default=60_000, help="points of the street")
n_points = parser.parse_args().points

street = make_street(n_points, outlier_share=0.05, random_state=0)
real = MCMDOutlierDetector(random_state=0).fit_predict(street.data) == 1
xyz = street.data[real]
normals = RobustNormalEstimator(30, random_state=0)
columns = normals.fit_transform(xyz)
regions = RegionGrowing(normals="precomputed").fit(columns)

# %%
# A name for each region.
COLORS = {
    "road": "#8c8c8c",
    "footpath": "#e69f00",
    "kerb": "#d55e00",
    "wall": "#56b4e9",
    "post or sign": "#009e73",
    "nothing of these": "0.2",
}


def name_of(points, slopes):
    """A name by slope, height and size, in meters."""
    low, high = np.percentile(points, [10, 90], axis=0)
    width, height = np.hypot(*(high - low)[:2]), (high - low)[2]
    if np.median(slopes) > 0.9:
        return "nothing of these" if low[2] > 0.5 else "road" if high[2] < 0.08 else "footpath"
    if height < 0.25 and high[2] < 0.25:
        return "kerb"
    return "post or sign" if width < 0.8 and high[1] < 4.2 else "wall"


names = np.full(len(xyz), "nothing of these", dtype=object)
for label in range(regions.labels_.max() + 1):
    rows = regions.labels_ == label
    names[rows] = name_of(xyz[rows], np.abs(normals.normals_[rows, 2]))

# %%
figure, axes = plt.subplots(1, 2, figsize=(15, 6), layout="constrained")
SegmentationDisplay.from_estimator(regions, columns, ax=axes[0])
paint = np.array([plt.matplotlib.colors.to_rgb(COLORS[name]) for name in names])
plot_cloud(xyz, color=paint, view="perspective", ax=axes[1])
axes[1].set_title("named by slope, height and size", fontsize=12)
axes[1].legend(
    handles=[Line2D([], [], ls="", marker="o", color=c, label=n) for n, c in COLORS.items()],
    loc="lower right",
    ncols=2,
    frameon=False,
)
plt.show()

# %%
# The truth knows 15 surfaces. What did each become?
truth = np.array(street.surface_names)[street.surface[real]]
surfaces = street.surface[real] >= 0
print(f"{'true surface':<16}{'points':>8}   named")
for surface in street.surface_names:
    rows = surfaces & (truth == surface)
    if rows.sum() > 30:
        kinds, counts = np.unique(names[rows].astype(str), return_counts=True)
        best = counts.argmax()
        print(
            f"{surface:<16}{rows.sum():>8,}   "
            f"{100 * counts[best] / rows.sum():5.1f} % {kinds[best]}"
        )
