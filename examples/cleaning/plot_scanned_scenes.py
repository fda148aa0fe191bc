"""
Which scenes can I try it on?
=============================

Simulated scans whose truth is known at every point: a street of even density, the same street on
scan lines, and a roof. All know the surface of each point, and the kind of each outlier. Outliers
are red.
"""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.lines import Line2D

from sklearn_mcmd.datasets import make_crown_roof, make_street
from sklearn_mcmd.plotting import plot_cloud

COLORS = plt.get_cmap("tab20").colors


def draw(scan, number, names, view, low, high):
    """The part of a scan between two corners, colored by the number of each point's name."""
    inside = ((scan.data >= low) & (scan.data <= high)).all(axis=1)
    colors = np.array(COLORS)[number[inside]]
    fig, ax = plt.subplots(figsize=(9, 6), layout="constrained")
    plot_cloud(
        scan.data[inside], color=colors, outliers=scan.target[inside] == -1, view=view, ax=ax
    )
    marks = [Line2D([], [], color=c, marker="o", linestyle="") for c in COLORS[: len(names)]]
    marks.append(Line2D([], [], color="tab:red", marker="o", linestyle=""))
    fig.legend(marks, [*names, "outlier"], loc="outside right upper", frameon=False)
    plt.show()
    for kind, name in enumerate(scan.outlier_kind_names[1:], 1):
        print(f"{np.sum(scan.outlier_kind == kind):>6,} {name}")


# %%
# A street of even density
# ------------------------
# Points are drawn evenly over all that the scanner sees. The tree's leaves are no surface.

street = make_street(tree=True, random_state=0)
corners = (-1, -1, -1), (6, 6, 4)
draw(street, street.surface, street.surface_names, (-118, 32), *corners)

# %%
# The street on scan lines
# ------------------------
# The ends of rays at equal angles: density falls with the range and where surfaces are oblique.

lines = make_street(tree=True, sampling="scan_lines", random_state=0)
draw(lines, lines.surface, lines.surface_names, (-118, 32), *corners)

# %%
# A crown roof
# ------------
# Four surfaces that are not flat, and ridges whose angle varies. ``make_box`` has flat faces.

roof = make_crown_roof(20_000, outlier_share=0.1, random_state=0)
draw(roof, roof.surface, roof.surface_names, (-118, 32), (-1, -1, -1), (3, 3, 2))
