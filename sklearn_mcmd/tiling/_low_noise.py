"""What outliers are compared with to tell low noise from high: the ground, or all that is kept."""

from sklearn_mcmd.io._classes import LowestPoints, ground_in
from sklearn_mcmd.io._las_parts import read_parts
from sklearn_mcmd.tiling._memory import PART
from sklearn_mcmd.tiling._result_files import Results, scores_in_parts

__all__ = ["lowest_points"]


def lowest_points(catalog, scored, cells, n_neighbors, cutoff):
    """The `LowestPoints` of the ground; where that is less than a neighborhood, of all kept points.

    Points whose scores, of `scored` by `Results`, are beyond the cutoff are in neither.
    """
    lowest = _ground(catalog, scored, n_neighbors, cutoff)
    if lowest.n_points < n_neighbors:
        lowest = _kept(scored, cells, n_neighbors, cutoff)
    return lowest


def _ground(catalog, scored, n_neighbors, cutoff):
    """The ground as far as it is no outlier; inputs are read once more."""
    results = Results(*scored)
    lowest, first = LowestPoints(catalog.n_points, n_neighbors), 0
    for path in catalog.paths:
        for cloud in read_parts(path, PART):
            scores = results.take(first, len(cloud), False)[:, 0]
            first += len(cloud)
            lowest.add(cloud.xyz[ground_in(cloud) & ~(scores > cutoff)])
    return lowest


def _kept(scored, cells, n_neighbors, cutoff):
    """All points that are no outliers."""
    lowest = LowestPoints(int(cells.counts.sum()), n_neighbors)
    for cell, scores in enumerate(scores_in_parts(*scored)):
        lowest.add(cells.read(cell)["xyz"][scores <= cutoff])
    return lowest
