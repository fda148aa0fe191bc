"""What all makers of clouds have in common: arrays, and errors that name a parameter."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from sklearn_mcmd.datasets import (
    make_box,
    make_contaminated_plane,
    make_street,
)

TYPES = {"target": "i8", "surface": "i8", "outlier_kind": "i1", "noise_scale": "f8"}
TYPES |= {"edge_distance": "f8"}
WIDE = dict.fromkeys(("data", "true_points", "normals", "sensor_origins"), "f8")


def test_every_array_has_a_row_per_point_and_the_documented_type():
    street = make_street(2_000, random_state=0)
    for name, kind in (TYPES | WIDE).items():
        assert street[name].dtype == np.dtype(kind), name
        assert street[name].shape == ((2_000, 3) if name in WIDE else (2_000,)), name
    assert np.isfinite(street.data).all()
    outlier = street.target == -1
    assert_array_equal(street.surface == -1, outlier)
    for name in ("true_points", "normals"):
        assert np.isnan(street[name][outlier]).all()


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
    (make_box, {"outlier_scale": 0.0}, "'outlier_scale' parameter"),
    (make_street, {"n_samples": 0}, "'n_samples' parameter"),
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
