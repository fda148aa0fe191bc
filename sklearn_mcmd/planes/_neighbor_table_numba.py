"""Packing of ``_neighbor_table``, compiled."""

import numpy as np

from sklearn_mcmd.runtime._kernels import kernel


@kernel(cache=True)
def pack(near, bits, codes, groups, starts, far, slots, names):
    """Fill the codes of neighbors (m, k), the groups of each block, and what is far.

    `slots` are those of a table of groups, -1, twice as long as a block has neighbors and a power
    of two; `names` (3, any) are its groups, how often each occurs, and their places in the table.
    Returns how many neighbors are far.
    """
    # Codes are a group in the higher bits, and the place in it in the lower ones.
    (m, k), size, block = near.shape, len(slots), 1 << bits
    n_far, last = 0, (1 << bits) - 1
    for b in range(len(groups)):
        starts[b], n = n_far, 0
        rows = range(b * block, min((b + 1) * block, m))
        # Step 1: count the groups of this block's neighbors, in a hash table.
        for i in rows:
            for j in range(k):
                name = np.int64(near[i, j]) >> bits
                slot = name & (size - 1)
                while slots[slot] >= 0 and names[0, slots[slot]] != name:
                    slot = (slot + 1) & (size - 1)
                if slots[slot] < 0:
                    slots[slot], names[0, n], names[1, n], names[2, n] = n, name, 0, slot
                    n += 1
                names[1, slots[slot]] += 1
        # Step 2: those that occur most often are listed. Their count becomes minus their place.
        for place in range(min(last, n)):
            best = 0
            for i in range(1, n):
                if names[1, i] > names[1, best]:
                    best = i
            groups[b, place] = names[0, best]
            names[1, best] = min(names[1, best], -1 - place)
        # Step 3: codes of all neighbors; what is in no listed group is far.
        for i in rows:
            for j in range(k):
                name = np.int64(near[i, j]) >> bits
                slot = name & (size - 1)
                while names[0, slots[slot]] != name:
                    slot = (slot + 1) & (size - 1)
                place = -1 - names[1, slots[slot]]
                if place < 0:
                    place, far[n_far] = last, near[i, j]
                    n_far += 1
                codes[i, j] = (place << bits) + (near[i, j] & last)
        for i in range(n):
            slots[names[2, i]] = -1
    return n_far


@kernel(cache=True)
def unpack(codes, bits, groups, starts, far, rows, neighbors):
    """Fill the first neighbors of rows, which is fastest if these ascend."""
    (m, k), width, last = neighbors.shape, codes.shape[1], (1 << bits) - 1
    f, counted = 0, -1  # where the far ones start, of which row
    for i in range(m):
        row, block = neighbors[i], rows[i] >> bits
        near, names = codes[rows[i]], groups[block]
        if counted >> bits != block or counted > rows[i]:
            f, counted = starts[block], block << bits
        for before in range(counted, rows[i]):
            for j in range(width):
                f += codes[before, j] >> bits == last
        for j in range(k):
            code = np.int64(near[j])
            if code >> bits < last:
                row[j] = (names[code >> bits] << bits) + (code & last)
            else:
                row[j] = far[f]
                f += 1
        for j in range(k, width):
            f += near[j] >> bits == last
        counted = rows[i] + 1
