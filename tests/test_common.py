"""scikit-learn's own checks, on several configurations of each estimator."""

from sklearn.utils.estimator_checks import parametrize_with_checks

from sklearn_mcmd import (
    MCMDOutlierDetector,
    RegionGrowing,
    RobustNormalEstimator,
    SharpFeatureDetector,
)
from sklearn_mcmd.baselines import PlaneOutlierDetector

# Checks of many features would ask the default's 50 % of outliers for a great many trials.
QUICK = RobustNormalEstimator(outlier_rate=0.2, random_state=0)


@parametrize_with_checks(
    [
        MCMDOutlierDetector(),
        MCMDOutlierDetector(n_neighbors=20, method="mcmd_md", outlier_rate=0.2),
        MCMDOutlierDetector(refine=None, outlier_rate=0.3, support_fraction="auto", n_jobs=2),
        MCMDOutlierDetector(n_neighbors=None, refine=None, cutoff=2, outlier_rate=0.2),
        MCMDOutlierDetector(20, noise_scale="local", borrow=True, max_iter=5, outlier_rate=0.2),
        MCMDOutlierDetector(20, noise_scale="pooled", borrow=True, max_iter=3, outlier_rate=0.2),
        MCMDOutlierDetector(20, noise_scale=0.5, max_iter=2, outlier_rate=0.2),
        MCMDOutlierDetector(None, false_positive_rate=0.1, outlier_rate=0.05),
        RobustNormalEstimator(outlier_rate=0.2),
        RobustNormalEstimator(n_neighbors=20, outlier_rate="auto"),
        RobustNormalEstimator(n_neighbors=20, method="mcmd_md", radius=1.5, outlier_rate=0.1),
        RobustNormalEstimator(method="pca", orientation="mst"),
        RobustNormalEstimator(n_neighbors=20, features="all", outlier_rate=0.1),
        RobustNormalEstimator(n_neighbors=None, refine=None, outlier_rate=0.2),
        RobustNormalEstimator(20, method="ransac", radius=1.5),
        RobustNormalEstimator(20, method="robpca", method_params={"n_trials": 30}),
        RobustNormalEstimator(20, method="ulsif", method_params={"contamination": 0.1}),
        RobustNormalEstimator(20, method="qsp", method_params={"contamination": 0.1}),
        PlaneOutlierDetector(),
        PlaneOutlierDetector(20, method="pca", contamination=0.1),
        PlaneOutlierDetector(20, method="msac", method_params={"noise_scale": 0.3}, n_jobs=2),
        PlaneOutlierDetector(None, method_params={"quantile": 0.9}),
        PlaneOutlierDetector(20, method="robpca", method_params={"n_trials": 30}),
        PlaneOutlierDetector(None, method="robpca", method_params={"projection": True}),
        PlaneOutlierDetector(20, method="qsp", contamination=0.1),
        PlaneOutlierDetector(None, method="qsp", contamination=0.1),
        PlaneOutlierDetector(
            20, method="ulsif", method_params={"widths": [0.3, 3]}, contamination=0.1
        ),
        PlaneOutlierDetector(None, method="ulsif", contamination=0.1),
        RegionGrowing(),
        RegionGrowing(10, max_distance=0.5, max_gap=1.0, normal_estimator=QUICK, n_jobs=2),
        RegionGrowing(
            15, mutual=False, join_coplanar=False, join_curved=False, normal_estimator=QUICK
        ),
        RegionGrowing(15, min_region_size=12, assign_rest=False, normal_estimator=QUICK),
        SharpFeatureDetector(
            20,
            outlier_detector=MCMDOutlierDetector(20, outlier_rate=0.2),
            normal_estimator=RobustNormalEstimator(20, outlier_rate=0.2),
        ),
        SharpFeatureDetector(
            20, outlier_detector="passthrough", normal_estimator=RobustNormalEstimator(method="pca")
        ),
        SharpFeatureDetector(
            20, criterion="eigenvalue", threshold="mean", outlier_detector="passthrough"
        ),
        SharpFeatureDetector(
            20, criterion="surface_variation", n_std=1.5, outlier_detector="passthrough"
        ),
        SharpFeatureDetector(
            20,
            criterion="removed_fraction",
            threshold=0.1,
            outlier_detector="passthrough",
            normal_estimator=RobustNormalEstimator(
                20, outlier_rate=0.2, features=["removed_fraction"]
            ),
        ),
    ]
)
def test_estimators_follow_the_conventions(estimator, check):
    check(estimator)
