"""Snowflakes that take the place of what a beam would meet.

At a snowfall of R mm/h a cubic meter holds N0 exp(-L D) dD flakes of melted diameter D,
N0 = 2500 R^-0.94 per mm and L = 2.29 R^-0.45 per mm (R. S. Sekhon and R. C. Srivastava, "Snow size
spectra and radar reflectivity", Journal of the Atmospheric Sciences 27, 1970); flakes have a tenth
of water's density. A beam meets those whose middle lies in it, in a width of 1 cm and 2 mrad, or
its divergence. The echo of a flake is as strong as its reflectance, 0.9, times the share of the
beam that it covers, over r^2 + (6 m)^2: close by, the receiver sees the beam's spot only in part.

A flake is written down where its echo is stronger than that of the surface behind, of reflectance
0.3, and than the weakest that the sensor knows, that of reflectance 0.8 at its reach. Of several
flakes the strongest counts. So the chance of a flake grows with the way, and falls with its own
range: far away only large ones are seen.

With the ranges of six real turns as those of what stands behind (``snow_spinning_lidar``, where
others simulated the snow), 2 mm/h end 2.9 to 3.5 % of these beams, there 2.8 to 3.1 %. Flakes are
1.1, 2.1, 3.5, 5.5 and 9.6 m away (5, 25, 50, 75 and 95 %), there 1.2, 2.2, 3.9, 6.2 and 11.9 m. The
6 m and this snowfall were chosen on one of these turns. Beams into the sky, of which those turns
have no record, meet flakes more often: nothing outshines them.
"""

import numpy as np

_N0, _LAMBDA = 2500.0, 2.29  # of flakes' sizes, per mm and m^3 and per mm, at 1 mm an hour
_N0_POWER, _LAMBDA_POWER = -0.94, -0.45  # and the powers of the snowfall with which they change
_SWELLING = 0.1 ** (-1 / 3)  # diameter over the melted one, by the density of flakes in water's
_FLAKE, _SURFACE = 0.9, 0.3  # reflectances
_BRIGHT = 0.8  # reflectance for which data sheets state the reach
_APERTURE, _DIVERGENCE = 0.01, 0.002  # width of the beam where it leaves, and usual divergence
_NEAREST = 0.9  # meters; nothing is seen nearer than this
_R0 = 6.0  # meters; from here on the receiver sees most of the spot
_STEPS = 4000  # of the sum over ranges


def flake_echoes(target, snowfall, reach, divergence, rng):
    """Beams on which a flake is what the sensor writes down, and the ranges of these flakes.

    `target` (n,) is the range of what each beam meets otherwise, inf where nothing; snowfall is in
    mm of water an hour, divergence in radians, where 0 means that of usual sensors.
    """
    ranges = np.linspace(_NEAREST, reach, _STEPS)
    weakest = _BRIGHT * _shine(reach)
    slope = _LAMBDA * snowfall**_LAMBDA_POWER  # by which numbers fall with the diameter in mm
    total, slope = _N0 * snowfall**_N0_POWER / slope, slope / _SWELLING
    width, size = _width(ranges, divergence), _least_size(ranges, weakest, divergence)
    # No flake covers more than all of the beam.
    rate = np.pi / 4 * (width / 1e3) ** 2 * total * np.exp(-slope * size) * (size <= width)
    steps = (rate[1:] + rate[:-1]) / 2 * np.diff(ranges)
    ways = np.concatenate([[0.0], np.cumsum(steps)])
    # All flakes on a beam that could be seen: their number, ranges, and sizes.
    counts = rng.poisson(ways[-1], len(target))
    beam = np.repeat(np.arange(len(target)), counts)
    at = np.interp(ways[-1] * rng.random(len(beam)), ways, ranges)
    size = _least_size(at, weakest, divergence) + rng.exponential(1 / slope, len(beam))
    power = _FLAKE * np.minimum(size / _width(at, divergence), 1.0) ** 2 * _shine(at)
    seen = (at < target[beam]) & (power > _SURFACE * _shine(target[beam]))
    beam, at, power = beam[seen], at[seen], power[seen]
    order = np.lexsort([-power, beam])
    chosen = order[np.concatenate([[True], np.diff(beam[order]) > 0])[: len(order)]]
    return beam[chosen], at[chosen]


def _least_size(ranges, power, divergence):
    """Diameter in mm from which a flake's echo is stronger than this power."""
    return np.sqrt(power / (_FLAKE * _shine(ranges))) * _width(ranges, divergence)


def _width(ranges, divergence):
    """Of the beam, in mm."""
    return 1e3 * (_APERTURE + (divergence or _DIVERGENCE) * ranges)


def _shine(ranges):
    """Power of an echo of a surface that reflects all, on any scale."""
    return 1 / (ranges**2 + _R0**2)
