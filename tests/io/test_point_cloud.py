"""The cloud itself: subsets, attributes, and clouds that make no sense."""

import numpy as np
import pytest

from sklearn_mcmd.io import PointCloud


def test_a_subset_takes_attributes_along(cloud):
    half = cloud.subset(cloud.attributes["outlier"])
    assert len(half) == cloud.attributes["outlier"].sum() > 0
    assert half.attributes["outlier"].all()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda c: c.subset(np.ones(3, dtype=bool)), "mask has shape"),
        (lambda c: c.with_attributes(score=np.ones(3)), "one entry for each of the 40 points"),
        (lambda c: c.with_attributes(x=np.ones(40)), "taken by the coordinates"),
        (lambda c: PointCloud(np.ones((4, 2))), r"shape \(4, 2\)"),
        (lambda c: PointCloud([["a", "b", "c"]]), "must be numbers"),
    ],
)
def test_clouds_that_make_no_sense_are_refused(cloud, call, message):
    with pytest.raises(ValueError, match=message):
        call(cloud)
