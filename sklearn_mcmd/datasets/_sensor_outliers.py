"""Outliers that sensors make, and far ones.

Each maker gives rows of point, viewpoint and number of the beam. Balls and far points lie on no
beam: theirs is one from where they are seen.
"""

import numpy as np

from sklearn_mcmd.datasets._outliers import CLEARANCE, cluster_sizes, draw_clear

__all__ = ["FAR", "MAKERS"]

#: Mixed pixels: both surfaces are farther apart than these, in spacings and in meters.
_MIXED_GAP = 5.0, 0.15

#: Range errors and ghosts keep so many spacings off.
_OFF = 5.0, 20.0

#: Meters; no sensor measures less.
_NEAREST = 0.1

#: Balls are measured in median spacings, but these count at most this share of the diagonal:
#: in a cloud of few points they still have room.
_LARGEST_SPACING = 0.003

#: Far outliers are so far from every regular point, in diagonals of the cloud.
_FAR = 0.1


def mixed_pixel(scan, n, rng):
    """Between two surfaces that neighboring beams of a line meet, on a beam between them."""
    ranges, part = scan.first
    jump = np.abs(np.diff(np.where(np.isfinite(ranges), ranges, 0.0)))
    least = max(_MIXED_GAP[0] * np.median(scan.spacing), _MIXED_GAP[1])
    edge = (part[:-1] >= 0) & (part[1:] >= 0) & (part[:-1] != part[1:]) & (jump > least)
    edge = np.flatnonzero(edge & (np.diff(scan.beams.line) == 0))
    if len(edge) == 0:
        raise ValueError(
            f"{len(scan.points)} regular points show no edge with a surface behind it, and so no "
            "mixed pixels: give more points, or leave 'mixed_pixel' out of outlier_kinds."
        )

    def propose(m):
        i = rng.choice(edge, m)
        between, share = rng.random((2, m))
        return _on_beams(scan, i, (1 - share) * ranges[i] + share * ranges[i + 1], between)

    return _draw(scan, n, propose)


def range_error(scan, n, rng):
    """A wrong range: 5 to 20 spacings before or behind what the beam meets."""

    def propose(m):
        beam, ranges, spacing = _met(scan, m, rng)
        off = rng.uniform(*_OFF, m) * rng.choice([-1.0, 1.0], m)
        return _on_beams(scan, beam, ranges + off * spacing)

    return _draw(scan, n, propose)


def ghost(scan, n, rng):
    """Dense balls of 10 to 60 points, 1 to 3 spacings in radius, floating off the surfaces."""
    return _clumps(scan, n, (1.0, 3.0), _draw, _in_box(scan, 1.0, rng), rng, _OFF[0])


def low(scan, n, rng):
    """Clumps of 10 to 60 points on beams that seem to go on 2 to 10 m below what they meet."""

    def propose(m):
        beam, ranges, _ = _met(scan, m, rng)
        return _on_beams(scan, beam, ranges + rng.uniform(2.0, 10.0, m))

    return _clumps(scan, n, (1.0, 3.0), _draw, propose, rng, _OFF[0])


def high(scan, n, rng):
    """Birds and haze: alone, on beams, 5 to 40 m before what they meet."""

    def propose(m):
        beam, ranges, _ = _met(scan, m, rng)
        return _on_beams(scan, beam, ranges - rng.uniform(5.0, 40.0, m))

    return _draw(scan, n, propose)


def particle(scan, n, rng):
    """Snow or dust near the sensor, on beams: ranges follow a log-normal distribution."""

    def propose(m):
        i = rng.integers(len(scan.beams.line), size=m)
        ranges = rng.lognormal(np.log(3.9), 0.75, m)
        return _on_beams(scan, i, np.minimum(ranges, scan.first[0][i]))

    return _draw(scan, n, propose)


def no_return(scan, n, rng):
    """Beams without an echo, written down as points where the sensor is."""
    beam = rng.integers(len(scan.beams.line), size=n)
    origins = scan.beams.origins[beam]
    return np.column_stack([origins, origins, beam])


def far_single(scan, n, rng):
    """Anywhere in a box of three times the cloud's extent, alone."""
    return _draw_far(scan, n, _in_box(scan, 3.0, rng))


def far_clump(scan, n, rng):
    """Clumps of 10 to 60 points, 2 to 10 spacings in radius, there."""
    return _clumps(scan, n, (2.0, 10.0), _draw_far, _in_box(scan, 3.0, rng), rng)


#: Maker of each kind; with those of far outliers, the order sets the codes: position + 1.
MAKERS = {
    "mixed_pixel": mixed_pixel,
    "range_error": range_error,
    "ghost": ghost,
    "low": low,
    "high": high,
    "particle": particle,
    "no_return": no_return,
}
FAR = {"far_single": far_single, "far_clump": far_clump}


def _on_beams(scan, beam, ranges, between=None):
    """Rows at those ranges on beams, or between a beam and the next one by that share."""
    origin, direction = scan.beams.origins[beam], scan.beams.directions[beam]
    if between is not None:
        direction = direction + between[:, None] * (scan.beams.directions[beam + 1] - direction)
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    ranges = np.maximum(ranges, _NEAREST)
    points = scan.sensor.record(origin, direction, ranges, np.zeros(len(beam), int))
    return np.column_stack([points, origin, beam])


def _in_box(scan, size, rng):
    """Proposals in the cloud's box, enlarged about its middle, seen from where points are."""
    low, high = scan.points.min(axis=0), scan.points.max(axis=0)
    middle, half = (low + high) / 2, size * (high - low) / 2

    def propose(m):
        beam = scan.beam[rng.integers(len(scan.beam), size=m)]
        points = rng.uniform(middle - half, middle + half, (m, 3))
        return np.column_stack([points, scan.beams.origins[beam], beam])

    return propose


def _draw(scan, n, propose, more=0.0):
    """Proposals off the world's parts, by their noise and by more."""

    def clearance(rows):
        ranges = np.linalg.norm(rows[:, :3] - rows[:, 3:6], axis=1)
        return CLEARANCE * scan.sensor.noise_at(ranges) + more

    return draw_clear(lambda rows: scan.world.distance(rows[:, :3]), n, clearance, propose)


def _draw_far(scan, n, propose, more=0.0):
    return draw_clear(
        lambda rows: scan.tree.query(rows[:, :3])[0],
        n,
        lambda rows: np.full(len(rows), _FAR * scan.diagonal + more),
        propose,
    )


def _clumps(scan, n, radii, draw, propose, rng, off=0.0):
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


def _met(scan, m, rng):
    """Beam, range and spacing of m random regular points."""
    i = rng.integers(len(scan.points), size=m)
    beam = scan.beam[i]
    return beam, np.linalg.norm(scan.points[i] - scan.beams.origins[beam], axis=1), scan.spacing[i]
