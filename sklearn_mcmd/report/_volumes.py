"""Whether removed points lie together: as a thing does that is sparser than what is around it."""

from typing import NamedTuple

import numpy as np
from scipy.ndimage import label

from sklearn_mcmd.outliers._model import LEVELS
from sklearn_mcmd.planes._indexed_cloud import location_hashes

SAMPLE = 200_000  # points that tell the ends of the whole
MOST_CELLS = 2**20  # of an eighth of a box; it limits the memory


class VolumeLimits(NamedTuple):
    """When a box of the cloud is lost. Boxes overlap by half, and if all removed points were strewn
    evenly, each would hold one."""

    least: int = 4  # a lost box holds this many times that
    share: float = 1 / 2  # this share of its points is removed
    # Some of its points are kept, or it holds this many times what boxes hold by chance: where
    # nothing is kept, single errors and small groups are all that there is.
    dense: int = 40
    many: int = 400  # removed points in lost boxes that overlap or touch, from which on they count,
    few: float = 0.08  # or this share of a small cloud
    trim: float = 0.01  # the whole leaves out this share of the points at each end of an axis
    flattest: float = 1e-3  # its least side, as a share of the longest


class LostVolume(NamedTuple):
    """Lost boxes that overlap or touch: removed points, all points, and corners."""

    n_lost: int
    n_all: int
    low: np.ndarray
    high: np.ndarray


def losses_of(detector, parts, n_points):
    """In words, where outliers lie together that nobody asked for; "" if nowhere.

    Parts and points are as of `lost_volumes`.
    """
    if detector.strictness is not None and LEVELS[detector.strictness].off_surfaces:
        return ""  # things that are no surfaces are to go
    return words_of(lost_volumes(parts, n_points))


def lost_volumes(parts, n_points):
    """The volumes that lost hundreds of points, or a large share of few, the largest first.

    ``parts()`` iterates over the parts of a cloud of n points: points (m, 3), and which are
    removed. The order of points and parts does not matter.
    """
    step, limits = np.uint64(-(-n_points // SAMPLE)), VolumeLimits()
    many, n_removed = min(limits.many, limits.few * n_points), 0
    samples: tuple[list, list] = ([], [])
    for xyz, removed in parts():
        n_removed += int(np.count_nonzero(removed))
        chosen = location_hashes(xyz) % step == 0
        for sample, is_of_it in zip(samples, (removed, ~removed), strict=True):
            sample.append(xyz[chosen & is_of_it])
    ends = [
        np.quantile(points, [limits.trim, 1 - limits.trim], axis=0)
        for points in map(np.concatenate, samples if n_removed >= many else ())
        if len(points)
    ]
    if not ends or not np.ptp(ends, axis=(0, 1)).any():
        return []
    low, extent = np.min(ends, axis=0)[0], np.ptp(ends, axis=(0, 1))
    extent = np.maximum(extent, limits.flattest * extent.max())
    # Cubes of this side fill the whole, eight for each removed point: a box of eight would hold one
    # if they were strewn evenly. Quotients by the longest extent keep the product from overflow.
    side = extent.max() * np.cbrt(np.prod(extent / extent.max()) / min(8 * n_removed, MOST_CELLS))
    shape = np.ceil(extent / side).astype(int)
    counts = np.zeros((2, np.prod(shape)), np.int32)  # of removed points, and of all
    for xyz, removed in parts():
        places = np.floor((xyz - low) / side)
        inside = ((places >= 0) & (places < shape)).all(axis=1)
        codes = np.ravel_multi_index(tuple(places[inside].astype(int).T), shape)
        for count, cells in zip(counts, (codes[removed[inside]], codes), strict=True):
            count += np.bincount(cells, minlength=len(count)).astype(np.int32)
    n_lost, n_all = counts.reshape(2, *shape)
    # A rim of empty cubes, so that there are boxes around those at the ends, too.
    lost, whole = (_pairs(np.pad(count, 1), np.add) for count in (n_lost, n_all))
    even = max(1.0, 8 * n_removed / MOST_CELLS)  # 1, or more where memory limits the cubes
    boxes = (lost >= limits.least * even) & (lost >= limits.share * whole)
    # What boxes hold by chance: of points strewn at random, exp(-mean) of the boxes are empty.
    strewn = -np.log((1 + np.count_nonzero(lost == 0)) / (1 + lost.size))
    boxes &= (lost < whole) | (lost >= limits.dense * strewn)
    volumes, _ = label(_pairs(boxes, np.logical_or), np.ones((3, 3, 3)))
    lost_ones = []
    sizes = np.bincount(volumes.ravel(), n_lost.ravel())
    for number in 1 + np.flatnonzero(sizes[1:] >= many):
        cells = volumes == number
        corners = side * np.argwhere(cells)
        low_there, high_there = low + corners.min(axis=0), low + corners.max(axis=0) + side
        lost_there, all_there = int(sizes[number]), int(n_all[cells].sum())
        lost_ones.append(LostVolume(lost_there, all_there, low_there, high_there))
    return sorted(lost_ones, key=lambda volume: -volume.n_lost)


def words_of(volumes):
    """A sentence on such volumes; "" if there are none."""
    if not volumes:
        return ""
    worst, n_more = volumes[0], len(volumes) - 1
    digits = max(0, 1 - int(np.floor(np.log10((worst.high - worst.low).max()))))
    spans = zip("xyz", worst.low.tolist(), worst.high.tolist(), strict=True)
    where = ", ".join(f"{axis} {low:.{digits}f} to {high:.{digits}f}" for axis, low, high in spans)
    more = f", and others in {n_more:,} more places" if n_more else ""
    return (
        f"{worst.n_lost:,} outliers lie together, of {worst.n_all:,} points at {where}{more}. They "
        "may be a thing that is sparser than what is around it or has too few points, or one large "
        "error; mark them and look before they are dropped"
    )


def _pairs(values, joined):
    """What is joined of each two cells next to each other, axis by axis: of boxes of eight."""
    for axis in range(3):
        n = values.shape[axis]
        values = joined(np.take(values, range(n - 1), axis), np.take(values, range(1, n), axis))
    return values
