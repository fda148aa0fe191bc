"""scikit-learn's own checks, on the fewest configurations that take every branch."""

import pytest
from sklearn.utils.estimator_checks import check_param_validation, parametrize_with_checks

from public import ESTIMATORS
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


CHECKS = parametrize_with_checks(
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
            criterion="eigenvalue",
            threshold="mean",
            outlier_detector="passthrough",
            normal_estimator=RobustNormalEstimator(**FEW),
        ),
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
)


def compiles(estimator, check):
    """Whether curvatures or creases are compiled anew: of arrays that are read only."""
    dear = getattr(estimator, "features", None) == "all" or hasattr(estimator, "min_angle")
    return dear and "readonly_memmap=True" in str(check)


# Checks of ten features ask for more trials than are made; some clouds lie in no plane, or in an
# upright one.
@pytest.mark.filterwarnings(
    "ignore:max_outlier_rate=.* in 10D asks for",
    "ignore:strictness=.* in 10D finds few",
    "ignore:The points that pass are as thick as they are wide",
    "ignore:The points lie along a plane tilted by",
)
@pytest.mark.parametrize(
    CHECKS.args[0],
    [pytest.param(*case, marks=[pytest.mark.slow] * compiles(*case)) for case in CHECKS.args[1]],
    ids=CHECKS.kwargs["ids"],
)
def test_estimators_follow_the_conventions(estimator, check):
    check(estimator)


@pytest.mark.parametrize("kind", dict.fromkeys(map(type, ESTIMATORS.values())))
def test_parameters_out_of_range_are_refused_by_name(kind):
    """By the ranges that are declared; `cli/test_options.py` has the limits themselves."""
    check_param_validation(kind.__name__, kind())
