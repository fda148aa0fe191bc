"""scikit-learn's own checks, on several configurations of each estimator."""

from sklearn.utils.estimator_checks import parametrize_with_checks

from sklearn_mcmd import MCMDOutlierDetector, RobustNormalEstimator
from sklearn_mcmd.baselines import PlaneOutlierDetector


@parametrize_with_checks(
    [
        MCMDOutlierDetector(),
        MCMDOutlierDetector(n_neighbors=20, method="mcmd_md", outlier_rate=0.2),
        MCMDOutlierDetector(refine=None, outlier_rate=0.3, support_fraction="auto", n_jobs=2),
        MCMDOutlierDetector(n_neighbors=None, refine=None, cutoff=2, outlier_rate=0.2),
        MCMDOutlierDetector(20, noise_scale="local", borrow=True, max_iter=5, outlier_rate=0.2),
        MCMDOutlierDetector(20, noise_scale="pooled", borrow=True, max_iter=3, outlier_rate=0.2),
        MCMDOutlierDetector(20, noise_scale=0.5, max_iter=2, outlier_rate=0.2),
        RobustNormalEstimator(outlier_rate=0.2),
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
    ]
)
def test_estimators_follow_the_conventions(estimator, check):
    check(estimator)
