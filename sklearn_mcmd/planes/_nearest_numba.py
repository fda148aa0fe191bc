"""``SelfSearch`` of ``_nearest``, compiled; three dimensions."""

from typing import NamedTuple

import numpy as np

from sklearn_mcmd.runtime._kernels import kernel

# A candidate is sorted as one number: its squared distance, whose last bits hold its place.
PLACE = np.int64(2**24 - 1)
N_BINS = 64  # of squared distance, of which a query fills most
STACK = 256  # nodes that wait, of which a tree has few at a time


class Near(NamedTuple):
    """A list of candidates, and room to sort those of one query."""

    x: np.ndarray
    y: np.ndarray
    z: np.ndarray
    rows: np.ndarray  # of points
    squares: np.ndarray  # squared distances from the query
    bits: np.ndarray  # the same as integers
    keys: np.ndarray  # squared distances with places in the last bits, of those near enough
    places: np.ndarray  # of those that are nearest, in order
    bins: np.ndarray  # counts
    stack: np.ndarray  # nodes that wait
    radii: np.ndarray  # of the points of a leaf: distances of their last neighbors, inf if unknown
    failed: np.ndarray  # rows of those of them that no list of candidates answers

    @classmethod
    def of(cls, capacity, leaf):
        """Python makes the arrays, since Numba takes long to compile what makes them."""
        numbers = {name: np.empty(capacity) for name in ("x", "y", "z", "squares")}
        rows = {name: np.empty(capacity, np.int64) for name in ("rows", "keys", "places")}
        return cls(
            **numbers,
            **rows,
            bits=numbers["squares"].view(np.int64),
            bins=np.empty(N_BINS + 2, np.int64),
            stack=np.empty(STACK, np.int64),
            radii=np.empty(leaf),
            failed=np.empty(leaf, np.int64),
        )


