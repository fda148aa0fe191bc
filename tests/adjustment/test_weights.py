"""Precisions reach a plane test through scikit-learn's metadata routing."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from sklearn import config_context
from sklearn.pipeline import Pipeline
from sklearn.preprocessing import FunctionTransformer

from adjustment_clouds import plane_with_outliers
from sklearn_mcmd.adjustment import BaardaPlaneDetector, FuzzyPlaneDetector

DETECTORS = [BaardaPlaneDetector, FuzzyPlaneDetector]
parametrized = pytest.mark.parametrize("detector", DETECTORS)


@pytest.fixture
def cloud():
    """Points, and precisions with which other points are outliers than without."""
    X = plane_with_outliers(200, 8, 12.0)
    weights = np.ones(200)
    weights[:4] = 0.01
    return X, weights


@parametrized
def test_a_pipeline_hands_requested_weights_to_the_detector(detector, cloud):
    X, weights = cloud
    expected = detector().fit(X, weights=weights).labels_
    assert (expected != detector().fit(X).labels_).any()
    with config_context(enable_metadata_routing=True):
        steps = [
            ("same", FunctionTransformer()),
            ("test", detector().set_fit_request(weights=True)),
        ]
        pipeline = Pipeline(steps)
        assert_array_equal(pipeline.fit(X, weights=weights)["test"].labels_, expected)
        assert_array_equal(pipeline.fit_predict(X, weights=weights), expected)
