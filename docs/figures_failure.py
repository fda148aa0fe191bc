"""The pictures of limits.rst, and their numbers.

python docs/figures_failure.py [NAME ...]
"""

import io
import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from figures_common import BLUE, GRAY, RED
from PIL import Image

from sklearn_mcmd import MCMDOutlierDetector, RobustNormalEstimator
from sklearn_mcmd.datasets import make_street
from sklearn_mcmd.metrics import bias_angle
from sklearn_mcmd.plotting import NormalsDisplay, OutlierDisplay, plot_cloud

ORANGE = "#e69f00"


def save(figure, name, colors=96):
    """A small PNG: few colors, rare ones among them, no more pixels than a page shows."""
    picture = io.BytesIO()
    figure.savefig(picture, dpi=76, facecolor="white")
    path = Path(__file__).parent / "images" / f"{name}.png"
    image = Image.open(picture).convert("RGB")
    image.quantize(colors, method=Image.Quantize.MAXCOVERAGE).save(path, optimize=True)
    print(f"{path.name}: {path.stat().st_size / 1000:.0f} kB")
    plt.close(figure)


def sheets():
    """Mixed pixels that are kept, and the angle at which their sheets are seen."""
    kinds = {"outlier_kinds": ("mixed_pixel",), "outlier_share": 0.04}
    street = make_street(60_000, sampling="scan_lines", **kinds, random_state=0)
    xyz, truth = street.data, street.target
    labels = MCMDOutlierDetector(random_state=0).fit_predict(xyz)
    near = (np.abs(xyz[:, 0] - 1.2) < 1.4) & (xyz[:, 1] > 2.6) & (xyz[:, 2] > 0.2)
    kept = labels == 1
    columns = RobustNormalEstimator(30, random_state=0).fit_transform(xyz[kept])
    rays = xyz[kept] - street.sensor_origins[0]
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    grazing = np.degrees(np.arcsin(np.abs(np.sum(rays * columns[:, 3:6], axis=1)))) < 10
    high = xyz[kept, 2] > 0.2  # the road is grazed as well
    suspect = grazing & high
    wrong = truth[kept] == -1
    print(f"mixed pixels found: {100 * np.mean(labels[truth == -1] == -1):.0f} %")
    print(
        f"suspect: {100 * suspect[wrong & high].mean():.0f} % of the sheets that were kept, "
        f"{100 * suspect[~wrong & high].mean():.1f} % of the real points above 20 cm"
    )
    figure, axes = plt.subplots(2, 2, figsize=(11, 8), layout="constrained")
    OutlierDisplay.from_predictions(
        xyz[near], labels[near], y_true=truth[near], view=(-35, 20), ax=axes[0, 0]
    )
    axes[0, 0].set_title("blue: sheets of mixed pixels, kept", fontsize=12)
    OutlierDisplay.from_predictions(
        xyz[near], labels[near], y_true=truth[near], view="top", ax=axes[0, 1]
    )
    axes[0, 1].set_title("from above: they lie along the rays", fontsize=12)
    for x, y in xyz[near & (truth == -1)][::60, :2]:
        axes[0, 1].plot(
            [street.sensor_origins[0, 0], x],
            [street.sensor_origins[0, 1], y],
            color="0.8",
            lw=0.5,
            zorder=0,
        )
    shown = near[kept]
    plot_cloud(xyz[kept][shown], color=GRAY, outliers=suspect[shown], view=(-35, 20), ax=axes[1, 0])
    axes[1, 0].set_title("red: seen at less than 10 degrees", fontsize=12)
    plot_cloud(xyz[kept][shown & ~suspect], color=GRAY, view=(-35, 20), ax=axes[1, 1])
    axes[1, 1].set_title("without these", fontsize=12)
    save(figure, "failure_sheets")


