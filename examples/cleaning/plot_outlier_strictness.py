"""
What goes and what stays at each strictness?
============================================

A simulated street with a tree. Road, walls and posts are surfaces. The leaves lie on no surface,
but they are real: they are things. Single points in the air are isolated. Ghosts of 10 to 60
points are groups that stand off.

.. code-block:: bash

    python plot_outlier_strictness.py --points 40000
"""

import argparse

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import to_rgb
from matplotlib.lines import Line2D

from sklearn_mcmd import MCMDOutlierDetector
from sklearn_mcmd.datasets import make_street
from sklearn_mcmd.plotting import plot_cloud

parser = argparse.ArgumentParser()
parser.add_argument("--points", type=int, default=40_000, help="points of the street")
options = parser.parse_args()

street = make_street(
    options.points,
    tree=True,
    outlier_share=0.02,
    outlier_kinds=("uniform", "ghost"),
    random_state=0,
)
kind = np.array(street.outlier_kind_names)[street.outlier_kind]
foliage = street.surface == street.surface_names.index("foliage")
what = {
    "faces and posts": (kind == "regular") & ~foliage,
    "leaves": foliage,
    "single points": kind == "uniform",
    "ghosts": kind == "ghost",
}

# %%
# Three detectors. Planes, surfaces and groups are the same in all of them.
flagged = {}
for strictness in ("isolated", "groups", "surfaces"):
    detector = MCMDOutlierDetector(strictness=strictness, random_state=0).fit(street.data)
    flagged[strictness] = detector.scores_ < detector.offset_

print(f"{'flagged, percent':<20}" + "".join(f"{name:>12}" for name in flagged))
for name, rows in what.items():
    shares = "".join(f"{100 * found[rows].mean():12.1f}" for found in flagged.values())
    print(f"{name:<20}{shares}")

# %%
# The answer for each point. What "isolated" flags is isolated. What only "groups" flags is a group
# that stands off. The other points that lie on no surface are things.
colors = {"surface": "0.75", "thing": "tab:green", "isolated": "tab:red", "group": "tab:purple"}
answer = np.select(
    [flagged["isolated"], flagged["groups"], ~detector.on_surface_],
    ["isolated", "group", "thing"],
    "surface",
)
rgb = np.array([to_rgb(colors[name]) for name in answer])

figure, axes = plt.subplots(2, 2, figsize=(12, 9), layout="constrained")
plot_cloud(street.data, color=rgb, ax=axes.flat[0]).set_title("the answer for each point")
handles = [Line2D([], [], color=c, marker="o", ls="", label=name) for name, c in colors.items()]
axes.flat[0].legend(handles=handles, loc="lower left", fontsize=9)
for ax, (name, gone) in zip(axes.flat[1:], flagged.items(), strict=True):
    plot_cloud(street.data[~gone], color=rgb[~gone], ax=ax)
    ax.set_title(f'strictness="{name}" keeps {100 * (~gone).mean():.1f} %')
plt.show()
