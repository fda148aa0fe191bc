"""Outliers of scanned scenes besides those of spinning turns: low, high and far ones."""

from sklearn_mcmd.datasets._labels import outlier_sizes
from sklearn_mcmd.datasets._outliers import draw_clear

from ._sensing import sense
from ._sensor_outliers import (
    _OFF,
    SENSOR_OUTLIERS,
    clumps,
    draw,
    in_box,
    met,
    on_beams,
)

_FAR = 0.1  # far outliers are so many diagonals of the cloud from every regular point


def low(scan, n, rng):
    """Clumps of 10 to 60 points on beams that seem to go on 2 to 10 m below what they meet."""

    def propose(m):
        beam, ranges, _ = met(scan, m, rng)
        return on_beams(scan, beam, ranges + rng.uniform(2.0, 10.0, m))

    return clumps(scan, n, (1.0, 3.0), draw, propose, rng, _OFF[0])


def high(scan, n, rng):
    """Birds and haze: alone, on beams, 5 to 40 m before what they meet."""

    def propose(m):
        beam, ranges, _ = met(scan, m, rng)
        return on_beams(scan, beam, ranges - rng.uniform(5.0, 40.0, m))

    return draw(scan, n, propose)


def far_single(scan, n, rng):
    """Anywhere in a box of three times the cloud's extent, alone."""
    return _draw_far(scan, n, in_box(scan, 3.0, rng))


def far_clump(scan, n, rng):
    """Clumps of 10 to 60 points, 2 to 10 spacings in radius, there."""
    return clumps(scan, n, (2.0, 10.0), _draw_far, in_box(scan, 3.0, rng), rng)


def _draw_far(scan, n, propose, more=0.0):
    least = _FAR * scan.diagonal + more
    return draw_clear(n, lambda rows: scan.tree.query(rows[:, :3])[0] > least, propose)


NEAR = SENSOR_OUTLIERS | {"low": low, "high": high}
FAR = {"far_single": far_single, "far_clump": far_clump}


def sense_with(make_world, sensor, n_samples, share, kinds, far_share, random_state):
    """A scan with a share of outliers of these kinds, and a share of far ones of both kinds."""
    sizes = outlier_sizes(n_samples, share, kinds, NEAR)
    sizes |= outlier_sizes(n_samples, far_share, FAR, FAR)
    return sense(make_world, sensor, n_samples, sizes, random_state, NEAR | FAR)
