"""The pictures of the guides; `figures.py` makes them."""

import runpy
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from figures_common import (
    BLUE,
    GRAY,
    GREEN,
    RED,
    kept,
    regions,
    save,
    street,
)

from sklearn_mcmd import (
    BaardaPlaneDetector,
    MCMDOutlierDetector,
    RegionGrowing,
    RobustNormalEstimator,
    SharpFeatureDetector,
)
from sklearn_mcmd.datasets import make_street
from sklearn_mcmd.metrics import bias_angle
from sklearn_mcmd.plotting import (
    PlaneResidualDisplay,
    plot_cloud,
    region_colors,
)


def majority():
    """One neighborhood of 50 points, ten of them outliers, in a cross section."""
    rng = np.random.default_rng(3)
    x = rng.uniform(-1, 1, 50)
    points = np.column_stack([x, rng.normal(0, 0.03, 50)])
    points[:10] = np.column_stack([rng.uniform(0.55, 0.95, 10), rng.normal(0.75, 0.1, 10)])
    fig, axes = plt.subplots(1, 2, figsize=(10, 3.1), layout="constrained", sharey=True)
    for ax, method, title, color in (
        (axes[0], "pca", "Least squares: every point pulls", BLUE),
        (axes[1], "mcmd_z", "MCMD: the plane that most points agree on", GREEN),
    ):
        estimator = RobustNormalEstimator(None, method=method, random_state=0).fit(points)
        normal = estimator.normals_[0]
        height = normal @ points[0] + estimator.plane_offset_[0]
        line = np.array([-1.1, 1.1])
        ax.plot(line, (height - normal[0] * line) / normal[1], color=color, lw=2.5, zorder=1)
        ax.scatter(*points[10:].T, s=22, color="0.35", lw=0)
        ax.scatter(*points[:10].T, s=22, color=RED, lw=0)
        angle = bias_angle(normal[None], np.array([[0.0, 1.0]]))[0]
        ax.set_title(f"{title}\n{angle:.1f} degrees off", fontsize=11)
        ax.set(aspect="equal", ylim=(-0.45, 1.05))
        ax.set_axis_off()
    save(fig, "majority.png")


def wall_and_tree(seed=0):
    """A road, a wall, a bush, a ghost and stray points, seen from the side."""
    rng = np.random.default_rng(seed)
    road = np.column_stack([rng.uniform(0, 6, 5_000), rng.uniform(0, 1, 5_000), np.zeros(5_000)])
    front = np.column_stack([np.full(2_500, 6.0), rng.uniform(0, (1, 3), (2_500, 2))])
    faces = np.vstack([road, front]) + rng.normal(0, 0.005, (7_500, 3))
    leaves = rng.normal(0, 1, (2_500, 3))
    leaves *= (rng.uniform(0, 1, 2_500) ** (1 / 3) / np.linalg.norm(leaves, axis=1))[:, None]
    leaves = leaves * [0.6, 0.45, 0.5] + [1.3, 0.5, 1.0]
    ghost = rng.normal((4.3, 0.5, 1.9), 0.06, (40, 3))
    stray = np.array([[3.1, 0.5, 0.9], [2.7, 0.5, 2.5], [5.2, 0.5, 0.5], [0.4, 0.5, 2.4]])
    return np.vstack([faces, leaves, ghost, stray]), len(faces), len(leaves), len(ghost)


