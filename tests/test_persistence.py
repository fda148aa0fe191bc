"""Fitted estimators survive skops, which runs no code that a file holds; a pickle may."""

import numpy as np
import pytest

import sklearn_mcmd
from sklearn_mcmd import RegionGrowing
from sklearn_mcmd.datasets import make_contaminated_plane, make_street

skops = pytest.importorskip("skops.io")
ESTIMATORS = sorted(set(sklearn_mcmd._HOMES) - {"RegionGrowing"})


def through_skops(estimator):
    """The estimator that comes back; it needs no trust but in types of this package."""
    stored = skops.dumps(estimator)
    types = skops.get_untrusted_types(data=stored)
    assert all(name.startswith("sklearn_mcmd.") for name in types)
    return skops.loads(stored, trusted=types)


@pytest.mark.parametrize("name", ESTIMATORS)
def test_what_comes_back_answers_as_before(name):
    estimator = getattr(sklearn_mcmd, name)()
    if "random_state" in estimator.get_params():
        estimator.set_params(random_state=0)
    if "Plane" in name:
        X = make_contaminated_plane(200, random_state=0)[0]
    else:
        X = make_street(1_500, random_state=0).data
    back = through_skops(estimator.fit(X))
    new = X[::7] + 0.001
    for method in ("predict", "transform", "score_samples"):
        if hasattr(estimator, method):
            np.testing.assert_array_equal(
                getattr(back, method)(new), getattr(estimator, method)(new)
            )


def test_regions_go_without_their_table():
    growing = RegionGrowing(random_state=0).fit(make_street(1_500, random_state=0).data)
    with pytest.raises(skops.exceptions.UnsupportedTypeException):  # outlines of any length
        skops.dumps(growing)
    del growing.regions_
    np.testing.assert_array_equal(through_skops(growing).labels_, growing.labels_)
