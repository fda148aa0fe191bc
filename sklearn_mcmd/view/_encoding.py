"""Points as blocks of compressed bytes that a browser unpacks.

Coordinates are whole steps from the low corner of all clouds. The points are shuffled and divided
into chunks of growing size, so that each chunk is a thinned cloud. Within a chunk they are sorted
by their rows: scanners write neighbors one after the other. Each column is written as differences
of neighbors, byte by byte.
"""

import zlib
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

FIRST_CHUNK, LARGEST_CHUNK = 1 << 16, 1 << 20  # points
SPACING_SAMPLE = 20_000  # points whose spacing is measured
# The error of a coordinate is half a step: at most a sixteenth of the spacing of the points.
COARSEST, FINEST = 1 / 8, 1 / 256  # steps, in spacings
MOST_STEPS = 2.0**31 - 1  # so that differences of steps fit 32 bits with a sign
# Five characters hold four bytes; base64 is 7 % longer. None of them means anything in HTML.
DIGITS = "0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz!#$%()*+,-./:;=?@[]^_`{"


class Grid(NamedTuple):
    """The low corner of all points, the step of coordinates, and what they are derived from."""

    low: np.ndarray
    step: float
    error: float
    spacing: float
    reach: float  # how large a point must be drawn for surfaces to look closed

    @classmethod
    def of(cls, clouds):
        """The grid of clouds (n, 3): the step of the file if it is one, else by the spacing."""
        low = np.min([xyz.min(axis=0) for xyz in clouds], axis=0)
        high = np.max([xyz.max(axis=0) for xyz in clouds], axis=0)
        extent = float((high - low).max())
        if extent == 0.0:
            return cls(low=low, step=1.0, error=0.0, spacing=1.0, reach=1.0)
        gaps = [gap for gap in map(typical_spacing, clouds) if gap[0] > 0]
        spacing, reach = np.min(gaps or [(extent, extent)], axis=0).tolist()
        least = extent / MOST_STEPS
        step = _decimal_step(clouds, low, max(FINEST * spacing, least), extent)
        error = 0.0  # numbers near the same decimal differ by rounding
        if step is None:
            step = max(min(extent / 65535, COARSEST * spacing), FINEST * spacing, least)
            error = step / 2
        return cls(low=low, step=step, error=error, spacing=spacing, reach=reach)

    def encode(self, xyz):
        """Steps (n, 3) of points."""
        return np.rint((xyz - self.low) / self.step).astype(np.uint32)

    def decode(self, steps):
        return self.low + self.step * np.asarray(steps, dtype=np.float64)


def typical_spacing(xyz):
    """Median distances to the nearest other place and to the fourth; 0 if there is one place.

    In a grid both are equal, among points at random the fourth is twice as far.
    """
    every = max(1, len(xyz) // SPACING_SAMPLE)
    tree = cKDTree(xyz, balanced_tree=False)
    distance, _ = tree.query(xyz[::every], k=range(2, 6))
    distance[~np.isfinite(distance)] = 0.0  # fewer points than that
    apart = distance[:, -1][distance[:, -1] > 0]
    fourth = float(np.median(apart)) if apart.size else float(np.ptp(xyz, axis=0).max())
    nearest = np.where(distance > 0, distance, np.inf).min(axis=1)
    nearest = nearest[np.isfinite(nearest)]
    return (float(np.median(nearest)) if nearest.size else fourth, fourth)


def shuffled(n_points, most):
    """Rows in random order, at most `most` of them."""
    return np.random.default_rng(0).permutation(n_points)[:most]


def pack_points(steps, rows, columns, blocks):
    """Pack the points of a cloud, in random order: add blocks of text, and return chunks."""
    bounds = _chunk_bounds(len(rows))
    chunks = []
    for start, stop in pairwise(bounds):
        order = start + np.argsort(rows[start:stop])
        described = []
        for values in (
            *steps[order].T,
            rows[order].astype(np.uint32),
            *(c[order] for c in columns),
        ):
            width, delta, packed = pack_column(values)
            described.append([width, int(delta), len(blocks), len(packed)])
            blocks.append(_text(packed))
        chunks.append({"n": stop - start, "columns": described})
    return chunks


def pack_column(values):
    """Bytes of unsigned whole numbers: how many each has, whether they are differences, and all.

    Differences are signed, wrap around, and are written as 0, -1, 1, -2 ... The lowest bytes of
    all numbers come first, then the next ones.
    """
    width = max(1, (int(values.max()).bit_length() + 7) // 8)
    plain = _planes(values, width)
    steps = _planes(_differences(values, width), width)
    sizes = (len(zlib.compress(planes[:, : 1 << 16].tobytes(), 1)) for planes in (plain, steps))
    delta = next(sizes) > next(sizes)
    return width, delta, zlib.compress((steps if delta else plain).tobytes(), 6)


def _text(data):
    """Bytes in base 85, filled up with zeros."""
    words = np.frombuffer(data + bytes(-len(data) % 4), dtype="<u4")
    # 85^5 is just above 2^32, so five digits hold a word.
    digits = np.empty((len(words), 5), dtype=np.uint8)
    for place in range(4, -1, -1):
        words, digits[:, place] = np.divmod(words, np.uint32(85))
    return np.frombuffer(DIGITS.encode(), dtype=np.uint8)[digits].tobytes().decode("ascii")


def _differences(values, width):
    """Differences modulo 256 ** width as 0, -1, 1, -2 ..."""
    half = 1 << (8 * width - 1)
    # Small changes of either sign become small numbers, whose high bytes are 0 and compress well.
    change = np.diff(values.astype(np.int64), prepend=0)
    change = (change + half) % (2 * half) - half
    return np.where(change >= 0, 2 * change, -2 * change - 1)


def _planes(values, width):
    """Bytes (width, n), the lowest first."""
    little = np.ascontiguousarray(values.astype("<u4"))
    return np.ascontiguousarray(little.view(np.uint8).reshape(-1, 4)[:, :width].T)


def _chunk_bounds(n_points):
    """0, the end of the first chunk, of the second ... Chunks double up to a limit."""
    bounds, size = [0], FIRST_CHUNK
    while bounds[-1] < n_points:
        bounds.append(min(bounds[-1] + size, n_points))
        size = min(2 * size, LARGEST_CHUNK)
    return bounds


def _decimal_step(clouds, low, finest, extent):
    """The coarsest power of ten from `finest` on that all coordinates are multiples of, or None."""
    exponent = int(np.floor(np.log10(max(extent, finest))))
    while 10.0**exponent >= finest:
        if all(_on_lattice(xyz, low, 10.0**exponent) for xyz in clouds):
            return 10.0**exponent
        exponent -= 1
    return None


def _on_lattice(xyz, low, step):
    for part in (slice(0, 1000), slice(None)):  # most clouds fail at once
        steps = (xyz[part] - low) / step
        # Float64 coordinates of a national grid differ from decimals by a billionth of a meter.
        rounding = 4 * np.spacing(np.abs(xyz[part]).max()) / step
        if not (np.abs(steps - np.rint(steps)) <= max(rounding, 1e-9)).all() or rounding > 0.1:
            return False
    return True