def outliers_principle():
    points, n_faces, n_leaves, n_ghost = wall_and_tree()
    judge = MCMDOutlierDetector(random_state=0).fit(points)
    flagged = judge.scores_ < judge.offset_
    scores = -judge.scores_
    fig, ax = plt.subplots(figsize=(10, 4.6), layout="constrained")
    colors = np.where(judge.on_surface_, GRAY, np.where(flagged, RED, GREEN))
    sizes = np.where(flagged, 26, np.where(judge.on_surface_, 2, 5))
    order = np.argsort(sizes, kind="stable")
    ax.scatter(
        points[order, 0], points[order, 2], s=sizes[order], c=colors[order], lw=0, rasterized=True
    )
    ghost = scores[n_faces + n_leaves : n_faces + n_leaves + n_ghost]
    strays = scores[-4:]
    arrow = {"arrowstyle": "-", "color": "0.5", "lw": 0.8}
    for text, place, at in (
        ("on a surface: excused", (4.2, -0.45), (4.0, 0.0)),
        ("leaves: they keep company, excused", (0.0, -0.45), (1.2, 0.6)),
        (
            f"a small group that hangs in the air\nscore {np.median(ghost):.0f}",
            (3.5, 2.75),
            (4.3, 1.98),
        ),
        (f"alone: score {strays[0]:.0f}", (3.35, 0.85), (3.13, 0.9)),
        (f"alone: score {strays[1]:.0f}", (1.55, 2.75), (2.67, 2.53)),
    ):
        ax.annotate(text, at, place, arrowprops=arrow, fontsize=10.5, color="0.2")
    ax.set(aspect="equal", ylim=(-0.6, 3.15), xlim=(-0.1, 6.2))
    ax.set_axis_off()
    save(fig, "outliers_principle.png")


def outliers_strictness():
    scan = make_street(
        40_000, tree=True, outlier_share=0.02, outlier_kinds=("uniform", "ghost"), random_state=0
    )
    fig, axes = plt.subplots(1, 3, figsize=(13, 3.9), layout="constrained")
    for ax, strictness in zip(axes, ("isolated", "groups", "surfaces"), strict=True):
        judge = MCMDOutlierDetector(strictness=strictness, random_state=0).fit(scan.data)
        flagged = judge.scores_ < judge.offset_
        plot_cloud(scan.data, outliers=flagged, ax=ax)
        ax.set_title(f'"{strictness}" takes {100 * flagged.mean():.1f} %', fontsize=12)
    save(fig, "outliers_strictness.jpg")


def corner(n=14_000, noise=0.004, seed=0):
    """A floor that meets a wall at x = 0, with the true normals."""
    rng = np.random.default_rng(seed)
    floor = np.column_stack([rng.uniform(-1, 0, n), rng.uniform(0, 1, n), np.zeros(n)])
    wall = np.column_stack([np.zeros(n), rng.uniform(0, 1, n), rng.uniform(0, 1, n)])
    truth = np.repeat([[0.0, 0, 1], [1.0, 0, 0]], n, axis=0)
    return np.vstack([floor, wall]) + rng.normal(0, noise, (2 * n, 3)), truth


def normals_principle():
    points, truth = corner(5_000)
    slab = (np.abs(points[:, 1] - 0.5) < 0.022) & (points[:, 0] > -0.3) & (points[:, 2] < 0.3)
    fig, axes = plt.subplots(1, 2, figsize=(10, 4.2), layout="constrained")
    for ax, method, title in (
        (axes[0], "pca", "Least squares rounds the edge off"),
        (axes[1], "mcmd_z", "Here a normal is that of one face"),
    ):
        estimator = RobustNormalEstimator(method=method, random_state=0).fit(points)
        seen = estimator.normals_[slab]
        wrong = bias_angle(seen, truth[slab]) > 10
        toward = np.where(seen @ [-1.0, 0, 1.0] < 0, -1.0, 1.0)[:, None] * seen
        for rows, color in ((~wrong, BLUE), (wrong, RED)):
            start = points[slab][rows]
            end = start + 0.06 * toward[rows]
            ax.plot(
                [start[:, 0], end[:, 0]], [start[:, 2], end[:, 2]], color=color, lw=1.1, zorder=1
            )
        ax.scatter(points[slab, 0], points[slab, 2], s=9, color="0.25", lw=0, zorder=2)
        ax.set_title(
            f"{title}\n{wrong.sum()} of {slab.sum()} normals off by > 10 degrees", fontsize=11
        )
        ax.set(aspect="equal")
        ax.set_axis_off()
    save(fig, "normals_principle.png")


