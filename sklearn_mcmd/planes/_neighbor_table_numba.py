"""Packing of ``_neighbor_table``, compiled."""

import numpy as np

from sklearn_mcmd.runtime._kernels import kernel


@kernel(cache=True)
def pack(indices, block, bits, codes, groups, starts, names, places, slots):
    """Fill the codes of neighbors, and the lists of groups that they refer to.

    A group has ``2 ** bits`` rows; a block, which has a list, has `block` rows of the table.
    Places in the list by group are a table with open addresses, `names`, all -1, and `places`.
    It is twice as long as any list, and its length a power of two. `slots` have those in use.
    """
    m, k = indices.shape
    size, n_groups = len(names), 0
    for b in range(len(starts) - 1):
        starts[b] = first = n_groups
        for i in range(b * block, min((b + 1) * block, m)):
            for j in range(k):
                name = np.int64(indices[i, j]) >> bits
                slot = name & (size - 1)  # groups near each other have slots near each other
                while names[slot] != name and names[slot] >= 0:
                    slot = (slot + 1) & (size - 1)
                if names[slot] < 0:
                    names[slot], places[slot] = name, n_groups - first
                    slots[n_groups - first] = slot
                    groups[n_groups] = name
                    n_groups += 1
                codes[i, j] = (np.int64(places[slot]) << bits) + indices[i, j] - (name << bits)
        for i in range(n_groups - first):
            names[slots[i]] = -1
    starts[len(starts) - 1] = n_groups


@kernel(cache=True)
def unpack(codes, groups, starts, block, bits, rows, found):
    """Fill the first neighbors of rows."""
    m, k = found.shape
    last = (1 << bits) - 1
    for i in range(m):
        near, row = codes[rows[i]], found[i]
        names = groups[starts[rows[i] // block] :]
        for j in range(k):
            code = near[j]
            row[j] = (names[np.uintp(code >> bits)] << bits) + (code & last)  # of no sign: a vector