def build_tree(points, leaf):
    """Halve the points along the longest side of their box until `leaf` of them are left.

    They are put in the order of the leaves. Returns this order and what `Tree` holds.
    """
    n = len(points)
    order = np.arange(n)
    # The left child has a multiple of `leaf`, so all leaves are full but the last.
    leaves = np.empty(-(-n // leaf), np.int64)
    most = 2 * len(leaves) - 1
    first, last, left = (np.empty(most, np.int64) for _ in range(3))
    boxes, stack = np.empty((most, 6)), np.empty(STACK, np.int64)
    _build(points, leaf, order, first, last, left, boxes, leaves, stack)
    return order, points, first, last, left, boxes, leaves


def search_rows(asking, tree, begin, end, first_leaf, sizes, indices):
    """Fill `indices` (end - begin, k) with the neighbors, rows of `tree`, of some points.

    These are the rows from `begin` to `end` of `asking`, which may be the same tree or another.
    `first_leaf` is the place in ``asking.leaves`` of the leaf that holds the first of these rows;
    `sizes` are the largest numbers of points in a leaf and of candidates.
    """
    size, capacity = sizes
    near = Near.of(max(capacity, 2 * indices.shape[1] + 32 + size), size)
    _search(asking, tree, begin, end, first_leaf, near, indices)


@kernel(cache=True)
def _build(points, leaf, order, first, last, left, boxes, leaves, stack):
    """The loop of `build_tree`, which fills the arrays."""
    first[0], last[0], stack[0] = 0, len(points), 0
    n_nodes, n_leaves, n_waiting = 1, 0, 1
    while n_waiting > 0:
        n_waiting -= 1
        node = stack[n_waiting]
        begin, end = first[node], last[node]
        longest, axis = -1.0, np.int64(0)  # with a plain 0, `_partition` is compiled twice
        for x in range(3):
            low = high = points[begin, x]
            for i in range(begin + 1, end):
                low, high = min(low, points[i, x]), max(high, points[i, x])
            boxes[node, x], boxes[node, 3 + x] = low, high
            if high - low > longest:
                longest, axis = high - low, np.int64(x)
        if end - begin <= leaf:
            left[node], leaves[n_leaves] = -1, node
            n_leaves += 1
            continue
        # Near the middle, after as many points as fill leaves.
        middle = begin + ((end - begin) // 2 + leaf // 2) // leaf * leaf
        _partition(points, axis, order, begin, end - 1, middle)
        left[node] = n_nodes
        first[n_nodes], last[n_nodes] = begin, middle
        first[n_nodes + 1], last[n_nodes + 1] = middle, end
        stack[n_waiting], stack[n_waiting + 1] = n_nodes + 1, n_nodes
        n_waiting, n_nodes = n_waiting + 2, n_nodes + 2


@kernel(cache=True)
def _search(asking, tree, begin, end, first_leaf, near, indices):
    """The loop of `search_rows`: k candidates within a guessed bound prove it wide enough."""
    points, k, radii, failed = asking.points, indices.shape[1], near.radii, near.failed
    # The numbers of points in equal balls vary by the root of their mean.
    wider, much_wider = 1.0 + 2.5 / np.sqrt(k), 1.0 + 5.0 / np.sqrt(k)
    reach = guess = 0.0
    answered, radius = begin, np.inf
    for place in range(first_leaf, len(asking.leaves)):
        leaf = asking.leaves[place]
        first, last = max(asking.first[leaf], begin), min(asking.last[leaf], end)
        if first >= end:
            break
        n, n_failed, widest = _collect(tree, asking.boxes, leaf, reach, near), 0, 0.0
        for i in range(first, last):
            n_within = 0
            if n >= k:
                _measure(near, n, points[i, 0], points[i, 1], points[i, 2])
                bound = min(guess, reach)
                n_within = _screen(near, n, bound)
                while n_within < k and bound < reach:
                    bound = min(2.0 * bound, reach) if bound > 0.0 else reach
                    n_within = _screen(near, n, bound)
            radii[i - first] = np.inf
            # Many that are equally far, as on a sphere, would make sorting quadratic.
            if n_within < k or n_within > 8 * k + 256:
                failed[n_failed] = i
                n_failed += 1
                continue
            square = _sort(tree.points, near, n_within, bound, k, indices[i - begin])
            answered, radius = i, np.sqrt(square)
            radii[i - first] = radius
            guess = wider * square
            if widest == 0.0 and much_wider * square < reach:
                reach = much_wider * square
                n = _filter(asking.boxes, leaf, reach, near, n)
            widest = max(widest, square)
        # Isolated points are bounded by the answered ones near them.
        for a in range(n_failed):
            i = failed[a]
            bound = radius + _distance(points[answered], points[i])
            for j in range(first, last):
                if j != i:
                    bound = min(bound, radii[j - first] + _distance(points[j], points[i]))
            x, y, z = points[i, 0], points[i, 1], points[i, 2]
            # What rounding can't have made too small, nor underflow.
            bound = (bound * (1.0 + 1e-14)) ** 2 + 1e-300
            square = _search_one(tree, x, y, z, k, bound, near, indices[i - begin])
            radii[i - first] = np.sqrt(square)
            if widest == 0.0:
                answered, radius = i, radii[i - first]
                reach = guess = square
        if widest > 0.0:
            reach = 1.2 * widest
        reach = max(reach, guess)


@kernel
def _search_one(tree, x, y, z, k, bound, near, neighbors):
    """Neighbors of one location from the nearest boxes on; the square of the k-th distance.

    The square is at most `bound`. Of many candidates all but the k nearest go.
    """
    # With a plain 0, `_screen` and `_sort` are compiled twice.
    points, stack, n, n_waiting = tree.points, near.stack, np.int64(0), 1
    many = 2 * k + 32  # that are worth sorting; half or twice as many cost the same
    stack[0] = 0
    while True:
        while n_waiting > 0 and n < many:
            n_waiting -= 1
            node = stack[n_waiting]
            if _square_to_box(tree.boxes, node, x, y, z) > bound:
                continue
            child = tree.left[node]
            if child >= 0:
                far = _square_to_box(tree.boxes, child, x, y, z) <= _square_to_box(
                    tree.boxes, child + 1, x, y, z
                )
                stack[n_waiting] = child + far  # the nearer one comes last, and is taken first
                stack[n_waiting + 1] = child + 1 - far
                n_waiting += 2
                continue
            for i in range(tree.first[node], tree.last[node]):
                dx, dy, dz = points[i, 0] - x, points[i, 1] - y, points[i, 2] - z
                square = dx * dx + dy * dy + dz * dz
                near.squares[n], near.rows[n] = square, i
                n += square <= bound
        if n >= k:
            widest = 0.0
            for a in range(n):
                widest = max(widest, near.squares[a])
            _screen(near, n, widest)
            bound = _sort(points, near, n, widest, k, neighbors)
            for a in range(k):
                near.z[a] = near.squares[near.places[a]]
            for a in range(k):
                near.squares[a], near.rows[a] = near.z[a], neighbors[a]
            n = k
        if n_waiting == 0:
            return bound


@kernel
def _collect(tree, around, leaf, reach, near):
    """How many points are within a squared reach of a leaf of queries; -1 if too many to hold."""
    boxes, points, stack = tree.boxes, tree.points, near.stack
    low_x, low_y, low_z = around[leaf, 0], around[leaf, 1], around[leaf, 2]
    high_x, high_y, high_z = around[leaf, 3], around[leaf, 4], around[leaf, 5]
    n, n_waiting = 0, 1
    stack[0] = 0
    while n_waiting > 0:
        n_waiting -= 1
        node = stack[n_waiting]
        dx = max(boxes[node, 0] - high_x, low_x - boxes[node, 3], 0.0)
        dy = max(boxes[node, 1] - high_y, low_y - boxes[node, 4], 0.0)
        dz = max(boxes[node, 2] - high_z, low_z - boxes[node, 5], 0.0)
        if dx * dx + dy * dy + dz * dz > reach:
            continue
        if tree.left[node] >= 0:
            stack[n_waiting], stack[n_waiting + 1] = tree.left[node] + 1, tree.left[node]
            n_waiting += 2
            continue
        first, last = tree.first[node], tree.last[node]
        if n + last - first > len(near.rows):
            return -1
        for i in range(first, last):
            x, y, z = points[i, 0], points[i, 1], points[i, 2]
            dx = max(low_x - x, x - high_x, 0.0)
            dy = max(low_y - y, y - high_y, 0.0)
            dz = max(low_z - z, z - high_z, 0.0)
            near.x[n], near.y[n], near.z[n], near.rows[n] = x, y, z, i
            n += dx * dx + dy * dy + dz * dz <= reach
    return n


@kernel
def _filter(around, leaf, reach, near, n):
    """Keep those of n candidates that are within a smaller reach."""
    n_kept = 0
    for i in range(n):
        x, y, z = near.x[i], near.y[i], near.z[i]
        near.x[n_kept], near.y[n_kept], near.z[n_kept] = x, y, z
        near.rows[n_kept] = near.rows[i]
        n_kept += _square_to_box(around, leaf, x, y, z) <= reach
    return n_kept


@kernel
def _measure(near, n, x, y, z):
    """Squared distances from a query to n candidates."""
    xs, ys, zs, squares = near.x, near.y, near.z, near.squares
    for i in range(n):
        dx, dy, dz = xs[i] - x, ys[i] - y, zs[i] - z
        squares[i] = dx * dx + dy * dy + dz * dz


@kernel
def _screen(near, n, bound):
    """Keys of the candidates not farther than a bound, squared, and how many these are."""
    squares, bits, keys = near.squares, near.bits, near.keys
    n_within = 0
    for i in range(n):  # without a branch, which would be mispredicted half of the time
        keys[n_within] = (bits[i] & ~PLACE) | i
        n_within += squares[i] <= bound
    return n_within


@kernel
def _sort(points, near, n, bound, k, neighbors):
    """Fill `neighbors` with the k nearest of n rows; return the square of the k-th distance.

    By counting in bins of squared distance, of which a surface has about equal numbers in each;
    then by insertion, as far as the bin of the last that is wanted: of keys first, and of the
    few whose keys are equal.
    """
    squares, rows, places, bins = near.squares, near.rows, near.places, near.bins
    keys, scale = near.keys, N_BINS / bound if bound > 0.0 else 0.0
    bins[:] = 0
    for a in range(n):
        bins[_bin(squares[keys[a] & PLACE], scale) + 1] += 1
    last = n_wanted = 0
    while n_wanted < k:
        last += 1
        n_wanted += bins[last]
        bins[last] = n_wanted
    for a in range(n):
        b = _bin(squares[keys[a] & PLACE], scale)
        if b < last:
            places[bins[b]] = keys[a]
            bins[b] += 1
    for a in range(1, n_wanted):
        key, b = places[a], a
        while b > 0 and places[b - 1] > key:
            places[b] = places[b - 1]
            b -= 1
        places[b] = key
    for a in range(n_wanted):
        place, b = places[a] & PLACE, a
        square, row = squares[place], rows[place]
        while b > 0 and square <= squares[places[b - 1]]:
            if _before(points, squares[places[b - 1]], rows[places[b - 1]], square, row):
                break
            places[b] = places[b - 1]
            b -= 1
        places[b] = place
    for a in range(k):
        neighbors[a] = rows[places[a]]
    return squares[places[k - 1]]


@kernel
def _bin(square, scale):
    position = square * scale  # not a number, if squares overflow
    return np.int64(position) if position < N_BINS else N_BINS


@kernel
def _before(points, square, row, other_square, other_row):
    """Whether one neighbor comes before another: by distance, then by coordinates."""
    if square != other_square:
        return square < other_square
    for x in range(3):
        if points[row, x] != points[other_row, x]:
            return points[row, x] < points[other_row, x]
    return row < other_row


@kernel
def _partition(points, axis, order, low, high, wanted):
    """Let the point at `wanted` be the one that sorting would put there, smaller ones before it."""
    while low < high:
        first, middle, last = points[low, axis], points[(low + high) // 2, axis], points[high, axis]
        pivot = max(min(first, last), min(max(first, last), middle))
        i, j = low, high
        while i <= j:
            while points[i, axis] < pivot:
                i += 1
            while points[j, axis] > pivot:
                j -= 1
            if i <= j:
                for x in range(3):
                    points[i, x], points[j, x] = points[j, x], points[i, x]
                order[i], order[j] = order[j], order[i]
                i += 1
                j -= 1
        if wanted <= j:
            high = j
        elif wanted >= i:
            low = i
        else:
            return


@kernel
def _square_to_box(boxes, node, x, y, z):
    dx = max(boxes[node, 0] - x, x - boxes[node, 3], 0.0)
    dy = max(boxes[node, 1] - y, y - boxes[node, 4], 0.0)
    dz = max(boxes[node, 2] - z, z - boxes[node, 5], 0.0)
    return dx * dx + dy * dy + dz * dz


@kernel
def _distance(first, second):
    dx, dy, dz = first[0] - second[0], first[1] - second[1], first[2] - second[2]
    return np.sqrt(dx * dx + dy * dy + dz * dz)