def normals_doubt():
    """What doubt adds to errors of normals near a blunt crease, which noise alone does not tell."""
    rng, spacing, slope = np.random.default_rng(0), 0.02, np.tan(np.radians(8))
    x, y = rng.uniform(-1, 1, (2, 10_000))
    points = np.column_stack([x, y, rng.normal(-slope * np.abs(x), 0.1 * spacing)])
    truth = np.column_stack([np.sign(x) * slope, np.zeros_like(x), np.ones_like(x)])
    estimator = RobustNormalEstimator(random_state=0).fit(points)
    off = bias_angle(estimator.normals_, truth / np.linalg.norm(truth, axis=1, keepdims=True))
    by_noise = estimator._surfaces.errors[estimator._model.index.places]
    edges = np.arange(0, 13)
    ring = np.digitize(np.abs(x) / spacing, edges) - 1
    fig, ax = plt.subplots(figsize=(7.6, 3.6), layout="constrained")
    for angles, color, label in (
        (off, "0.25", "how far normals are off"),
        (estimator.normal_error_, BLUE, "their error, with doubt"),
        (by_noise, RED, "their error by noise alone"),
    ):
        ax.stairs(
            [np.sqrt(np.mean(angles[ring == i] ** 2)) for i in edges[:-1]], edges, color=color
        )
        ax.plot([], [], color=color, label=label)
    ax.set(xlabel="distance from a crease of 16 degrees, in spacings", ylabel="degrees (r.m.s.)")
    ax.set(xlim=(0, 12), ylim=(0, None))
    ax.legend(frameon=False)
    save(fig, "normals_doubt.png")


def normals_street():
    """The error of each normal on the street, least squares beside the default."""
    scan = street()
    known = np.isfinite(scan.normals).all(axis=1)
    fig, axes = plt.subplots(1, 2, figsize=(12, 4.6), layout="constrained")
    for ax, method, name in ((axes[0], "pca", "least squares"), (axes[1], "mcmd_z", "default")):
        found = RobustNormalEstimator(method=method, random_state=0).fit(scan.data).normals_[known]
        angle = bias_angle(found, scan.normals[known])
        plot_cloud(scan.data[known], outliers=angle > 10, ax=ax)
        ax.set_title(
            f"{name}: {100 * np.mean(angle > 10):.1f} % of the normals are wrong", fontsize=12
        )
    save(fig, "normals_street.jpg")


def edges_principle():
    points, _ = corner(5_000)
    search = SharpFeatureDetector(random_state=0).fit(points)
    slab = (np.abs(points[:, 1] - 0.5) < 0.035) & (points[:, 0] > -0.25) & (points[:, 2] < 0.25)
    spacings = search.scores_[slab]
    edge = spacings < search.offset_
    fig, ax = plt.subplots(figsize=(6.4, 4.4), layout="constrained")
    ax.axhline(0, color=BLUE, lw=1, zorder=0)
    ax.axvline(0, color=BLUE, lw=1, zorder=0)
    shade = plt.cm.ScalarMappable(plt.Normalize(0, 12), "viridis_r")
    place = points[slab][:, [0, 2]]
    ax.scatter(*place.T, s=26, c=shade.to_rgba(spacings), lw=0)
    ax.scatter(*place[edge].T, s=70, facecolors="none", edgecolors=RED, lw=1.4)
    fig.colorbar(shade, ax=ax, label="distance to the crease, spacings", shrink=0.8, extend="max")
    ax.set(aspect="equal", xlim=(-0.26, 0.06), ylim=(-0.06, 0.26))
    ax.set_axis_off()
    ax.text(-0.25, 0.022, "plane of one face", color=BLUE, fontsize=9.5)
    ax.text(0.008, 0.2, "plane of\nthe other", color=BLUE, fontsize=9.5)
    save(fig, "edges_principle.png")


