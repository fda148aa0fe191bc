"""
What did the detector find?
===========================

Displays draw results as scikit-learn's do: from a fitted estimator, or from predictions. With the
truth, `OutlierDisplay` tells found, missed and wrongly flagged points apart. Views are called
top, front, side and perspective; a bar shows a length.

``plotting.view`` makes a page instead, to look around in; see :doc:`/view`.

    python plot_displays.py --points 20000
"""

import argparse

import matplotlib.pyplot as plt

from sklearn_mcmd import MCMDOutlierDetector, RegionGrowing, RobustNormalEstimator
from sklearn_mcmd.datasets import make_street
from sklearn_mcmd.plotting import NormalsDisplay, OutlierDisplay, SegmentationDisplay

parser = argparse.ArgumentParser()
parser.add_argument("--points", type=int, default=20_000, help="points of the street")
n_points = parser.parse_args().points

street = make_street(n_points, outlier_share=0.1, random_state=0)
detector = MCMDOutlierDetector(random_state=0).fit(street.data)
kept = street.data[detector.predict(street.data) == 1]
normals = RobustNormalEstimator(random_state=0)
columns = normals.fit_transform(kept)
regions = RegionGrowing(normals="precomputed").fit(columns)

# %%
# The same street four times: the verdict beside the truth, the score from the front, the normals
# of what is left, and its regions from above.
fig, axes = plt.subplots(2, 2, figsize=(13, 9), layout="constrained")
OutlierDisplay.from_estimator(detector, street.data, street.target, ax=axes[0, 0])
OutlierDisplay.from_estimator(detector, street.data, show="scores", view="front", ax=axes[0, 1])
NormalsDisplay.from_estimator(normals, kept, ax=axes[1, 0])
SegmentationDisplay.from_estimator(regions, columns, view="top", ax=axes[1, 1])

plt.show()
