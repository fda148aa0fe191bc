"""Draw docs/images/reflections.png: a street with a shop window, and what its pane mirrors.

python benchmarks/draw_reflections.py docs/images/reflections.png
"""

import argparse

import matplotlib.pyplot as plt
import numpy as np

from sklearn_mcmd import MCMDOutlierDetector
from sklearn_mcmd.datasets import make_street


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("target", help="image file")
    target = parser.parse_args().target
    street = make_street(
        60_000, glass=True, tree=True, sampling="scan_lines", outlier_share=0.05,
        outlier_kinds=["reflection"], random_state=0,
    )  # fmt: skip
    sensor = street.scanners[0]
    detector = MCMDOutlierDetector(sensor_origin=sensor, reflections=True, random_state=0)
    found = detector.fit(street.data).mirror_index_ >= 0
    reflected = street.target == -1
    names = np.array([*street.surface_names, ""])[street.surface]
    room = np.char.startswith(names, "room")
    images = street.data[found]
    mirrors = detector.mirrors_
    heights = images @ mirrors.normals[0] - mirrors.offsets[0]
    images = images - 2 * heights[:, None] * mirrors.normals[0]
    figure, axes = plt.subplots(1, 2, figsize=(7.5, 6.2), sharey=True)
    for axis, (across, title) in zip(
        axes, ((0, "from above: x and y in m"), (2, "from the side: z and y in m")), strict=True
    ):
        for points, color, size, label in (
            (street.data[~reflected & ~room & ~found], "0.75", 0.3, "street"),
            (street.data[room & ~found], "tab:blue", 0.5, "room behind the glass, kept"),
            (street.data[reflected & found], "tab:green", 0.8, "reflection, found"),
            (street.data[reflected & ~found], "tab:purple", 2, "reflection, missed"),
            (street.data[~reflected & found], "tab:red", 2, "real, lost"),
            (images, "tab:olive", 0.3, "mirror image of what was found"),
        ):
            axis.scatter(
                points[:, across], points[:, 1], s=size, c=color, label=label, linewidths=0
            )
        axis.plot(*sensor[[across, 1]], "k^", label="sensor")
        pane = -mirrors.offsets[0]
        axis.axhline(pane, color="k", linewidth=0.8, linestyle="--", label="mirror that was found")
        axis.set_title(title, fontsize=9)
        axis.set_aspect("equal")
    handles, labels = axes[0].get_legend_handles_labels()
    legend = figure.legend(handles, labels, loc="lower center", ncols=3, frameon=False, fontsize=8)
    for handle in legend.legend_handles[:6]:
        handle.set_sizes([15])
    figure.tight_layout(rect=(0, 0.1, 1, 1))
    figure.savefig(target, dpi=110)


if __name__ == "__main__":
    main()
