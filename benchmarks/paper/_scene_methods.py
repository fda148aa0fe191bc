"""The methods that the paper compares, on the neighborhoods of whole scenes (Section 5.2)."""

from dataclasses import dataclass, field

import numpy as np

from benchmarks.paper._methods import QSP_SAMPLE
from sklearn_mcmd.normals._estimator import RobustNormalEstimator
from sklearn_mcmd.runtime._progress import listen_to_progress

# Share of each neighborhood that uLSIF and qSp remove for normals. They have no cut-off, and the
# paper does not state its share.
REMOVED_SHARE = 0.1


@dataclass(frozen=True)
class SceneMethod:
    """A row of the tables of Section 5.2, as estimators.

    name : as in the paper's tables
    in_paper : whether the paper has this row
    reading : the reading of the row, in one line
    method : `method` of RobustNormalEstimator
    method_params : parameters of the methods compared with
    mcmd_params : parameters of MCMD's planes
    slow : whether a point takes milliseconds
    """

    name: str
    in_paper: bool
    reading: str
    method: str
    method_params: dict | None = None
    mcmd_params: dict = field(default_factory=dict)
    slow: bool = False

    def normal_estimator(self, n_neighbors, seed):
        params = self.method_params
        if self.method in ("ulsif", "qsp"):
            params = {"contamination": REMOVED_SHARE, **(params or {})}
        return RobustNormalEstimator(
            n_neighbors,
            method=self.method,
            method_params=params,
            random_state=seed,
            **self.mcmd_params,
        )


LITERAL = {"reweight": False}

SCENE_METHODS = {
    method.name: method
    for method in (
        SceneMethod("PCA", True, "all points of a neighborhood; cut-off 2.5 deviations", "pca"),
        SceneMethod(
            "RANSAC",
            True,
            "the noise is estimated in each neighborhood; the paper does not state its noise",
            "ransac",
        ),
        SceneMethod(
            "RPCA",
            True,
            "FAST-MCD of h = .5 k and its robust distances, without small-sample factors",
            "robpca",
            {"small_sample": False, "consistency": "quantile"},
            slow=True,
        ),
        SceneMethod(
            "uLSIF",
            True,
            "trained on the central members of each neighborhood, since nothing else is known; "
            f"given the share of noise for outliers; removes {REMOVED_SHARE:.0%} of a neighborhood "
            "for normals",
            "ulsif",
            slow=True,
        ),
        SceneMethod(
            "qSp",
            True,
            f"a sample of {QSP_SAMPLE} of each neighborhood, the point itself excluded; shares as "
            "uLSIF",
            "qsp",
            {"sample_size": QSP_SAMPLE},
        ),
        SceneMethod(
            "MCMD_Z",
            True,
            "as in the text: h = .5 k, 69 trials, median and MAD of all k",
            "mcmd_z",
            mcmd_params=LITERAL,
        ),
        SceneMethod(
            "MCMD_MD",
            True,
            "h = .75 k, which gives its rows of Table 5; the text's .5 k does not",
            "mcmd_md",
            mcmd_params={**LITERAL, "support_fraction": 0.75},
        ),
        SceneMethod(
            "MCMD_MD h=.5k",
            False,
            "as in the text: h = .5 k",
            "mcmd_md",
            mcmd_params=LITERAL,
        ),
        SceneMethod("default", False, "this package's defaults, without given values", "mcmd_z"),
    )
}


def runs_of(method, runs):
    """Number of runs of a method: one if it is slow."""
    return 1 if method.slow else runs


def quietly(function, *arguments):
    """Call a function without showing the progress of its estimators."""
    with listen_to_progress(None):
        return function(*arguments)


def summary(values, digits):
    """Mean and, with more than one run, its standard error, as text."""
    values = np.asarray(values, dtype=float)
    mean = f"{values.mean():.{digits}f}"
    if len(values) == 1:
        return mean
    return f"{mean} ± {values.std(ddof=1) / np.sqrt(len(values)):.{digits}f}"
