"""The methods that the paper compares, each in the reading that reproduces its rows.

A method takes clouds as an array and gives, for each, the normal of the plane and the mask of
the points that the plane was fitted to. Where the paper tells a method something about the
truth, the method here is told the same.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sklearn_mcmd._consistent_set import (
    draw_trials,
    localize,
    maximum_consistent_sets,
    n_support_points,
    n_trials_needed,
)
from sklearn_mcmd._plane import fit_planes
from sklearn_mcmd._rules import METHODS as RULES
from sklearn_mcmd._rules import robust_distances

__all__ = ["METHODS", "Method", "mcmd"]

SUCCESS_PROBABILITY = 0.9999  # P_r throughout the paper
ROUNDING = 8 * np.finfo(float).eps


@dataclass(frozen=True)
class Method:
    """A row of the tables.

    name : as in the paper's tables
    in_paper : whether the paper has this row
    reading : how the row is read, in a line
    apply : of (points (B, n, 3), regular bool (B, n), n_outliers, RandomState); returns
        normals (B, 3) and inliers bool (B, n)
    effort : share of the runs that is affordable
    """

    name: str
    in_paper: bool
    reading: str
    apply: Callable
    effort: float = 1.0

    def __call__(self, points, regular, n_outliers, random_state):
        return self.apply(points, regular, n_outliers, random_state)


def _pca(points, regular, n_outliers, random_state):
    return fit_planes(points)[2][..., 0], np.ones(points.shape[:2], dtype=bool)


def mcmd(rule, *, told, reweight):
    """MCMD; `told` is whether the method knows the share of outliers.

    Eq. 13 and h then follow that share, where they otherwise take a half.
    """

    def apply(points, regular, n_outliers, random_state):
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


METHODS = {
    method.name: method
    for method in (
        Method("PCA", True, "all points", _pca),
        Method(
            "MCMD_Z",
            True,
            "to the letter: h = .5 n, 69 trials, signed distances, median and MAD of all points",
            mcmd("mcmd_z", told=False, reweight=False),
        ),
        Method(
            "MCMD_MD",
            True,
            "told the true share e of outliers: h = (1 - e) n and the trials of Eq. 13 for e",
            mcmd("mcmd_md", told=True, reweight=False),
        ),
        Method(
            "MCMD_MD h=.5n",
            False,
            "to the letter: h = .5 n and 69 trials",
            mcmd("mcmd_md", told=False, reweight=False),
        ),
        Method(
            "reweighted",
            False,
            "this package's default: MCMD_Z told nothing, plane and scale reweighted twice",
            mcmd("mcmd_z", told=False, reweight=True),
        ),
    )
}
