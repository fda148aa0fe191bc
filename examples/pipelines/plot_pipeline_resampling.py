"""
Can denoising be a step of the Pipeline?
========================================

In imbalanced-learn's Pipeline it can. Its samplers have `fit_resample`, which drops rows of X and y
together. `DenoisingSampler` is one. The first example is one object for denoising, normals and
segments. In the second, a classifier learns from a cleaned cloud and labels every point of a new,
noisy one.

.. code-block:: bash

    pip install imbalanced-learn
    python plot_pipeline_resampling.py --points 10000
"""

import argparse

import matplotlib.pyplot as plt
import numpy as np
from sklearn.ensemble import RandomForestClassifier

from sklearn_mcmd import MCMDOutlierDetector, RegionGrowing, RobustNormalEstimator
from sklearn_mcmd.datasets import make_street
from sklearn_mcmd.plotting import plot_cloud, region_colors
from sklearn_mcmd.resampling import DenoisingSampler

parser = argparse.ArgumentParser()
parser.add_argument("--points", type=int, default=10_000, help="points of each street")
n_points = parser.parse_args().points

street, other = (make_street(n_points, outlier_share=0.1, random_state=seed) for seed in (0, 1))
sampler = DenoisingSampler(MCMDOutlierDetector(random_state=0))

# %%
# Without imbalanced-learn, the sampler is a function of X and y.
X, y = sampler.fit_resample(street.data, street.target)
print(f"outliers: {np.mean(street.target == -1):.1%} before, {np.mean(y == -1):.1%} after")

# %%
# With imbalanced-learn: denoise, normals, segments. Each row that was kept gets a label.
try:
    from imblearn.pipeline import make_pipeline
except ImportError:
    raise SystemExit("The rest needs imbalanced-learn: pip install imbalanced-learn") from None

segments = make_pipeline(
    sampler,
    RobustNormalEstimator(n_neighbors=30, random_state=0),
    RegionGrowing(normals="precomputed"),
)
labels = segments.fit_predict(street.data)
rows = segments[0].sample_indices_
print(f"{labels.max() + 1} segments of {len(rows)} of {n_points} points")

# %%
# A classifier of surfaces is fitted without the outliers, and applied to all points of another
# street. Only fitting drops rows.
features = ["planarity", "verticality", "roughness"]
classifier = make_pipeline(
    sampler,
    RobustNormalEstimator(n_neighbors=30, features=features, random_state=0),
    RandomForestClassifier(50, random_state=0),
).fit(street.data, street.surface)
found = classifier.predict(other.data)
true_points = other.target == 1
print(
    f"another street: {len(found)} points labeled, "
    f"{np.mean(found[true_points] == other.surface[true_points]):.1%} of the true ones right"
)

# %%
ax = plot_cloud(street.data[rows], color=region_colors(labels))
ax.set_title("one pipeline: denoised, normals, segments")
plt.show()
