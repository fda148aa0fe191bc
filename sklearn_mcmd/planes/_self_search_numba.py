"""``SelfSearch`` of ``_self_search``, compiled; three dimensions."""

import numpy as np

from sklearn_mcmd.planes._kernels import kernel

__all__ = ["build_tree", "search_rows"]


@kernel(cache=True)
def build_tree(X, leaf):
    """Halve the points along the longest side of their box until `leaf` of them are left.

    Returns the order of the rows of X and, for each node, what `Tree` holds.
    """
    n = len(X)
    order, keys = np.arange(n), np.empty(n)
    most = 4 * (n // leaf + 1)
    first, last, left = np.empty(most, np.int64), np.empty(most, np.int64), np.empty(most, np.int64)
    low, high = np.empty((most, 3)), np.empty((most, 3))
    first[0], last[0] = 0, n
    node, n_nodes = 0, 1
    while node < n_nodes:
        begin, end = first[node], last[node]
        left[node] = -1
        longest, axis = -1.0, 0
        for x in range(3):
            low[node, x] = high[node, x] = X[order[begin], x]
            for i in range(begin + 1, end):
                low[node, x] = min(low[node, x], X[order[i], x])
                high[node, x] = max(high[node, x], X[order[i], x])
            if high[node, x] - low[node, x] > longest:
                longest, axis = high[node, x] - low[node, x], x
        if end - begin > leaf:
            # Near the middle, after as many points as fill leaves.
            middle = begin + max(leaf, ((end - begin) // 2 + leaf // 2) // leaf * leaf)
            for i in range(begin, end):
                keys[i] = X[order[i], axis]
            _partition(keys, order, begin, end - 1, middle)
            left[node] = n_nodes
            first[n_nodes], last[n_nodes] = begin, middle
            first[n_nodes + 1], last[n_nodes + 1] = middle, end
            n_nodes += 2
        node += 1
    return (
        order,
        first[:n_nodes].copy(),
        last[:n_nodes].copy(),
        left[:n_nodes].copy(),
        low[:n_nodes].copy(),
        high[:n_nodes].copy(),
    )


@kernel(cache=True)
def search_rows(tree, begin, end, capacity, indices):
    """Fill `indices` (end - begin, k) with the neighbors of the rows from `begin` to `end`."""
    points, k = tree.points, indices.shape[1]
    nearest, rows, stack = np.empty(k), np.empty(k, np.int64), np.empty(256, np.int64)
    capacity = max(capacity, k)
    columns = np.empty((3, capacity))
    candidates = np.empty(capacity, np.int64)
    squares, within = np.empty(capacity), np.empty(capacity, np.int64)
    ordered, found = np.empty(capacity), np.empty(capacity, np.int64)
    bins = np.empty(66, np.int64)
    radius = np.empty(tree.last[tree.leaves[0]] - tree.first[tree.leaves[0]] + 64)
    center, before = np.empty(3), np.empty(3)
    center_radius = np.inf
    for leaf in tree.leaves[np.searchsorted(tree.last[tree.leaves], begin, side="right") :]:
        first, last = tree.first[leaf], tree.last[leaf]
        if first >= end:
            break
        before[:] = center
        for x in range(3):
            center[x] = 0.5 * (tree.low[leaf, x] + tree.high[leaf, x])
        bound = np.inf
        if center_radius < np.inf:
            bound = _wider(center_radius + _distance(center, before))
        center_radius = np.sqrt(_find(tree, center, k, bound * bound, nearest, rows, stack))
        far = 0.0
        for i in range(first, last):
            far = max(far, _distance(points[i], center))
        n_candidates = -1
        # A leaf of isolated points would reach over half of the cloud.
        if far <= 2.0 * center_radius:
            reach = _wider(center_radius + far)
            n_candidates = _collect(tree, leaf, reach * reach, columns, candidates, stack)
        for i in range(max(first, begin), min(last, end)):
            bound = center_radius + _distance(points[i], center)
            for j in range(max(first, begin), i):
                bound = min(bound, radius[j - first] + _distance(points[i], points[j]))
            bound = _wider(bound)
            n_within = k
            if n_candidates >= 0:
                n_within = _screen(
                    columns, candidates, n_candidates, points[i], bound * bound, squares, within
                )
            # Many that are equally far, as on a sphere, would make the sorting below quadratic.
            if n_candidates < 0 or n_within > 8 * k + 256:
                square = _find(tree, points[i], k, bound * bound, nearest, rows, stack)
                n_within = k
                squares[:k], within[:k] = nearest, rows
                bound = np.sqrt(square)
            _sort(points, squares, within, n_within, bound * bound, k, ordered, found, bins)
            for a in range(k):
                indices[i - begin, a] = found[a]
            radius[i - first] = np.sqrt(ordered[k - 1])


@kernel(cache=True)
def _find(tree, query, k, bound, nearest, rows, stack):
    """Square of the k-th distance, known to be at most `bound`, and who are nearest, in a heap."""
    points, size, n_waiting = tree.points, 0, 1
    stack[0] = 0
    while n_waiting > 0:
        n_waiting -= 1
        node = stack[n_waiting]
        if _square_to_box(tree, node, query) > bound:
            continue
        child = tree.left[node]
        if child >= 0:
            nearer = _square_to_box(tree, child, query) <= _square_to_box(tree, child + 1, query)
            stack[n_waiting] = child + nearer  # the nearer one comes last, and is taken first
            stack[n_waiting + 1] = child + 1 - nearer
            n_waiting += 2
            continue
        for i in range(tree.first[node], tree.last[node]):
            square = _square(points[i], query)
            if square > bound:
                continue
            if size < k:  # a leaf of the heap, which rises
                a = size
                size += 1
                while a > 0:
                    b = (a - 1) // 2
                    if not _before(points, nearest[b], rows[b], square, i):
                        break
                    nearest[a], rows[a] = nearest[b], rows[b]
                    a = b
            elif _before(points, square, i, nearest[0], rows[0]):  # its top, which sinks
                a, b = 0, 1
                while b < k:
                    c = min(b + 1, k - 1)
                    if _before(points, nearest[b], rows[b], nearest[c], rows[c]):
                        b = c
                    if not _before(points, square, i, nearest[b], rows[b]):
                        break
                    nearest[a], rows[a] = nearest[b], rows[b]
                    a, b = b, 2 * b + 1
            else:
                continue
            nearest[a], rows[a] = square, i
            if size == k:
                bound = min(bound, nearest[0])
    return bound


@kernel(cache=True)
def _collect(tree, leaf, reach, columns, candidates, stack):
    """How many points are within a reach, squared, of a leaf's box; -1 if too many to hold."""
    n_found, n_waiting = 0, 1
    stack[0] = 0
    while n_waiting > 0:
        n_waiting -= 1
        node = stack[n_waiting]
        square = 0.0
        for x in range(3):
            gap = max(
                tree.low[node, x] - tree.high[leaf, x], tree.low[leaf, x] - tree.high[node, x], 0.0
            )
            square += gap * gap
        if square > reach:
            continue
        if tree.left[node] >= 0:
            stack[n_waiting], stack[n_waiting + 1] = tree.left[node] + 1, tree.left[node]
            n_waiting += 2
            continue
        first, last = tree.first[node], tree.last[node]
        if n_found + last - first > len(candidates):
            return -1
        for i in range(first, last):
            for x in range(3):
                columns[x, n_found] = tree.points[i, x]
            candidates[n_found] = i
            n_found += _square_to_box(tree, leaf, tree.points[i]) <= reach
    return n_found


@kernel(cache=True)
def _screen(columns, candidates, n, query, bound, squares, within):
    """Candidates not farther than a bound, squared, and how many these are."""
    x, y, z = query
    xs, ys, zs = columns[0], columns[1], columns[2]
    for i in range(n):
        dx, dy, dz = xs[i] - x, ys[i] - y, zs[i] - z
        squares[i] = dx * dx + dy * dy + dz * dz
    n_within = 0
    for i in range(n):  # without a branch, which would be mispredicted half of the time
        square = squares[i]
        squares[n_within], within[n_within] = square, candidates[i]
        n_within += square <= bound
    return n_within


@kernel(cache=True)
def _sort(points, squares, rows, n, bound, k, ordered, found, bins):
    """Fill `found` with the k nearest of n rows, and `ordered` with their squared distances.

    By counting in bins of squared distance, of which a surface has about equal numbers in each;
    then by insertion, as far as the bin of the last that is wanted.
    """
    n_bins = len(bins) - 2
    scale = n_bins / bound if bound > 0.0 else 0.0
    bins[:] = 0
    for a in range(n):
        bins[min(int(squares[a] * scale), n_bins) + 1] += 1
    last = 0
    while bins[last] < k:
        last += 1
        bins[last] += bins[last - 1]
    n_wanted = bins[last]
    for a in range(n):
        b = min(int(squares[a] * scale), n_bins)
        if b < last:
            ordered[bins[b]], found[bins[b]] = squares[a], rows[a]
            bins[b] += 1
    for a in range(1, n_wanted):
        square, row, b = ordered[a], found[a], a
        while b > 0 and not _before(points, ordered[b - 1], found[b - 1], square, row):
            ordered[b], found[b] = ordered[b - 1], found[b - 1]
            b -= 1
        ordered[b], found[b] = square, row


@kernel(cache=True)
def _before(points, square, row, other_square, other_row):
    """Whether one neighbor comes before another: by distance, then by coordinates."""
    if square != other_square:
        return square < other_square
    for x in range(3):
        if points[row, x] != points[other_row, x]:
            return points[row, x] < points[other_row, x]
    return row < other_row


@kernel(cache=True)
def _partition(keys, order, low, high, wanted):
    """Let the key at `wanted` be the one that sorting would put there, smaller ones before it."""
    while low < high:
        middle = (low + high) // 2
        pivot = max(min(keys[low], keys[high]), min(max(keys[low], keys[high]), keys[middle]))
        i, j = low, high
        while i <= j:
            while keys[i] < pivot:
                i += 1
            while keys[j] > pivot:
                j -= 1
            if i <= j:
                keys[i], keys[j] = keys[j], keys[i]
                order[i], order[j] = order[j], order[i]
                i += 1
                j -= 1
        if wanted <= j:
            high = j
        elif wanted >= i:
            low = i
        else:
            return


@kernel(cache=True)
def _square_to_box(tree, node, query):
    square = 0.0
    for x in range(3):
        gap = max(tree.low[node, x] - query[x], query[x] - tree.high[node, x], 0.0)
        square += gap * gap
    return square


@kernel(cache=True)
def _square(one, other):
    dx, dy, dz = one[0] - other[0], one[1] - other[1], one[2] - other[2]
    return dx * dx + dy * dy + dz * dz


@kernel(cache=True)
def _distance(one, other):
    return np.sqrt(_square(one, other))


@kernel(cache=True)
def _wider(distance):
    """A bound that rounding of the sums and roots before it can't make too small."""
    return distance * (1.0 + 1e-14)
