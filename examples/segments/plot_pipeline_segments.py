"""
How do I get the surfaces of a noisy street scan, as a table?
=============================================================

The steps are denoising, normals and segments. Denoising drops rows, and no step of a scikit-learn
Pipeline may do that. So it is a mask before the Pipeline, which has the other two steps. Columns
have names in pandas or polars.

.. code-block:: bash

    python plot_pipeline_segments.py --points 30000
"""

import argparse

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from sklearn.pipeline import Pipeline

from sklearn_mcmd import MCMDOutlierDetector, RegionGrowing, RobustNormalEstimator
from sklearn_mcmd.datasets import make_street
from sklearn_mcmd.metrics import segmentation_scores
from sklearn_mcmd.plotting import plot_cloud, region_colors

parser = argparse.ArgumentParser()
parser.add_argument("--points", type=int, default=30_000, help="points of the street")
n_points = parser.parse_args().points

street = make_street(n_points, outlier_share=0.1, random_state=0)
cloud = pd.DataFrame(street.data, columns=["x", "y", "z"])

# %%
# Denoise. The mask is True for points on a surface.
inliers = MCMDOutlierDetector(random_state=0).fit_predict(cloud) == 1
print(
    f"{(~inliers).sum()} of {len(cloud)} points dropped, {np.sum(street.target == -1)} are outliers"
)

# %%
# Normals and segments. The Pipeline passes a data frame from step to step, with x, y, z, the
# normal, the surface variation and the eigenvalues.
pipeline = Pipeline(
    [
        ("normals", RobustNormalEstimator(n_neighbors=30, random_state=0)),
        ("segment", RegionGrowing(normals="precomputed")),
    ]
).set_output(transform="pandas")
labels = pipeline.fit_predict(cloud[inliers])
print(pipeline["segment"].feature_names_in_)

# %%
# One row for each segment. Size and normal show what the largest segments are: road and footpath
# are horizontal (normal_z near 1), the facade is vertical (near 0).
table = pipeline[:-1].transform(cloud[inliers]).assign(segment=labels)
segments = (
    table[table["segment"] >= 0]
    .groupby("segment")[["x", "y", "z", "normal_z"]]
    .mean()
    .assign(points=pipeline["segment"].region_sizes_, noise=pipeline["segment"].region_errors_)
)
print(segments.head(8).round(3).to_string())

# %%
# The same with ``set_output(transform="polars")`` and a polars frame as input. The labels do not
# depend on the kind of table.
try:
    import polars as pl
except ImportError:
    print("polars is not installed")
else:
    pipeline.set_output(transform="polars")
    again = pipeline.fit_predict(pl.from_numpy(street.data[inliers], schema=["x", "y", "z"]))
    print("polars gives the same segments:", bool((again == labels).all()))

# %%
# Scores by the truth. Points that denoising dropped belong to no segment.
whole = np.full(len(cloud), -1)
whole[inliers] = labels
scores = segmentation_scores(street.surface, whole)
print(
    f"{scores.proper} of {len(scores.surfaces)} surfaces proper, {scores.over} in pieces, "
    f"{scores.under} merged; adjusted Rand {scores.adjusted_rand:.3f}"
)

# %%
figure, axes = plt.subplots(1, 2, figsize=(13, 5), layout="constrained")
plot_cloud(street.data, outliers=~inliers, ax=axes[0]).set_title("dropped points in red")
shown = plot_cloud(street.data[inliers], color=region_colors(labels), ax=axes[1])
shown.set_title(f"{labels.max() + 1} segments")
plt.show()
