"""scikit-learn's own checks of both detectors."""

from sklearn.utils.estimator_checks import parametrize_with_checks

from sklearn_mcmd.adjustment import BaardaPlaneDetector, FuzzyPlaneDetector

CONFIGURATIONS = [
    BaardaPlaneDetector(),
    BaardaPlaneDetector(0.15, elimination="all", correction="none", surface="orthogonal"),
    BaardaPlaneDetector(test="t", correction="none", estimator="tukey"),
    BaardaPlaneDetector(sigma0="auto", robust_start=True, contamination=0.1),
    FuzzyPlaneDetector(),
    FuzzyPlaneDetector(0.15, width=1.25, weighting="cut", surface="orthogonal"),
    FuzzyPlaneDetector(test="tau", width=0.3),
    FuzzyPlaneDetector(sigma0="auto", estimator="huber", contamination=0.1),
]

# Weights are precisions p = sigma0^2 / sigma_i^2, not repetitions. Two observations of one
# point have two residuals of redundancy 1 - h each and make two tests; one observation of
# double weight has a single residual of redundancy 1 - 2h and makes one. Degrees of freedom,
# local level and memberships therefore differ, and have to. That weight 0 is the same as
# absence, the check's other half, is tested in test_adjustment_edge_cases.
EXPECTED_FAILURES = {
    "check_sample_weight_equivalence_on_dense_data": "weights are precisions, not repetitions",
}


@parametrize_with_checks(CONFIGURATIONS, expected_failed_checks=lambda _: EXPECTED_FAILURES)
def test_scikit_learn_s_checks_pass(estimator, check):
    check(estimator)