def _wall_and_road(noise, rng, n=12_000):
    """A road and a wall with one point on each unit of area, and 2 % of points anywhere."""
    side = np.sqrt(n / 2)
    road = np.column_stack([rng.uniform(0, side, (n // 2, 2)), np.zeros(n // 2)])
    wall = np.column_stack(
        [rng.uniform(0, side, n // 2), np.full(n // 2, side), rng.uniform(0, side, n // 2)]
    )
    real = np.vstack([road, wall]) + rng.normal(scale=noise, size=(2 * (n // 2), 3))
    stray = rng.uniform(0, side, (n // 50, 3))
    return np.vstack([real, stray]), np.repeat([1, -1], [len(real), len(stray)])


def noise():
    """Noise in spacings against what each strictness takes."""
    figure, axes = plt.subplots(1, 3, figsize=(15, 4.4), layout="constrained")
    for ax, scale in zip(axes, (0.3, 0.9), strict=False):
        cloud, truth = _wall_and_road(scale, np.random.default_rng(0))
        labels = MCMDOutlierDetector(strictness="surfaces", random_state=0).fit_predict(cloud)
        OutlierDisplay.from_predictions(cloud, labels, y_true=truth, view=(-50, 22), ax=ax)
        ax.set_title(f'noise {scale:g} spacings, "surfaces"', fontsize=12)
    scales = (0.1, 0.3, 0.5, 0.6, 0.7, 0.8, 1.0, 1.5)
    for name, color, k in (("groups", BLUE, 50), ("surfaces", RED, 50), ("surfaces", ORANGE, 150)):
        lost = []
        for scale in scales:
            cloud, truth = _wall_and_road(scale, np.random.default_rng(0))
            labels = MCMDOutlierDetector(k, strictness=name, random_state=0).fit_predict(cloud)
            lost.append(100 * np.mean(labels[truth == 1] == -1))
        axes[2].plot(scales, lost, "o-", color=color, label=f'"{name}", {k} neighbors')
        print(name, k, dict(zip(scales, np.round(lost, 1).tolist(), strict=True)))
    axes[2].set(xlabel="noise in spacings", ylabel="real points lost (%)")
    axes[2].grid(alpha=0.3)
    axes[2].legend()
    save(figure, "failure_noise")


def ghosts():
    """Groups of 30, 60, 90 and 150 points before a wall, and close to it."""
    rng = np.random.default_rng(1)
    wall = np.column_stack([rng.uniform(0, 8, 20_000), np.zeros(20_000), rng.uniform(0, 4, 20_000)])
    wall[:, 1] += rng.normal(scale=0.005, size=len(wall))
    figure, ax = plt.subplots(figsize=(11, 4.8), layout="constrained")
    clouds, truth = [wall], [np.ones(len(wall))]
    sizes = (30, 60, 90, 150, 300)
    for i, size in enumerate(sizes):
        for y, z in ((-1.2, 2.8), (-0.12, 1.2)):
            clouds.append(rng.normal([0.9 + 1.5 * i, y, z], 0.06, (size, 3)))
            truth.append(-np.ones(size))
    xyz, truth = np.vstack(clouds), np.concatenate(truth)
    labels = MCMDOutlierDetector(random_state=0).fit_predict(xyz)
    OutlierDisplay.from_predictions(xyz, labels, y_true=truth, view=(-104, 12), ax=ax)
    start = len(wall)
    for size in sizes:
        for where in ("in the air", "at the wall"):
            found = np.mean(labels[start : start + size] == -1)
            print(f"{size} points {where}: {100 * found:.0f} % found")
            start += size
    ax.set_title(
        "groups of 30, 60, 90, 150 and 300 points: above far from the wall, below close to it"
    )
    save(figure, "failure_ghosts")


def rounded():
    """Normals of a road whose coordinates were rounded to twice the spacing."""
    rng = np.random.default_rng(0)
    n = 30_000
    road = np.column_stack([rng.uniform(0, 6, n), rng.uniform(0, 3, n), np.zeros(n)])
    road[:, 2] = 0.02 * road[:, 1] + rng.normal(scale=0.002, size=n)
    coarse = np.column_stack([road[:, :2], np.round(road[:, 2] / 0.02) * 0.02])
    true = np.array([0, -0.02, 1]) / np.linalg.norm([0, -0.02, 1])
    figure, axes = plt.subplots(2, 2, figsize=(13, 5.4), layout="constrained", height_ratios=(2, 1))
    for column, (name, cloud) in zip(
        axes.T, {"as scanned": road, "heights rounded to 2 cm": coarse}.items(), strict=True
    ):
        angle = bias_angle(
            RobustNormalEstimator(random_state=0).fit(cloud).normals_, np.tile(true, (n, 1))
        )
        shade = plt.cm.ScalarMappable(plt.Normalize(0, 10), "magma_r")
        plot_cloud(cloud, color=shade.to_rgba(angle)[:, :3], view="top", ax=column[0])
        column[0].set_title(f"{name}: normals off by {angle.mean():.1f} degrees", fontsize=12)
        section = np.abs(cloud[:, 0] - 3) < 0.1
        column[1].scatter(cloud[section, 1], 100 * cloud[section, 2], s=3, c="0.4", linewidths=0)
        column[1].set(xlabel="across the road (m)", ylabel="height (cm)")
        print(f"{name}: mean angle {angle.mean():.2f}")
    figure.colorbar(shade, ax=axes[0], label="angle (degrees)", extend="max", shrink=0.9)
    save(figure, "failure_rounded")


def edges():
    """A kerb and a window with 25, 50 and 400 neighbors."""
    street = make_street(40_000, outlier_share=0.0, random_state=0)
    xyz = street.data
    known = np.isfinite(street.normals).all(axis=1)
    shown = (xyz[:, 1] > 2.2) & known
    kerb = street.surface == street.surface_names.index("kerb")
    figure, axes = plt.subplots(2, 2, figsize=(11, 7), layout="constrained")
    NormalsDisplay.from_predictions(
        xyz[shown], street.normals[shown], view=(-72, 16), ax=axes[1, 1]
    )
    axes[1, 1].set_title("the true normals", fontsize=12)
    for ax, k in zip(axes.flat, (15, 50, 400), strict=False):
        normals = RobustNormalEstimator(k, random_state=0).fit(xyz).normals_
        NormalsDisplay.from_predictions(xyz[shown], normals[shown], view=(-72, 16), ax=ax)
        ax.set_title(f"{k} neighbors", fontsize=12)
        angle = bias_angle(normals[known], street.normals[known])
        print(
            f"k = {k}: kerb {100 * np.mean(angle[kerb[known]] < 10):.0f} % within 10 degrees, "
            f"all {100 * np.mean(angle < 10):.0f} %"
        )
    save(figure, "failure_edges", colors=64)


FIGURES = {f.__name__: f for f in (sheets, noise, ghosts, rounded, edges)}

if __name__ == "__main__":
    for name in sys.argv[1:] or FIGURES:
        FIGURES[name]()
