"""What all makers of clouds have in common: arrays, and errors that name a parameter."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from sklearn_mcmd.datasets import (
    make_box,
    make_contaminated_plane,
    make_lidar_turn,
    make_street,
)

NO_OUTLIER = {"surface": -1, "classification": -1, "echo": 0}  # what outliers have
TYPES = {"target": "i8", "surface": "i8", "outlier_kind": "i1", "noise_scale": "f8"}
WIDE = dict.fromkeys(("data", "true_points", "normals", "sensor_origins"), "f8")


@pytest.mark.parametrize(
    ("make", "own"),
    [
        (make_street, {"edge_distance": "f8"}),
        (make_lidar_turn, {"classification": "i8", "echo": "i1", "ring": "i8"}),
    ],
)
def test_every_array_has_a_row_per_point_and_the_documented_type(make, own):
    scan = make(2_000, random_state=0)
    for name, kind in (TYPES | WIDE | own).items():
        assert scan[name].dtype == np.dtype(kind), name
        assert scan[name].shape == ((2_000, 3) if name in WIDE else (2_000,)), name
    assert np.isfinite(scan.data).all()
    outlier = scan.target == -1
    for name in NO_OUTLIER.keys() & scan.keys():
        assert_array_equal(scan[name] == NO_OUTLIER[name], outlier, err_msg=name)
    for name in ("true_points", "normals"):
        assert np.isnan(scan[name][outlier]).all()


BAD = [
    (make_street, {"outlier_kinds": ["rain"]}, r"outlier_kinds=\['rain'\] must name"),
    (make_street, {"outlier_kinds": ["ghost", "ghost"]}, "once each"),
    (make_street, {"outlier_kinds": []}, "once each, one or more"),
    (make_street, {"outlier_kinds": "ghost"}, "'outlier_kinds' parameter"),
    (make_street, {"outlier_share": 1.0}, "'outlier_share' parameter"),
    (make_street, {"n_samples": 1, "outlier_share": 0.9}, "leaves no regular point"),
    (make_street, {"noise": -0.1}, "'noise' parameter"),
    (make_street, {"noise_growth": 0.5}, "'noise_growth' parameter"),
    (make_street, {"noise": 2.0}, "noise leaves no room"),
    (make_street, {"beam_divergence": 0.003}, "beam_divergence=0.003 is for sampling"),
    (make_box, {"outlier_scale": 0.0}, "'outlier_scale' parameter"),
    (make_lidar_turn, {"outlier_kinds": ["gaussian"]}, "outlier_kinds="),
    (make_lidar_turn, {"n_samples": 0}, "'n_samples' parameter"),
    (
        make_lidar_turn,
        {"n_samples": 4, "outlier_share": 0.5, "outlier_kinds": ["mixed_pixel"]},
        "give more points",
    ),
    (
        make_lidar_turn,
        {"n_samples": 1, "outlier_share": 0, "snow": 300.0, "random_state": 2},
        "leave no regular point",
    ),
    (make_contaminated_plane, {"outliers": "none"}, "'outliers' parameter"),
    (make_contaminated_plane, {"outlier_share": 1.2}, "'outlier_share' parameter"),
    (make_contaminated_plane, {"regular_variances": (1, 1, -1)}, "regular_.*not negative"),
    (make_contaminated_plane, {"regular_variances": (1, 1, 1)}, "one must be the least"),
    (make_contaminated_plane, {"outlier_variances": (1, np.nan, 1)}, "outlier_var.*three"),
    (make_contaminated_plane, {"outlier_variances": (1, 1)}, "outlier_variances=.*three"),
]


@pytest.mark.parametrize(("make", "parameters", "message"), BAD)
def test_bad_parameters_are_named(make, parameters, message):
    with pytest.raises(ValueError, match=message):
        make(**({"n_samples": 500, "random_state": 0} | parameters))
