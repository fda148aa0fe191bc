"""
Which scenes can I try it on?
=============================

Streets of even density hide what real scans lose points by. These four scenes have it: stripes of
ten times the density, swaths that overlap, rings that part a hundredfold, depth in steps, and
leaves, grass and wires that are no surfaces. Each point knows its class, and each outlier its kind.
Outliers are red; far ones are outside of the pictures.
"""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.lines import Line2D

from sklearn_mcmd.datasets import (
    make_airborne_scan,
    make_depth_frame,
    make_lidar_turn,
    make_mobile_scan,
)
from sklearn_mcmd.plotting import plot_cloud

COLORS = plt.get_cmap("Set2").colors


def draw(scan, view, low, high):
    """The part of a scan between two corners, colored by class."""
    inside = ((scan.data >= low) & (scan.data <= high)).all(axis=1)
    colors = np.array(COLORS)[scan.classification[inside]]
    fig, ax = plt.subplots(figsize=(9, 6), layout="constrained")
    plot_cloud(
        scan.data[inside], color=colors, outliers=scan.target[inside] == -1, view=view, ax=ax
    )
    names = [*scan.class_names, "outlier"]
    marks = [Line2D([], [], color=c, marker="o", linestyle="") for c in COLORS[: len(names) - 1]]
    marks.append(Line2D([], [], color="tab:red", marker="o", linestyle=""))
    fig.legend(marks, names, loc="outside right upper", frameon=False)
    plt.show()
    shares = [np.mean(scan.classification == i) for i in range(len(scan.class_names))]
    print(
        ", ".join(
            f"{100 * s:.1f} % {n}"
            for n, s in zip(names, [*shares, np.mean(scan.target == -1)], strict=True)
        )
    )


# %%
# A street, from a vehicle that stands still for a while
# ------------------------------------------------------
# Lines across the street are ten times as dense in a stripe through road, facade, tree and meadow.

draw(make_mobile_scan(random_state=0), (-118, 32), (-2, -9, -0.5), (19, 12, 12.5))

# %%
# A village and a forest, from the air
# ------------------------------------
# The first swath, in front, is twice as dense as the second, and where they overlap the densities
# add up. Crowns have several echoes a beam.

draw(make_airborne_scan(random_state=0), (-70, 30), (0, 0, -12), (80, 62, 40))

# %%
# One turn of a spinning lidar
# ----------------------------
# The inner 40 m of a yard, with snow near the sensor.

draw(make_lidar_turn(random_state=0), (-60, 50), (-20, -25, -2.5), (20, 15, 6.5))

# %%
# One frame of a depth camera
# ---------------------------
# Depth comes in steps that grow with its square: walls are shells one step apart.

draw(make_depth_frame(random_state=0), (-112, 24), (-2.5, 0, -0.5), (2.8, 7, 3))
