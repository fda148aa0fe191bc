"""The methods that the paper compares, each in the reading that reproduces its rows.

A method takes clouds as an array. For each cloud it returns the normal of the plane and the mask
of the points that the plane was fitted to. If the paper gives a method some of the truth, such as
the share of outliers, the method here gets the same.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sklearn_mcmd.baselines import Msac, Pca, Qsp, Ransac, Robpca, Ulsif
from sklearn_mcmd.planes._consistent_set import (
    draw_trials,
    localize,
    maximum_consistent_sets,
    n_support_points,
    n_trials_needed,
)
from sklearn_mcmd.planes._principal_planes import fit_planes
from sklearn_mcmd.planes._rules import METHODS as RULES
from sklearn_mcmd.planes._rules import robust_distances

SUCCESS_PROBABILITY = 0.9999  # P_r throughout the paper
ROUNDING = 8 * np.finfo(float).eps


@dataclass(frozen=True)
class Method:
    """A row of the tables.

    name : as in the paper's tables
    in_paper : whether the paper has this row
    reading : the reading of the row, in one line
    apply : function of (points (B, n, 3), regular bool (B, n), n_outliers, n_flagged,
        RandomState) that returns normals (B, 3) and inliers bool (B, n)
    effort : share of the runs that is made, less than 1 for slow methods
    """

    name: str
    in_paper: bool
    reading: str
    apply: Callable
    effort: float = 1.0

    def __call__(self, points, regular, n_outliers, random_state, n_flagged=None):
        """Normals and inliers; `n_flagged` is the number that methods without labels flag."""
        n_flagged = n_outliers if n_flagged is None else n_flagged
        return self.apply(points, regular, n_outliers, n_flagged, random_state)


def _baseline(comparator):
    """A comparator that labels points itself."""

    def apply(points, regular, n_outliers, n_flagged, random_state):
        found = comparator.fit(points, random_state=random_state)
        return found.normals, found.inliers

    return apply


def _scores(comparator):
    """A comparator that only scores; the given number of highest scores is flagged."""

    def apply(points, regular, n_outliers, n_flagged, random_state):
        return _without_highest(
            points, comparator.fit(points, random_state=random_state).scores, n_flagged
        )

    return apply


def _ulsif(points, regular, n_outliers, n_flagged, random_state):
    """uLSIF, trained on the regular points of the same cloud."""
    training = points[regular].reshape(len(points), -1, points.shape[2])
    method = TrainedUlsif(clean=training - points[:, :1])  # methods begin at the first point
    scores = method.fit(points, random_state=random_state).scores
    return _without_highest(points, scores, n_flagged)


@dataclass(frozen=True, eq=False)
class TrainedUlsif(Ulsif):
    """uLSIF with training points (B, m, d) of each neighborhood."""

    clean: object = None

    def _training(self, points, table, floor):
        return self.clean


def _without_highest(points, scores, n_flagged):
    """The plane of all points but the `n_flagged` with the highest scores."""
    inliers = np.ones(scores.shape, dtype=bool)
    highest = np.argsort(-scores, axis=1, kind="stable")[:, :n_flagged]
    np.put_along_axis(inliers, highest, False, axis=1)
    return _refit(points, inliers)


def mcmd(rule, *, told, reweight):
    """MCMD; `told` is whether the method knows the share of outliers.

    If so, Eq. 13 and h follow from that share. Otherwise both assume a half.
    """

    def apply(points, regular, n_outliers, n_flagged, random_state):
        n, d = points.shape[1:]
        share = n_outliers / n if told else 0.5
        n_support = n_support_points(1.0 - share, n, d)
        trials = draw_trials(n_trials_needed(share, SUCCESS_PROBABILITY, d), n, random_state)
        support, _, _ = maximum_consistent_sets(points, trials, n_support)
        local, radius = localize(points)
        floor = ROUNDING * (np.abs(points[:, 0]).max(axis=1) / radius + 1.0)
        valid = np.ones(points.shape[:2], dtype=bool)
        centers, whitening = RULES[rule].apply(local, valid, support, reweight, floor)
        distances = robust_distances(local, centers, whitening)
        return _refit(points, distances < RULES[rule].default_cutoff(d))

    return apply


def _refit(points, inliers):
    return fit_planes(points, inliers)[2][..., 0], inliers


# Zuliani's toolbox takes the threshold for three degrees of freedom. The paper gave it the variance
# of the noise, .01, in place of the standard deviation; see docs/reproduction.
MISTYPED = {"noise_scale": 0.01, "degrees_of_freedom": 3}
QSP_SAMPLE = 5  # gives Table 1's row with two peaks; the authors of qSp take 20

METHODS = {
    method.name: method
    for method in (
        Method("PCA", True, "all points", _baseline(Pca())),
        Method(
            "RANSAC",
            True,
            "noise sigma .01 (the variance), threshold .0337 by chi-squared of 3 degrees",
            _baseline(Ransac(**MISTYPED)),
        ),
        Method("MSAC", True, "as RANSAC", _baseline(Msac(**MISTYPED))),
        Method(
            "RPCA",
            True,
            "FAST-MCD of h = .5 n and its robust distances, without small-sample factors, its "
            "covariance corrected for a cut at .975",
            _baseline(Robpca(small_sample=False, consistency="quantile")),
        ),
        Method(
            "uLSIF",
            True,
            "trained on the regular points; flags as many points as there are outliers, in Table 4 "
            "the number that follows from its rates",
            _ulsif,
            effort=0.1,
        ),
        Method(
            "qSp",
            True,
            f"a sample of {QSP_SAMPLE}, the point itself excluded; flags as many as uLSIF",
            _scores(Qsp(sample_size=QSP_SAMPLE)),
        ),
        Method(
            "MCMD_Z",
            True,
            "as in the text: h = .5 n, 69 trials, signed distances, median and MAD of all points",
            mcmd("mcmd_z", told=False, reweight=False),
        ),
        Method(
            "MCMD_MD",
            True,
            "given the true share e of outliers: h = (1 - e) n and the trials of Eq. 13 for e",
            mcmd("mcmd_md", told=True, reweight=False),
        ),
        Method(
            "MCMD_MD h=.5n",
            False,
            "as in the text: h = .5 n and 69 trials",
            mcmd("mcmd_md", told=False, reweight=False),
        ),
        Method(
            "RANSAC sigma=.1",
            False,
            "RANSAC with the right noise sigma",
            _baseline(Ransac(noise_scale=0.1)),
        ),
        Method(
            "RPCA rrcov",
            False,
            "as R's rrcov: 2 components, small-sample factors, cut-off of orthogonal distances by "
            "the MAD",
            _baseline(Robpca(n_components=2, projection=False, orthogonal_scale="mad")),
        ),
        Method(
            "reweighted",
            False,
            "this package's default: MCMD_Z without given values, plane and scale reweighted twice",
            mcmd("mcmd_z", told=False, reweight=True),
        ),
    )
}
