"""scikit-learn's own checks, on the fewest configurations that take every branch."""

import numpy as np
import pytest
from sklearn.utils.estimator_checks import parametrize_with_checks

from sklearn_mcmd import (
    BaardaPlaneDetector,
    FuzzyPlaneDetector,
    MCMDOutlierDetector,
    RegionGrowing,
    RobustNormalEstimator,
    SharpFeatureDetector,
)
from sklearn_mcmd.baselines import PlaneOutlierDetector

# Checks of many features would ask the default's 50 % of outliers for a great many trials.
FEW = {"n_neighbors": 20, "max_outlier_rate": 0.2}
NORMALS = RobustNormalEstimator(**FEW, random_state=0)


# Checks of ten features ask for more trials than are made.
@pytest.mark.filterwarnings(
    "ignore:max_outlier_rate=.* in 10D asks for", "ignore:strictness=.* in 10D finds few"
)
@parametrize_with_checks(
    [
        MCMDOutlierDetector(),
        MCMDOutlierDetector(
            **FEW, method="mcmd_md", reweight=False, support_fraction=0.7, n_jobs=2
        ),
        MCMDOutlierDetector(**FEW, strictness="surfaces", noise_scale=0.5, contamination=0.1),
        MCMDOutlierDetector(**FEW, strictness="isolated", contamination=0.2),
        MCMDOutlierDetector(**FEW, strictness=None, noise_scale=0.5),
        MCMDOutlierDetector(None, contamination=0.1, max_outlier_rate=0.05),
        RobustNormalEstimator(**FEW, features="all"),
        RobustNormalEstimator(**FEW, method="mcmd_md", reweight=False, radius=1.5),
        RobustNormalEstimator(None, method="pca", orientation="mst"),
        PlaneOutlierDetector(20, method_params={"max_trials": 100}, n_jobs=2),
        PlaneOutlierDetector(None, method="qsp", contamination=0.1),
        RegionGrowing(normal_estimator=NORMALS),
        RegionGrowing(10, max_distance=0.5, max_gap=1.0, refine=False, normal_estimator=NORMALS),
        SharpFeatureDetector(  # of 25, some points of the checks' blobs are on edges; of 20, none
            25, outlier_detector=MCMDOutlierDetector(**FEW), normal_estimator=NORMALS
        ),
        SharpFeatureDetector(
            20,
            criterion="removed_fraction",
            threshold="mean",
            outlier_detector="passthrough",
            normal_estimator=RobustNormalEstimator(**FEW, features=["removed_fraction"]),
        ),
    ],
)
def test_estimators_follow_the_conventions(estimator, check):
    check(estimator)


@pytest.mark.parametrize(
    "detector",
    [
        MCMDOutlierDetector(20, random_state=0),
        MCMDOutlierDetector(20, strictness="surfaces", contamination=0.1, random_state=0),
        PlaneOutlierDetector(20, random_state=0),
        PlaneOutlierDetector(20, method="qsp", contamination=0.1, random_state=0),
        SharpFeatureDetector(20, random_state=0),
        BaardaPlaneDetector(sigma0="auto"),
        FuzzyPlaneDetector(sigma0="auto"),
    ],
)
def test_labels_of_the_fitted_cloud_are_those_that_fit_predict_returns(detector):
    rng = np.random.default_rng(0)
    X = rng.uniform(size=(400, 3)) * [4, 4, 0]
    X[:, 2] = 2 * np.maximum(X[:, 0] - 3, 0) + rng.normal(0, 0.01, 400)
    X[:20, 2] += rng.uniform(1, 3, 20)
    assert not hasattr(detector, "labels_")
    labels = detector.fit_predict(X)
    assert set(labels) == {-1, 1}
    np.testing.assert_array_equal(detector.labels_, labels)
    assert detector.labels_.dtype == labels.dtype
    np.testing.assert_array_equal(detector.predict(X), labels)
