"""Outliers that sensors make.

Each maker gives rows of point, viewpoint and number of the beam. Balls lie on no beam: theirs is
one from where they are seen.
"""

import numpy as np

from sklearn_mcmd.datasets._outliers import CLEARANCE, cluster_sizes, draw_clear

_MIXED_GAP = 5.0, 0.15  # surfaces of mixed pixels are farther apart, in spacings and in meters
_OFF = 5.0, 20.0  # range errors are so many spacings off; ghosts keep the first from surfaces
_NEAREST = 0.1  # meters; no sensor measures less
_LARGEST_SPACING = 0.003  # of the diagonal, at most, so that balls have room in few points
_PARTICLES = np.log(3.9), 0.75  # log-normal ranges of particles: half of them within 3.9 m


def mixed_pixel(scan, n, rng):
    """Between two surfaces that neighboring beams of a line meet, on a beam between them."""
    ranges, part = scan.first
    jump = np.abs(np.diff(np.where(np.isfinite(ranges), ranges, 0.0)))
    least = max(_MIXED_GAP[0] * np.median(scan.spacing), _MIXED_GAP[1])
    edge = (part[:-1] >= 0) & (part[1:] >= 0) & (part[:-1] != part[1:]) & (jump > least)
    edge = np.flatnonzero(edge & (np.diff(scan.beams.line) == 0))
    if len(edge) == 0:
        raise ValueError(
            f"{len(scan.points)} regular points show no edge for mixed pixels: give more points."
        )

    def propose(m):
        i = rng.choice(edge, m)
        between, share = rng.random((2, m))
        return on_beams(scan, i, (1 - share) * ranges[i] + share * ranges[i + 1], between)

    return draw(scan, n, propose)


def range_error(scan, n, rng):
    """A wrong range: 5 to 20 spacings before or behind what the beam meets."""

    def propose(m):
        beam, ranges, spacing = met(scan, m, rng)
        off = rng.uniform(*_OFF, m) * rng.choice([-1.0, 1.0], m)
        return on_beams(scan, beam, ranges + off * spacing)

    return draw(scan, n, propose)


def ghost(scan, n, rng):
    """Dense balls of 10 to 60 points, 1 to 3 spacings in radius, floating off the surfaces."""
    return clumps(scan, n, (1.0, 3.0), draw, in_box(scan, 1.0, rng), rng, _OFF[0])


def particle(scan, n, rng):
    """Snow or dust near the sensor, on beams: ranges follow a log-normal distribution."""

    def propose(m):
        i = rng.integers(len(scan.beams.line), size=m)
        ranges = rng.lognormal(*_PARTICLES, m)
        return on_beams(scan, i, np.minimum(ranges, scan.first[0][i]))

    return draw(scan, n, propose)


def no_return(scan, n, rng):
    """Beams without an echo, written down as points where the sensor is."""
    beam = rng.integers(len(scan.beams.line), size=n)
    origins = scan.beams.origins[beam]
    return np.column_stack([origins, origins, beam])


#: Maker of each kind. The order sets the codes: position + 1, as 0 means no outlier.
SENSOR_OUTLIERS = {
    make.__name__: make for make in (mixed_pixel, range_error, ghost, particle, no_return)
}


def on_beams(scan, beam, ranges, between=None):
    """Rows at those ranges on beams, or between a beam and the next one by that share."""
    origin, direction = scan.beams.origins[beam], scan.beams.directions[beam]
    if between is not None:
        direction = direction + between[:, None] * (scan.beams.directions[beam + 1] - direction)
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    ranges = np.maximum(ranges, _NEAREST)
    points = scan.sensor.record(origin, direction, ranges, np.zeros(len(beam), int))
    return np.column_stack([points, origin, beam])


def in_box(scan, size, rng):
    """Proposals in the cloud's box, enlarged about its middle, seen from where points are."""
    low, high = scan.points.min(axis=0), scan.points.max(axis=0)
    middle, half = (low + high) / 2, size * (high - low) / 2

    def propose(m):
        beam = scan.beam[rng.integers(len(scan.beam), size=m)]
        points = rng.uniform(middle - half, middle + half, (m, 3))
        return np.column_stack([points, scan.beams.origins[beam], beam])

    return propose


def draw(scan, n, propose, more=0.0):
    """Proposals off the world's parts, by their noise and by more."""

    def is_clear(rows):
        ranges = np.linalg.norm(rows[:, :3] - rows[:, 3:6], axis=1)
        return scan.world.distance(rows[:, :3]) > CLEARANCE * scan.sensor.noise_at(ranges) + more

    return draw_clear(n, is_clear, propose)


def clumps(scan, n, radii, draw, propose, rng, off=0.0):
    """Balls about drawn centers, which keep off by more than the largest radius.

    ``radii``, from and to, and ``off`` are in median spacings.
    """
    unit = min(np.median(scan.spacing), _LARGEST_SPACING * scan.diagonal)
    sizes = cluster_sizes(n, rng)
    centers = draw(scan, len(sizes), propose, unit * (off + radii[1]))
    direction = rng.standard_normal((n, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    reach = np.repeat(unit * rng.uniform(*radii, len(sizes)), sizes) * np.cbrt(rng.random(n))
    rows = np.repeat(centers, sizes, axis=0)
    rows[:, :3] += reach[:, None] * direction
    return rows


def met(scan, m, rng):
    """Beam, range and spacing of m random regular points."""
    i = rng.integers(len(scan.points), size=m)
    beam = scan.beam[i]
    return beam, np.linalg.norm(scan.points[i] - scan.beams.origins[beam], axis=1), scan.spacing[i]
