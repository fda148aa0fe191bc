"""``mcmd warm-up``."""

from sklearn_mcmd.cli._messages import clear_exits, print_table, progress, stopwatch
from sklearn_mcmd.cli._options import Quiet


def warm_up(quiet: Quiet = False) -> None:
    """Compile for this computer what denoise, normals, segment and edges need.

    Their first run then does not wait. The code is kept on disk until the package or Numba changes.
    """
    with clear_exits():
        import sklearn_mcmd
        from sklearn_mcmd.datasets import make_street

        seconds = stopwatch()
        X = make_street(20_000, outlier_share=0.1, random_state=0).data
        estimators = (
            sklearn_mcmd.MCMDOutlierDetector,
            sklearn_mcmd.RobustNormalEstimator,
            sklearn_mcmd.RegionGrowing,
            sklearn_mcmd.SharpFeatureDetector,
        )
        with progress("warm-up", quiet) as part:
            for i, estimator in enumerate(estimators):
                with part(i / 4, (i + 1) / 4, estimator.__name__):
                    estimator(random_state=0).fit(X)
        if not quiet:
            print_table("Compiled", seconds=f"{seconds():.1f}")
