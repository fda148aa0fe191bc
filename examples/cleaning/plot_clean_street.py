"""
What does cleaning remove from a street?
========================================

It removes what no surface and no company explains: single points, mixed pixels at edges, ghosts in
the air. Road, kerb, facade, sign and tree stay.

The scan is simulated, on scan lines. Each point knows whether it is real. The detector is not told.

.. code-block:: bash

    python plot_clean_street.py --points 60000
"""

import argparse

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize

from sklearn_mcmd import MCMDOutlierDetector
from sklearn_mcmd.datasets import make_street
from sklearn_mcmd.plotting import OutlierDisplay, plot_cloud

parser = argparse.ArgumentParser()
parser.add_argument("--points", type=int, default=60_000, help="points of the street")
n_points = parser.parse_args().points

scan = make_street(n_points, sampling="scan_lines", tree=True, outlier_share=0.05, random_state=0)
xyz, truth = scan.data, scan.target

# %%
# One line cleans. -1 is an outlier, 1 is real.
detector = MCMDOutlierDetector(random_state=0).fit(xyz)
labels = detector.predict(xyz)
removed = labels == -1
print(f"{removed.sum():,} of {len(xyz):,} points go, {(truth == -1).sum():,} are outliers")

# %%
# Before, with the removed points in red, and after. Near points are dark, far ones light.
view = (-118, 24)
figure, axes = plt.subplots(1, 2, figsize=(15, 7), layout="constrained")
plot_cloud(xyz, outliers=removed, view=view, ax=axes[0])
axes[0].set_title("Before: what goes is red", fontsize=13)
plot_cloud(xyz[~removed], view=view, ax=axes[1]).set_title("After", fontsize=13)
axes[1].set(xlim=axes[0].get_xlim(), ylim=axes[0].get_ylim())
plt.show()

# %%
# What was it? With the truth, the display tells found, missed and wrongly removed points. Missed
# are mostly sheets of mixed pixels. They lie between the front and the back of an edge, as dense
# and as flat as a wall.
kinds = np.array(scan.outlier_kind_names)[scan.outlier_kind]
for kind in np.unique(kinds):
    rows = kinds == kind
    print(f"{kind:<12} {rows.sum():>6,} points, {100 * removed[rows].mean():5.1f} % removed")

figure, ax = plt.subplots(figsize=(11, 7), layout="constrained")
OutlierDisplay.from_predictions(xyz, labels, y_true=truth, view=(-105, 14), ax=ax)
plt.show()

# %%
# The score says how sure the verdict is. 3 is the cutoff, 10 a clear error. Seen from the front,
# the tree is not more suspect than the facade.
figure, ax = plt.subplots(figsize=(11, 5), layout="constrained")
plot_cloud(xyz, color=np.clip(-detector.scores_, 0, 10), view="front", scale_bar=True, ax=ax)
shades = ScalarMappable(Normalize(0, 10))
figure.colorbar(shades, ax=ax, label="score", shrink=0.6, extend="max")
plt.show()
