"""Draw docs/images/sensor.png: what the sensor's position changes, on two simulated scans.

python benchmarks/draw_sensor.py docs/images/sensor.png
"""

import argparse

import matplotlib.pyplot as plt
import numpy as np

from sklearn_mcmd import MCMDOutlierDetector
from sklearn_mcmd.datasets import make_lidar_turn, make_street

GRAY, FOUND, LOST, MISSED = "0.75", "tab:green", "tab:red", "tab:purple"


def draw(axis, across, up, outlier, flagged, title):
    """Real points kept and lost, outliers found and missed."""
    for mask, color, size, label in (
        (~outlier & ~flagged, GRAY, 0.2, "real, kept"),
        (outlier & flagged, FOUND, 2, "outlier, found"),
        (outlier & ~flagged, MISSED, 2, "outlier, missed"),
        (~outlier & flagged, LOST, 2, "real, lost"),
    ):
        axis.scatter(across[mask], up[mask], s=size, c=color, label=label, linewidths=0)
    axis.set_title(title, fontsize=8)
    axis.set_aspect("equal")
    axis.set_xticks([])
    axis.set_yticks([])


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("target", help="image file")
    target = parser.parse_args().target
    turn = make_lidar_turn(outlier_kinds=["particle"], random_state=0)
    street = make_street(
        50_000, sampling="scan_lines", outlier_kinds=["mixed_pixel"], random_state=0
    )
    figure, axes = plt.subplots(2, 2, figsize=(8, 7.5))
    for row, (scan, origin, name) in zip(
        axes,
        (
            (turn, turn.sensor_origins[0], "a turn with particles, from above"),
            (street, street.sensor_origins[0], "a street with mixed pixels, from above"),
        ),
        strict=True,
    ):
        outlier = scan.target == -1
        for axis, position, known in zip(row, (None, origin), ("unknown", "known"), strict=True):
            detector = MCMDOutlierDetector(sensor_origin=position, random_state=0)
            flagged = detector.fit_predict(scan.data) == -1
            inner = np.abs(scan.data[:, :2] - origin[:2]).max(axis=1) < 25
            draw(
                axis, scan.data[inner, 0], scan.data[inner, 1], outlier[inner], flagged[inner],
                f"{name}\nposition {known}: {flagged[outlier].mean():.0%} found, "
                f"{flagged[~outlier].mean():.2%} lost",
            )  # fmt: skip
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="lower center", ncols=4, markerscale=6, frameon=False)
    figure.tight_layout(rect=(0, 0.04, 1, 1))
    figure.savefig(target, dpi=110)


if __name__ == "__main__":
    main()
