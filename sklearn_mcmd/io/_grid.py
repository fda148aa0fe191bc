"""The grid of integers on which LAS stores coordinates: as fine as the coordinates ask for."""

import numpy as np

from sklearn_mcmd.io._point_cloud import PointFileError

LARGEST = 2**31 - 1  # integer of LAS
DECIMALS = 6  # that are looked for
PRECISE = 1e-4  # decimal steps from here on may not be lost; finer ones are printed digits
OF_EXTENT = 1e-6  # elsewhere the scale is at most so much of the extent of the middle half of all
MOST = 0.9  # points that must lie on a step
SAMPLE = 1000  # points that show the decimals of most, and their extent
SHOWN = 3  # points that an error names


def scale_of(xyz, axes=slice(None)):
    """The coarsest of 1, 0.1 ... 1e-6 that holds some axes exactly, else the finest that fits.

    Raise if it is coarser than most points ask for: than their decimal step, 0.0001 or more, else
    than a millionth of the extent of their middle half.
    """
    values, asked = xyz[:, axes], None
    sample = np.unique(values[:: len(xyz) // SAMPLE + 1], axis=0)  # copies, as of no returns, once
    with np.errstate(over="ignore", invalid="ignore"):
        extent = np.ptp(values, axis=0).max() or 1.0
        # About an offset in the middle, half the extent has room in 31 bits.
        finest = 10.0 ** np.ceil(np.log10(extent / 2 / (LARGEST - 1)))
        usual = np.median(np.abs(sample).max(axis=1))
        for step in 10.0 ** -np.arange(DECIMALS + 1):
            share = _on_grid(sample, step, usual).mean()
            if asked is None and share > MOST:
                asked = step
            if share == 1 and step >= finest and _on_grid(values, step, usual).all():
                return step
        some = np.unique(xyz[:: len(xyz) // SAMPLE + 1], axis=0)
        half = np.ptp(np.quantile(some, [0.25, 0.75], axis=0), axis=0).max() or np.inf
        precise = asked is not None and asked >= PRECISE
        bound = asked if precise else max(OF_EXTENT * half, asked or 0)
        if finest > bound:
            _refuse(values, np.median(sample, axis=0), bound)
        # Finer than double precision no step can be told.
        return max(finest, 10.0 ** np.floor(np.log10(np.spacing(np.abs(values).max()))))


def offset_of(low, high, scale):
    """A round number below the minimum, or the middle if only that leaves room for all."""
    if high <= low:
        return low
    # The power of ten of the extent: from 362,327.1 to 362,359.8 the offset is 362,320.
    unit = 10.0 ** np.floor(np.log10(high - low))
    below = np.floor(low / unit) * unit
    return below if high - below <= LARGEST * scale else np.rint((low + high) / 2 / scale) * scale


def _on_grid(xyz, step, usual):
    """Whether each point lies on the grid, up to the rounding of usual coordinates."""
    # By whole steps a unit, as 0.001 itself is rounded in double precision and 1000 is not.
    steps_a_unit = np.rint(1 / step)
    rounded = np.rint(xyz * steps_a_unit) / steps_a_unit
    return (np.abs(rounded - xyz) <= 4 * np.spacing(np.maximum(np.abs(xyz), usual))).all(axis=1)


def _refuse(xyz, middle, bound):
    step = 10.0 ** np.floor(np.log10(bound) + 1e-9)
    far = np.abs(xyz - middle).max(axis=1) > 0.9 * LARGEST * step
    rows = np.flatnonzero(far)
    places = [
        f"point {row + 1} at ({', '.join(f'{x:.10g}' for x in xyz[row])})" for row in rows[:SHOWN]
    ]
    more = f" and {len(rows) - SHOWN:,} more" if len(rows) > SHOWN else ""
    raise PointFileError(
        f"LAS has no room for points so far from the others in steps of {step:g}, which most "
        f"coordinates ask for: of {len(xyz):,} points to write, {', '.join(places)}{more}; remove "
        "them, or write a format without steps, such as .ply or .csv"
    )
