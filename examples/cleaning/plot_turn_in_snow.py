"""
How many flakes does a spinning lidar see?
==========================================

Snowfall is named in mm of water an hour, and physics says the rest: how many flakes a cubic meter
holds, how large they are, and which of them outshine what stands behind. Light snow of 0.5 mm/h
ends one beam in forty of this turn, heavy snow of 4 mm/h one in twenty. Near the sensor also small
flakes are seen, far away only large ones.

.. code-block:: bash

    python plot_turn_in_snow.py --points 20000
"""

import argparse

import matplotlib.pyplot as plt
import numpy as np

from sklearn_mcmd import MCMDOutlierDetector
from sklearn_mcmd.datasets import make_lidar_turn

parser = argparse.ArgumentParser()
parser.add_argument("--points", type=int, default=40_000, help="points of the turn")
n_points = parser.parse_args().points

SNOWFALLS = (0.5, 1.0, 2.0, 4.0)
turns = {
    snowfall: make_lidar_turn(
        n_points, snow=snowfall, beam_divergence=0.002, outlier_share=0, random_state=0
    )
    for snowfall in SNOWFALLS
}


def is_snow(turn):
    return turn.outlier_kind == turn.outlier_kind_names.index("snow")


# %%
# The turn in snow of 2 mm/h: from above, and as the sensor sees it, by direction. Beams into the
# sky meet flakes most often, because nothing outshines these.
turn = turns[2.0]
snow = is_snow(turn)
x, y, z = turn.data.T
ranges = np.linalg.norm(turn.data, axis=1)
azimuth, elevation = np.degrees([np.arctan2(y, x), np.arcsin(z / ranges)])
figure, axes = plt.subplots(1, 2, figsize=(14, 6), width_ratios=(1, 1.3), layout="constrained")
for ax, across, up in ((axes[0], x, y), (axes[1], azimuth, elevation)):
    for rows, color, size, label in (
        (~snow, "0.75", 0.3, "surfaces"),
        (snow, "tab:blue", 3, "flakes"),
    ):
        ax.scatter(across[rows], up[rows], s=size, c=color, label=label, linewidths=0)
axes[0].set(xlim=(-20, 20), ylim=(-20, 20), aspect="equal", xlabel="x (m)", ylabel="y (m)")
axes[1].set(xlabel="azimuth (degrees)", ylabel="elevation (degrees)")
axes[1].legend(loc="lower left", markerscale=5, framealpha=1)
plt.show()

# %%
# More snow means larger flakes, and these are seen from farther away.
figure, ax = plt.subplots(figsize=(7, 4), layout="constrained")
for shade, (snowfall, turn) in zip((0.35, 0.55, 0.75, 0.95), turns.items(), strict=True):
    snow = is_snow(turn)
    far = np.linalg.norm(turn.data[snow], axis=1)
    style = {"histtype": "step", "lw": 2, "color": plt.get_cmap("Blues")(shade)}
    ax.hist(
        far, np.arange(21), label=f"{snowfall:g} mm/h: {snow.mean():.1%} of the points", **style
    )
ax.set(xlabel="range of flakes (m)", ylabel="flakes", xlim=(0, 20))
ax.legend()
plt.show()

# %%
# Flakes found at 1 mm/h, and real points lost. With the position far rings stay, and beams without
# an echo tell that a place in the sky is empty.
forms = {
    "coordinates": {},
    "coordinates, isolated": {"strictness": "isolated"},
    "with the position": {"sensor_origin": "origin"},
}
print(f"{'':24}{'found':>8}{'lost':>9}")
turn = turns[1.0]
snow = is_snow(turn)
for name, parameters in forms.items():
    flagged = MCMDOutlierDetector(random_state=0, **parameters).fit_predict(turn.data) == -1
    print(f"{name:24}{flagged[snow].mean():8.1%}{flagged[turn.target == 1].mean():9.2%}")
