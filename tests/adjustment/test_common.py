"""scikit-learn's own checks of both detectors."""

import pytest
from sklearn.utils.estimator_checks import parametrize_with_checks

from sklearn_mcmd.adjustment import BaardaPlaneDetector, FuzzyPlaneDetector

CONFIGURATIONS = [
    BaardaPlaneDetector(),
    BaardaPlaneDetector(test="t", elimination="all", correction="none"),
    # Of the checks' clouds some points must be outliers, for which these levels are lax.
    BaardaPlaneDetector(
        0.9,
        sigma0="auto",
        correction="none",
        surface="orthogonal",
        robust_start=True,
        random_state=0,
    ),
    FuzzyPlaneDetector(),
    FuzzyPlaneDetector(0.15, test="tau", width=0.3, weighting="cut", surface="orthogonal"),
    FuzzyPlaneDetector(0.5, sigma0="auto", width=0.1),
]


# The checks' clouds lie in no plane, or in an upright one.
@pytest.mark.filterwarnings("ignore:The points that pass are as thick as they are wide")
@pytest.mark.filterwarnings("ignore:The points lie along a plane tilted by")
@parametrize_with_checks(CONFIGURATIONS)
def test_scikit_learn_s_checks_pass(estimator, check):
    check(estimator)
