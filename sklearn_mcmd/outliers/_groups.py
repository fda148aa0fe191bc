"""Groups of points: which are flat, and how far they stand off from what is real."""

import numpy as np

from sklearn_mcmd.planes._around import ratio


def are_flat_groups(points, group, flat):
    """Which groups are flat. The deviation off the plane has as many degrees of freedom as points
    beyond those that a plane needs, and counts with its standard error: few are flat by chance."""
    order = np.lexsort(points.T[::-1])
    sizes = np.bincount(group)
    spare = sizes - points.shape[1]
    deviations = _deviations(points[order], group[order], sizes, spare > 0)
    spare = np.maximum(spare, 1)
    off = deviations[:, 0] * np.sqrt(sizes / spare) * (1 + 1 / np.sqrt(2 * spare))
    return (deviations[:, -1] > 0) & (flat * off <= deviations[:, -1])


def gaps_of_groups(group, gaps):
    """The least of the gaps of the points of each group."""
    least = np.full(group.max(initial=-1) + 1, np.inf)
    np.minimum.at(least, group, gaps)
    return least


def separation_of_groups(points, group, usual, gaps):
    """Gap of each group over the size of the group, by the usual spacing around each point and its
    gap to the nearest that is real. Sums are taken in the order of coordinates, so they do not
    depend on that of the points."""
    order = np.lexsort(points.T[::-1])
    return separation_of_sorted(points[order], group[order], usual[order], gaps[order])


def separation_of_sorted(points, group, usual, gaps):
    """The same of points whose order is settled."""
    sizes = np.bincount(group)
    size = np.bincount(group, usual) / sizes
    size = np.maximum(size, _deviations(points, group, sizes, sizes > 1)[:, -1])
    return ratio(gaps_of_groups(group, gaps), size)


def _deviations(points, group, sizes, asked):
    """Standard deviations of groups along their axes, ascending; 0 of those that are not asked."""
    d = points.shape[1]
    covariance = np.zeros((len(sizes), d, d))
    centers = np.stack([np.bincount(group, points[:, i]) / sizes for i in range(d)], axis=1)
    away = points - centers[group]
    for i in range(d):
        for j in range(i + 1):
            covariance[:, i, j] = np.bincount(group, away[:, i] * away[:, j]) / sizes
    deviations = np.zeros((len(sizes), d))
    deviations[asked] = np.sqrt(np.maximum(np.linalg.eigvalsh(covariance[asked]), 0.0))
    return deviations
