"""
Does a cloud larger than memory give another result?
====================================================

Hardly. Large files are divided into tiles, and each tile is computed with the points around it. A
few points where tiles meet may have another verdict than in memory, and the run says of how many
points it is proven that nothing around them is missing. Here a street is written as four files, and
cleaned in tiles of at most 4,000 points, where usual ones have up to a million. The smaller tiles
are, the more of their points lie where they meet.

.. code-block:: bash

    mcmd denoise street/ clean/ --memory 4GB
    python plot_tiles.py --points 16000
"""

import argparse
from pathlib import Path
from tempfile import TemporaryDirectory

import matplotlib.pyplot as plt
import numpy as np

from sklearn_mcmd import MCMDOutlierDetector
from sklearn_mcmd.datasets import make_street
from sklearn_mcmd.io import PointCloud, read_points, write_points
from sklearn_mcmd.plotting import OutlierDisplay, SegmentationDisplay
from sklearn_mcmd.tiling import process_files

parser = argparse.ArgumentParser()
parser.add_argument("--points", type=int, default=16_000, help="points of the street")
n_points = parser.parse_args().points

street = make_street(n_points, tree=True, outlier_share=0.05, random_state=0)
xyz = np.round(street.data, 3)  # files have steps of 1 mm

# %%
# Four files, as four drives along the street would be.
part = np.clip(4 * (xyz[:, 0] - xyz[:, 0].min()) // np.ptp(xyz[:, 0]), 0, 3).astype(int)
with TemporaryDirectory() as folder:
    source, target = Path(folder, "street"), Path(folder, "clean")
    source.mkdir()
    for i in range(4):
        write_points(source / f"part{i}.laz", PointCloud(xyz[part == i]))
    parts = [read_points(source / f"part{i}.laz") for i in range(4)]
    detector = MCMDOutlierDetector(random_state=0)
    report = process_files(source, target, detector, mode="mark", tile_size=4_000, n_jobs=1)
    clouds = [read_points(target / f"part{i}.laz") for i in range(4)]
print(f"{report.n_points:,} points in {report.n_tiles} tiles, {report.n_outliers} outliers")
print(f"proven: {report.n_proven / report.n_points:.1%} of the points")

# %%
# The same in memory, and the number of points with another place, score or verdict.
whole = np.vstack([cloud.xyz for cloud in parts])
detector.fit(whole)
scores = np.concatenate([cloud.attributes["outlier_score"] for cloud in clouds])
classes = np.concatenate([cloud.attributes["classification"] for cloud in clouds])
flagged = np.isin(classes, (7, 18))  # low and high noise
print("points that moved:", np.sum(np.vstack([cloud.xyz for cloud in clouds]) != whole))
print("other scores:     ", np.sum(scores != (-detector.scores_).astype(scores.dtype)))
print("other verdicts:   ", np.sum(flagged != (detector.predict(whole) == -1)))

# %%
figure, axes = plt.subplots(1, 2, figsize=(14, 6), layout="constrained")
SegmentationDisplay.from_predictions(whole, np.sort(part), ax=axes[0])
axes[0].set_title("four files", fontsize=12)
OutlierDisplay.from_predictions(whole, np.where(flagged, -1, 1), ax=axes[1])
axes[1].set_title("one cloud, with no seam", fontsize=12)
plt.show()
