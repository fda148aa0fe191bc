"""The company of points that no surface explains: how far each, or its group, stands off."""

from typing import NamedTuple

import numpy as np

from sklearn_mcmd.outliers._off_surface import Unexplained, steps_between
from sklearn_mcmd.outliers._small_groups import company_of_groups, gaps_to
from sklearn_mcmd.planes._around import ratio
from sklearn_mcmd.planes._explaining import connected
from sklearn_mcmd.planes._nearest import NearestPoints
from sklearn_mcmd.runtime._progress import progress_part


class NewCompany(NamedTuple):
    """How far new points (m, d) stand off from a judged cloud."""

    spacing: np.ndarray  # (m,), as all, the mean distance to the nearest measurements
    isolation: np.ndarray
    separation: np.ndarray
    joined: np.ndarray  # bool: whether a point belongs to a group of the cloud, as separate as that

    @classmethod
    def none(cls, spacing):
        """Of points on surfaces."""
        isolation, separation = np.zeros((2, len(spacing)))
        return cls(spacing, isolation, separation, np.zeros(len(spacing), bool))


class OffSurface(NamedTuple):
    """The m points that no surface explains, as `MCMDOutlierDetector` judges their company.

    Scanners measure the skins of things, and where their lines are far apart, a thing lies in
    pieces, which are flat; of a wire or a pole there is no more than a row of points. Ghosts fill
    space.
    """

    unexplained: Unexplained
    usual: np.ndarray  # (m,), the usual spacing around each point
    real: list[NearestPoints]  # searches of what is real, as of `GroupCompany`; so are these:
    groups: np.ndarray
    straight: np.ndarray
    isolation: np.ndarray  # (m,), as the separation: see `measure`
    separation: np.ndarray

    @property
    def rows(self):
        """Rows (m,) of the points in the cloud's index."""
        return self.unexplained.rows

    def measure(self, queries, spacing):
        """The `NewCompany` of new points, each as if it were alone added to the cloud.

        `spacing` (m,) is as there. Isolation is the spacing among off-surface points and among all
        points, over the usual one; what has others near has about 1. Separation is the gap between
        the query, with the small group that it belongs to, and what is real, over their size; 0 for
        what belongs to a thing.
        """
        points, limits = self.unexplained, self.unexplained.limits
        usual, _ = points.usual_around(queries, None)
        distances, near = points.search.query(queries, limits.n_near, None)
        among_unexplained = points.spacing(queries, distances, near, itself=False)
        steps = steps_between(usual, self.usual, distances[:, :1], near[:, :1])[:, 0]
        separation = ratio(gaps_to(queries, self.real, None), usual)
        joined = steps <= limits.reach
        separation[joined] = self.separation[near[joined, 0]]
        isolation = points.isolated(among_unexplained, spacing, usual)
        return NewCompany(spacing, isolation, separation, joined)


def judge_off_surface(unexplained, least, n_jobs):
    """The `OffSurface` of `Unexplained` points, where a thing has `least` measurements."""
    with progress_part(0.0, 0.2):
        usual, gaps = unexplained.usual_around(unexplained.points, n_jobs)
    with progress_part(0.2, 0.7):
        among_unexplained, linked = unexplained.neighbors(usual, n_jobs)
    isolation = unexplained.isolated(among_unexplained, unexplained.among_all, usual)
    groups = connected(linked)[0]
    del linked
    with progress_part(0.7, 1.0):
        company = company_of_groups(unexplained, usual, gaps, groups, isolation, least, n_jobs)
    return OffSurface(unexplained=unexplained, usual=usual, **company._asdict())
