"""The numbers of README.md and docs/limits.rst about the demo's street, from one command.

mcmd demo && python benchmarks/readme_figures.py mcmd-demo/street.laz
"""

import argparse
from pathlib import Path

import numpy as np
from sklearn.metrics import roc_auc_score

from sklearn_mcmd import MCMDOutlierDetector, RobustNormalEstimator
from sklearn_mcmd.datasets import make_street
from sklearn_mcmd.io import read_points
from sklearn_mcmd.metrics import bias_angle

parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
parser.add_argument("street", help="street.laz of mcmd demo")
parser.add_argument("--data", help="folder with */cloud.npz, for the shares flagged there")
options = parser.parse_args()

cloud = read_points(options.street)
X = cloud.xyz
street = make_street(len(X), random_state=0)
assert np.abs(street.data - X).max() < 1e-3, "not the demo's street"

PAPER = {"reweight": False, "strictness": None}
good = street.target == 1
for parameters in ({}, {"strictness": "isolated"}, {"strictness": "surfaces"}, PAPER):
    detector = MCMDOutlierDetector(random_state=0, n_jobs=-1, **parameters).fit(X)
    scores = detector.scores_
    flagged = scores < detector.offset_
    print(f"{parameters or 'default'}: AUC {roc_auc_score(good, scores):.3f}, ", end="")
    print(
        f"found {100 * flagged[~good].mean():.1f} %, kept {100 * (~flagged[good]).mean():.1f} %, ",
        end="",
    )
    print(f"accuracy {100 * np.mean(flagged != good):.1f} %")
    for code, name in enumerate(street.outlier_kind_names):
        rows = street.outlier_kind == code
        if rows.any() and not good[rows].any():
            print(f"  {name}: {100 * flagged[rows].mean():.0f} % found")

known = good & np.isfinite(street.normals).all(axis=1)
near = known & (street.edge_distance < 0.08)
for parameters in ({"method": "pca"}, {}, {"reweight": False}):
    normals = RobustNormalEstimator(random_state=0, n_jobs=-1, **parameters).fit(X).normals_
    angles = [bias_angle(normals[rows], street.normals[rows]) for rows in (known, near)]
    print(f"{parameters}: median {np.median(angles[0]):.2f}, ", end="")
    print(f"95 % {np.percentile(angles[0], 95):.1f}, ", end="")
    print(f"near edges {np.median(angles[1]):.1f}, ", end="")
    print(f"{100 * np.mean(angles[1] <= 10):.1f} % within 10 degrees")

if options.data:
    for path in sorted(Path(options.data).glob("*/cloud.npz")):
        with np.load(path) as arrays:
            labels = MCMDOutlierDetector(random_state=0, n_jobs=-1).fit_predict(arrays["xyz"])
        print(f"{path.parent.name}: {100 * np.mean(labels == -1):.1f} % flagged")
