"""The picture of limits.rst of what is lost far from a spinning sensor, and its numbers.

python benchmarks/rings_figure.py
"""

import sys
from itertools import pairwise
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from simulators import make_lidar_turn

from sklearn_mcmd import MCMDOutlierDetector
from sklearn_mcmd.plotting import OutlierDisplay

sys.path.append(str(Path(__file__).resolve().parents[1] / "docs"))

from figures_common import BLUE, RED
from figures_failure import save


def main():
    turn = make_lidar_turn(70_000, random_state=0)
    echo = turn.outlier_kind != turn.outlier_kind_names.index("no_return")
    xyz, truth = turn.data[echo], turn.target[echo]
    labels = MCMDOutlierDetector(random_state=0).fit_predict(xyz)
    figure, axes = plt.subplots(1, 2, figsize=(13, 5), layout="constrained")
    shown = (np.abs(xyz[:, :2]) < 45).all(axis=1)
    OutlierDisplay.from_predictions(
        xyz[shown], labels[shown], y_true=truth[shown], view=(-75, 40), ax=axes[0]
    )
    axes[0].set_title("yellow: real pieces of far rings, lost", fontsize=12)
    distance = np.linalg.norm(xyz[:, :2], axis=1)
    edges = np.array([0, 5, 10, 15, 20, 30, 40, 60, 80])
    for strictness, color in (("groups", RED), ("isolated", BLUE)):
        verdict = MCMDOutlierDetector(strictness=strictness, random_state=0).fit_predict(xyz)
        lost = [
            100 * np.mean(verdict[(distance >= a) & (distance < b) & (truth == 1)] == -1)
            for a, b in pairwise(edges)
        ]
        axes[1].stairs(lost, edges, color=color, lw=2, label=f'"{strictness}"')
        print(strictness, np.round(lost, 1).tolist())
    axes[1].set(xlabel="distance from the sensor (m)", ylabel="real points lost (%)")
    axes[1].grid(alpha=0.3)
    axes[1].legend()
    save(figure, "failure_rings")


if __name__ == "__main__":
    main()