def segments_principle():
    """A cross section of the kerb, by growth alone and by the default."""
    points = kept()
    near = (points[:, 0] > 1.0) & (points[:, 0] < 1.25)
    fig, axes = plt.subplots(2, 1, figsize=(9, 3.0), layout="constrained")
    for ax, model, title in (
        (
            axes[0],
            RegionGrowing(normal_estimator=RobustNormalEstimator(method="pca"), refine=False),
            "least squares, growth alone: one region runs over the kerb",
        ),
        (axes[1], regions(), "default: road, kerb and footpath"),
    ):
        labels = model.fit(points).labels_
        y, z = points[near, 1], points[near, 2]
        band = (y > 1.0) & (y < 4.2) & (z < 0.45)
        ax.scatter(y[band], z[band], s=9, c=region_colors(labels[near][band]), lw=0)
        ax.set_title(title, fontsize=11)
        ax.set(aspect="equal")
        ax.set_axis_off()
    save(fig, "segments_principle.png")


def segments_street():
    fig, axes = plt.subplots(1, 2, figsize=(12, 4.6), layout="constrained")
    for ax, model, name in (
        (
            axes[0],
            RegionGrowing(normal_estimator=RobustNormalEstimator(method="pca"), refine=False),
            "least squares, growth alone",
        ),
        (axes[1], regions(), "default"),
    ):
        found = model.fit(kept())
        plot_cloud(kept(), color=region_colors(found.labels_), ax=ax)
        ax.set_title(f"{name}: {found.n_regions_} regions", fontsize=12)
    save(fig, "segments_street.jpg")


def wall(n=8_000, seed=0):
    """The wall of planes.rst: 4 mm of noise, and a strip that stands 3 cm before it."""
    rng = np.random.default_rng(seed)
    points = rng.uniform((0, 0, 0), (4, 0, 2.5), (n, 3))
    points[:, 1] = rng.normal(0, 0.004, n)
    front = points[:, 0] > 3.1
    points[front, 1] -= 0.03
    return points, front


def planes_tilt():
    points, _ = wall()
    fig, axes = plt.subplots(2, 1, figsize=(9, 4.6), layout="constrained", sharex=True)
    for ax, start, title in (
        (axes[0], False, "Least squares start: the plane leans toward the strip"),
        (axes[1], True, "robust_start=True"),
    ):
        test = BaardaPlaneDetector(
            sigma0=0.004, surface="orthogonal", robust_start=start, random_state=0
        ).fit(points)
        gone = test.labels_ == -1
        ax.scatter(points[~gone, 0], 1000 * points[~gone, 1], s=3, color="0.45", lw=0)
        ax.scatter(points[gone, 0], 1000 * points[gone, 1], s=3, color=RED, lw=0)
        x = np.array([0.0, 4.0])
        z = 1.25
        y = (test.distance_ - test.normal_[0] * x - test.normal_[2] * z) / test.normal_[1]
        ax.plot(x, 1000 * y, color=BLUE, lw=2)
        ax.set_title(f"{title}: {gone.sum():,} of {len(points):,} points rejected", fontsize=11)
        ax.set(ylabel="mm", ylim=(-48, 22))
    axes[1].set_xlabel("along the wall, m")
    save(fig, "planes_tilt.png")


def planes_residuals():
    points, _ = wall()
    test = BaardaPlaneDetector(
        sigma0="auto", surface="orthogonal", robust_start=True, random_state=0
    ).fit(points)
    fig, ax = plt.subplots(figsize=(7.6, 4.2), layout="constrained")
    PlaneResidualDisplay.from_estimator(test, points, ax=ax)
    save(fig, "planes_residuals.jpg")


def change():
    script = Path(__file__).parents[1] / "examples" / "change" / "plot_two_scans.py"
    save(runpy.run_path(str(script))["figure"], "change.png")


GUIDE_PICTURES = (
    majority,
    outliers_principle,
    outliers_strictness,
    normals_principle,
    normals_doubt,
    normals_street,
    edges_principle,
    segments_principle,
    segments_street,
    planes_tilt,
    planes_residuals,
    change,
)
