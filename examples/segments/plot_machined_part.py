"""
Where are the edges and faces of a machined part?
=================================================

A block with a step, a hole and a round boss, scanned with a noise of a tenth of the spacing. The
detector finds creases: lines in which the planes of two faces meet. The walls of hole and boss are
bent, and have no creases but their rims. The bottom is open: its rim has one face only, and is not
found. Region growing gives each of the ten faces a number.

.. code-block:: bash

    python plot_machined_part.py --points 24000
"""

import argparse

import matplotlib.pyplot as plt
import numpy as np

from sklearn_mcmd import RegionGrowing, RobustNormalEstimator, SharpFeatureDetector
from sklearn_mcmd.plotting import EdgeDisplay, NormalsDisplay, SegmentationDisplay

parser = argparse.ArgumentParser()
parser.add_argument("--points", type=int, default=24_000, help="points of the part")
n_points = parser.parse_args().points
rng = np.random.default_rng(0)

# %%
# The part, in millimeters: 60 by 40 by 25, with a step 15 high over its right third.
HOLE, BOSS = (15.0, 20.0, 7.0), (36.0, 20.0, 6.0)  # x, y, radius


def rectangle(corner, u, v):
    corner, u, v = (np.array(a, dtype=float) for a in (corner, u, v))
    area = np.linalg.norm(np.cross(u, v))
    return area, lambda n: corner + rng.uniform(size=(n, 1)) * u + rng.uniform(size=(n, 1)) * v


def tube(x, y, radius, low, high):
    def make(n):
        angle, z = rng.uniform(0, 2 * np.pi, n), rng.uniform(low, high, n)
        return np.column_stack([x + radius * np.cos(angle), y + radius * np.sin(angle), z])

    return 2 * np.pi * radius * (high - low), make


def disc(x, y, radius, z):
    def make(n):
        angle, r = rng.uniform(0, 2 * np.pi, n), radius * np.sqrt(rng.uniform(size=n))
        return np.column_stack([x + r * np.cos(angle), y + r * np.sin(angle), np.full(n, z)])

    return np.pi * radius**2, make


def outside(points, x, y, radius, z):
    """Points that no round thing at height z has taken."""
    gone = np.hypot(points[:, 0] - x, points[:, 1] - y) < radius
    return ~(gone & (np.abs(points[:, 2] - z) < 0.01))


faces = [
    rectangle((0, 0, 10), (48, 0, 0), (0, 40, 0)),  # the lower top, with hole and boss
    rectangle((48, 0, 25), (22, 0, 0), (0, 40, 0)),  # the upper top
    rectangle((48, 0, 10), (0, 40, 0), (0, 0, 15)),  # the wall of the step
    rectangle((0, 0, 0), (70, 0, 0), (0, 0, 10)),  # sides
    rectangle((48, 0, 10), (22, 0, 0), (0, 0, 15)),
    rectangle((0, 40, 0), (70, 0, 0), (0, 0, 10)),
    rectangle((48, 40, 10), (22, 0, 0), (0, 0, 15)),
    rectangle((0, 0, 0), (0, 40, 0), (0, 0, 10)),
    rectangle((70, 0, 0), (0, 40, 0), (0, 0, 25)),
    tube(*HOLE, 0, 10),
    tube(*BOSS, 10, 18),
    disc(*BOSS, 18),
]
total = sum(area for area, _ in faces)
true = np.vstack([make(round(n_points * area / total)) for area, make in faces])
true = true[outside(true, *HOLE, 10) & outside(true, *BOSS, 10)]
spacing = np.sqrt(total / n_points)
xyz = true + rng.normal(scale=0.1 * spacing, size=true.shape)
print(f"{len(xyz):,} points, spacing {spacing:.2f} mm, noise {0.1 * spacing:.2f} mm")

# %%
# The score of the edges is the distance to the crease, in spacings. So a narrower band needs no new
# fit.
normals = RobustNormalEstimator(30, random_state=0)
columns = normals.fit_transform(xyz)
edges = SharpFeatureDetector(random_state=0).fit(xyz)
regions = RegionGrowing(normals="precomputed").fit(columns)
print(f"{regions.labels_.max() + 1} regions; the part has 10 faces")

view = (-62, 38)


def solid(ax):
    """Draw points so large that the front hides the back."""
    for points in ax.collections:
        points.set_sizes(4 * points.get_sizes())


narrow = np.where(edges.scores_ < 0.5, -1, 1)
figure, axes = plt.subplots(2, 2, figsize=(13, 8.5), layout="constrained")
NormalsDisplay.from_estimator(normals, xyz, view=view, ax=axes[0, 0])
SegmentationDisplay.from_estimator(regions, columns, view=view, ax=axes[0, 1])
EdgeDisplay.from_estimator(edges, xyz, view=view, ax=axes[1, 0])
EdgeDisplay.from_predictions(xyz, narrow, view=view, ax=axes[1, 1])
axes[1, 1].set_title("within half a spacing of a crease", fontsize=12)
for ax in axes.flat:
    solid(ax)
plt.show()
