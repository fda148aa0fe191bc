"""
What happens to one turn of a spinning lidar?
=============================================

The snow goes. Far away some real points go as well. Rings on the ground are a palm apart beside the
sensor, and 30 m apart at a range of 80 m. There a piece of a ring has no plane and no company. If
nothing real may be lost, take ``strictness="isolated"``. If only the surroundings matter, cut the
cloud at a range where rings still form surfaces.

.. code-block:: bash

    python plot_spinning_turn.py --points 40000
"""

import argparse

import matplotlib.pyplot as plt
import numpy as np

from sklearn_mcmd import MCMDOutlierDetector
from sklearn_mcmd.datasets import make_lidar_turn
from sklearn_mcmd.plotting import OutlierDisplay

parser = argparse.ArgumentParser()
parser.add_argument("--points", type=int, default=60_000, help="points of the turn")
n_points = parser.parse_args().points

turn = make_lidar_turn(n_points, random_state=0)
echo = turn.outlier_kind != turn.outlier_kind_names.index("no_return")
xyz, truth = turn.data[echo], turn.target[echo]  # beams without an echo lie in the sensor
distance = np.linalg.norm(xyz[:, :2], axis=1)
labels = {
    strictness: MCMDOutlierDetector(strictness=strictness, random_state=0).fit_predict(xyz)
    for strictness in ("groups", "isolated")
}

# %%
# Near the sensor: snow, and a little more. Blue points are missed, yellow ones are real and go.
near = distance < 14
figure, axes = plt.subplots(1, 2, figsize=(15, 6.5), layout="constrained")
for ax, (strictness, verdict) in zip(axes, labels.items(), strict=True):
    OutlierDisplay.from_predictions(
        xyz[near], verdict[near], y_true=truth[near], view=(-60, 38), ax=ax
    )
    ax.set_title(f'strictness="{strictness}", within 14 m', fontsize=12)
plt.show()

# %%
# From above.
figure, axes = plt.subplots(1, 2, figsize=(15, 6.5), layout="constrained")
for ax, (strictness, verdict) in zip(axes, labels.items(), strict=True):
    OutlierDisplay.from_predictions(xyz, verdict, y_true=truth, view="top", ax=ax)
    ax.set(xlim=(-45, 45), ylim=(-45, 25))
    ax.set_title(f'strictness="{strictness}"', fontsize=12)
plt.show()

# %%
# Real points lost, by the distance from the sensor.
print(f"{'range':<12}{'real points':>12}" + "".join(f"{name:>12}" for name in labels))
for low, high in ((0, 10), (10, 20), (20, 40), (40, 100)):
    rows = (distance >= low) & (distance < high) & (truth == 1)
    lost = "".join(f"{100 * np.mean(v[rows] == -1):10.1f} %" for v in labels.values())
    print(f"{low:>3} to {high:>3} m{rows.sum():>12,}{lost}")
