"""Cells and patches, against literal forms."""

from itertools import permutations

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from sklearn_mcmd.planes._neighborhoods import NeighborIndex
from sklearn_mcmd.segmentation._region_cells import (
    Cells,
    Sums,
    flattest_first,
    gathered,
    joined,
    once,
)


def test_groups_are_gathered_in_order():
    """A group begins at each node in order that no group has, of those in its list that have its
    label and no group."""
    rng = np.random.default_rng(0)
    for _ in range(10):
        labels = rng.integers(-1, 2, 200).astype(np.int32)
        near = rng.integers(0, 200, (200, 7)).astype(np.int32)
        order = rng.permutation(np.flatnonzero(labels >= 0))
        expected, begins = np.full(200, -1), []
        for i in order:
            if expected[i] < 0:
                expected[i] = len(begins)
                free = [j for j in near[i] if expected[j] < 0 and labels[j] == labels[i]]
                expected[free] = len(begins)
                begins.append(i)
        found = gathered(order, 7 * np.arange(201), near.ravel(), labels)
        assert_array_equal(found[0], expected)
        assert_array_equal(found[1], begins)


def test_cells_know_their_points_and_what_is_beside_them():
    rng = np.random.default_rng(0)
    index = NeighborIndex(rng.uniform(size=(400, 3)), 20)
    labels = rng.integers(-1, 2, 400).astype(np.int32)
    order = rng.permutation(np.flatnonzero(labels >= 0))
    cells, near = Cells.gathered(labels, order, index, 8), index.query_own(slice(None), 8).indices
    for cell, begin in enumerate(cells.begins):
        rows, sizes = cells.members(np.array([cell]))
        assert_array_equal(np.sort(rows), np.flatnonzero(cells.of == cell))
        assert sizes == [len(rows)]
        assert set(rows) <= set(near[begin])
        assert rows[0] == begin
        assert (labels[rows] == labels[begin]).all()
    beside = {
        pair
        for i, j in zip(np.repeat(range(400), 8), near.ravel(), strict=True)
        if labels[i] == labels[j] >= 0 and cells.of[i] != cells.of[j]
        for pair in permutations([cells.of[i], cells.of[j]])
    }
    assert sorted(beside) == list(map(tuple, cells.beside.tolist()))


def join_by_numpy(points, edges):
    """Patches of cells (m, k, 3) in units of noise: the frozen set of cells of each."""

    def rest(cells):
        some = points[sorted(cells)].reshape(-1, 3)
        return np.linalg.eigvalsh((some - some.mean(axis=0)).T @ (some - some.mean(axis=0)))[0]

    def candidate(one, other):
        apart, n = rest(one) + rest(other), len(one | other) * points.shape[1]
        factor = max(1.0, apart / max(n - 6, 1))
        return (rest(one | other) - apart) / factor, 3 * np.log(n)

    patch = {c: frozenset([c]) for c in range(len(points))}
    waiting = [(a, b, patch[a], patch[b], *candidate(patch[a], patch[b])) for a, b in edges]
    while waiting := [entry for entry in waiting if entry[4] <= entry[5]]:
        best = min(range(len(waiting)), key=lambda i: waiting[i][4])
        a, b, one, other, _, _ = waiting.pop(best)
        if patch[a] is patch[b]:
            continue
        if {one, other} != {patch[a], patch[b]}:  # judged before one of them grew
            one, other = patch[a], patch[b]
            waiting.append((a, b, one, other, *candidate(one, other)))
            continue
        patch |= dict.fromkeys(one | other, one | other)
    return np.array([min(patch[c]) for c in range(len(points))])


@pytest.mark.parametrize("seed", range(4))
def test_cells_are_joined_as_literally_from_their_points(seed):
    """Lattices of 6 by 6 cells on a bent surface, whose noise lets some join and others not."""
    rng = np.random.default_rng(seed)
    corner = np.stack(np.meshgrid(range(6), range(6)), axis=-1).reshape(-1, 1, 2)
    x, y = np.moveaxis(corner + rng.uniform(size=(36, 8, 2)), 2, 0)
    points = np.stack(
        [9 * x, 9 * y, np.abs(x - 3) * 3 + y * y / 4 + rng.normal(size=x.shape)], axis=2
    )
    means = points.mean(axis=1)
    gaps = points - means[:, None]
    scatters = np.einsum("nki,nkj->nij", gaps, gaps)[:, *np.triu_indices(3)]
    a, b = np.triu_indices(36, 1)
    beside = np.abs(corner[a, 0] - corner[b, 0]).sum(axis=1) == 1
    edges = np.column_stack([a, b])[beside]
    sums = Sums(np.full(36, 8.0), np.full(36, 8.0), means, scatters)
    patch, _ = joined(sums, edges)
    expected = join_by_numpy(points, edges.tolist())
    assert 2 < len(np.unique(expected)) < 20
    assert_array_equal(patch, np.unique(expected, return_inverse=True)[1])


def test_pairs_of_different_numbers_are_told_once_and_both_ways():
    pairs = np.array([[7, 3], [3, 7], [5, 5], [2**31 - 1, 0]])
    assert_array_equal(once(pairs), [[0, 2**31 - 1], [3, 7], [7, 3], [2**31 - 1, 0]])


def test_points_as_flat_come_by_their_coordinates():
    rng = np.random.default_rng(0)
    points, scale = rng.integers(0, 9, (100, 3)) / 9, np.repeat([2.0, 1.0], 50)
    scale *= 1 + 1e-9 * rng.uniform(size=100)  # by less than 2 ** -17
    rows = rng.permutation(100)
    expected = sorted(rows, key=lambda i: (round(scale[i]), *points[i, ::-1]))
    found = flattest_first(rows, points, scale, np.ones(100))
    assert_array_equal(points[found], points[expected])
