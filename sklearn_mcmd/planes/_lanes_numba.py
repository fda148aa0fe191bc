"""The inner loops of the screening, over lanes: the columns of C-contiguous arrays.

The compiler makes vectors of each loop over lanes, and enters it by comparing the addresses of all
arrays. Several rows at once share these comparisons. So the number of rows is even, that of levels
a multiple of `ROWS`, and rows that pad change no result.
"""

import numpy as np

from sklearn_mcmd.planes._moments_numba import FASTMATH
from sklearn_mcmd.runtime._kernels import kernel

__all__ = [
    "FEATURES",
    "MOST_LEVEL",
    "ROWS",
    "SHIFT",
    "lane_distances",
    "lane_levels",
    "lane_limits",
    "lane_moments",
]

ROWS = 8
FEATURES = 9  # x, y, z, xx, xy, xz, yy, yz, zz
# A level is a float32 number without its last bits: 512 levels to each power of two.
SHIFT, STEPS = 14, 13
MOST_LEVEL = 2**STEPS - 1
F0, F1, I0 = np.float32(0), np.float32(1), np.int16(0)


@kernel(fastmath=FASTMATH)
def lane_distances(planes, features, n_rows, distances, total):
    """Absolute distances (rows, lanes) of members from planes (4, lanes), and their sums."""
    nx, ny, nz, offset = planes[0], planes[1], planes[2], planes[3]
    total[:] = F0
    for j in range(0, n_rows, 2):
        x0, y0, z0 = features[j, 0], features[j, 1], features[j, 2]
        x1, y1, z1 = features[j + 1, 0], features[j + 1, 1], features[j + 1, 2]
        row0, row1 = distances[j], distances[j + 1]
        for t in range(len(total)):
            a, b, c, d = nx[t], ny[t], nz[t], offset[t]
            value0 = abs(a * x0 + b * y0 + c * z0 + d)
            value1 = abs(a * x1 + b * y1 + c * z1 + d)
            row0[t], row1[t] = value0, value1
            total[t] += value0 + value1


@kernel
def lane_levels(bits, base, n_rows, levels):
    """Levels int16 (rows, lanes): bits without the last, less a base, within 0 and MOST_LEVEL."""
    for j in range(n_rows):
        row, out = bits[j], levels[j]
        for t in range(len(base)):
            value = max(np.int32((row[t] >> SHIFT) - base[t]), np.int32(0))
            out[t] = np.int16(min(value, np.int32(MOST_LEVEL)))


@kernel
def lane_limits(levels, n_rows, wanted, counts, limits):
    """The largest level, of each lane, that no more than `wanted` rows are below, by bisection."""
    limits[:] = I0
    most = np.int16(wanted)
    for power in range(STEPS - 1, -1, -1):
        step = np.int16(1 << power)
        counts[:] = I0
        for j in range(0, n_rows, ROWS):
            row0, row1, row2, row3 = levels[j], levels[j + 1], levels[j + 2], levels[j + 3]
            row4, row5, row6, row7 = levels[j + 4], levels[j + 5], levels[j + 6], levels[j + 7]
            for t in range(len(limits)):
                guess = np.int16(limits[t] + step)
                below = np.int16(row0[t] < guess) + np.int16(row1[t] < guess)
                below += np.int16(row2[t] < guess) + np.int16(row3[t] < guess)
                below += np.int16(row4[t] < guess) + np.int16(row5[t] < guess)
                below += np.int16(row6[t] < guess) + np.int16(row7[t] < guess)
                counts[t] = np.int16(counts[t] + below)
        for t in range(len(limits)):
            guess = np.int16(limits[t] + step)
            limits[t] = guess if counts[t] <= most else limits[t]


@kernel(fastmath=FASTMATH)
def lane_moments(distances, limits, features, n_rows, moments):
    """Number of rows nearer than each lane's limit, and sums of their features, (10, lanes)."""
    s, sx, sy, sz, sxx, sxy, sxz, syy, syz, szz = (
        moments[0], moments[1], moments[2], moments[3], moments[4],
        moments[5], moments[6], moments[7], moments[8], moments[9],
    )  # fmt: skip
    moments[:] = F0
    for j in range(0, n_rows, 2):
        row0, row1 = distances[j], distances[j + 1]
        x0, y0, z0 = features[j, 0], features[j, 1], features[j, 2]
        xx0, xy0, xz0 = features[j, 3], features[j, 4], features[j, 5]
        yy0, yz0, zz0 = features[j, 6], features[j, 7], features[j, 8]
        x1, y1, z1 = features[j + 1, 0], features[j + 1, 1], features[j + 1, 2]
        xx1, xy1, xz1 = features[j + 1, 3], features[j + 1, 4], features[j + 1, 5]
        yy1, yz1, zz1 = features[j + 1, 6], features[j + 1, 7], features[j + 1, 8]
        for t in range(len(limits)):
            member0 = F1 if row0[t] < limits[t] else F0
            member1 = F1 if row1[t] < limits[t] else F0
            s[t] += member0 + member1
            sx[t] += member0 * x0 + member1 * x1
            sy[t] += member0 * y0 + member1 * y1
            sz[t] += member0 * z0 + member1 * z1
            sxx[t] += member0 * xx0 + member1 * xx1
            sxy[t] += member0 * xy0 + member1 * xy1
            sxz[t] += member0 * xz0 + member1 * xz1
            syy[t] += member0 * yy0 + member1 * yy1
            syz[t] += member0 * yz0 + member1 * yz1
            szz[t] += member0 * zz0 + member1 * zz1
