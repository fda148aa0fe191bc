"""The numbers of README.md and the docs about the demo's street, from one command.

mcmd demo && python benchmarks/readme_figures.py mcmd-demo/street.laz
"""

import argparse

import numpy as np
from _tables import print_table
from sklearn.metrics import roc_auc_score

from sklearn_mcmd import MCMDOutlierDetector, RobustNormalEstimator
from sklearn_mcmd.datasets import make_street
from sklearn_mcmd.io import read_points
from sklearn_mcmd.metrics import bias_angle

DETECTORS = {
    "default": {},
    "isolated": {"strictness": "isolated"},
    "surfaces": {"strictness": "surfaces"},
    "paper": {"reweight": False, "strictness": None},
}
NORMALS = {"pca": {"method": "pca"}, "mcmd_z": {}, "not reweighted": {"reweight": False}}


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("street", help="street.laz of mcmd demo")
    X = read_points(parser.parse_args(arguments).street).xyz
    street = make_street(len(X), random_state=0)
    assert np.abs(street.data - X).max() < 1e-3, "not the demo's street"
    good, kinds = street.target == 1, street.outlier_kind_names[1:]
    rows = []
    for name, form in {
        **DETECTORS,
        "position": {"sensor_origin": street.sensor_origins[0]},
    }.items():
        detector = MCMDOutlierDetector(random_state=0, n_jobs=-1, **form).fit(X)
        flagged = detector.scores_ < detector.offset_
        shares = [flagged[~good], ~flagged[good], flagged != good]
        shares += [flagged[street.outlier_kind == i + 1] for i in range(len(kinds))]
        auc = roc_auc_score(good, detector.scores_)
        rows.append([name, *(100 * float(share) for share in (auc, *map(np.mean, shares)))])
    print_table("outliers", ["", "AUC", "found", "kept", "accuracy", *kinds], rows)
    with_normal = good & np.isfinite(street.normals).all(axis=1)
    near, rows = with_normal & (street.edge_distance < 0.08), []
    for name, form in NORMALS.items():
        normals = RobustNormalEstimator(random_state=0, n_jobs=-1, **form).fit(X).normals_
        every, close = (bias_angle(normals[r], street.normals[r]) for r in (with_normal, near))
        right = 100 * float(np.mean(close <= 10))
        rows.append([name, np.median(every), np.percentile(every, 95), np.median(close), right])
    head = ["", "median", "95 % below", "median near edges", "within 10 degrees, %"]
    print_table("normals", head, rows)


if __name__ == "__main__":
    main()
