"""Cells, blocks of cells and patches, against literal forms."""

from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from sklearn_mcmd.segmentation._region_cells import (
    Points,
    Sums,
    joined,
    keys,
    named,
    pairs_of,
    places,
)
from sklearn_mcmd.segmentation._regions_numba import gather


def gathered(order, near, labels, parts=1):
    """The first of the cell of each node, found in parts that know of others what was found before,
    and how often each part was asked."""
    n = len(labels)
    first, names = np.full(n, -1, np.int32), np.arange(n, dtype=np.int32)
    for times in range(1, n + 1):
        for own in np.array_split(names, parts):
            begin, end, found = own[0], own[-1] + 1, first.copy()
            theirs = np.setdiff1d(names, own)
            theirs = theirs[(found[theirs] == theirs) | (found[theirs] == -1)]  # may begin a cell
            nodes = np.concatenate([own, theirs])
            place = np.full(n, -1)
            place[nodes] = np.arange(len(nodes))
            unsure = np.append(np.zeros(len(own)), found[theirs] == -1).astype(np.int8)
            some, starts = place[order], np.arange(len(nodes) + 1) * near.shape[1]
            known = starts, near[nodes].ravel() - begin, labels[nodes], nodes.astype(np.int32)
            gather(some[some >= 0], *known, first[begin:end], unsure)
        if (first[labels >= 0] >= 0).all():
            return first, times
    raise AssertionError("it does not end")


@pytest.mark.parametrize("parts", [1, 2, 7, 40])
def test_cells_are_gathered_in_order_wherever_their_points_lie(parts):
    """A cell begins at each point in order that no cell has, of the near ones of its region that
    none has. Parts that ask each other for what they have found come to the same."""
    rng = np.random.default_rng(0)
    for _ in range(10):
        points, labels = rng.uniform(size=(200, 3)), rng.integers(-1, 2, 200).astype(np.int32)
        points = points[np.argsort(points[:, 0])]
        gaps = np.linalg.norm(points[:, None] - points, axis=2)
        near = np.argsort(gaps, axis=1)[:, :7].astype(np.int32)
        order, expected = rng.permutation(np.flatnonzero(labels >= 0)), np.full(200, -1)
        for i in order:
            if expected[i] < 0:
                expected[[j for j in near[i] if expected[j] < 0 and labels[j] == labels[i]]] = i
        first, times = gathered(order, near, labels, parts)
        assert_array_equal(first, expected)
        assert times <= (1 if parts == 1 else 12)
    first, _ = gathered(order, near[:, :1], labels, parts)  # a cell of each point alone
    assert_array_equal(first, np.where(labels < 0, -1, np.arange(200)))


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
    first, patch, _ = joined(sums, edges)
    expected = join_by_numpy(points, edges.tolist())
    assert 2 < len(np.unique(expected)) < 20
    assert_array_equal(first[patch], expected)


class Nodes(Points):
    """Points of one region, in an order that is given."""

    def __init__(self, rank):
        self.rank, self.labels = rank, np.zeros(len(rank), np.int32)

    def in_order(self, rows):
        return np.argsort(self.rank[rows])


@pytest.mark.parametrize("n_parts", [1, 2, 5])
@pytest.mark.parametrize("seed", range(4))
def test_blocks_are_gathered_in_order_wherever_their_cells_are(n_parts, seed):
    """Of cells in order, each without a block begins one, of all beside it without a block."""
    rng = np.random.default_rng(seed)
    rank, names = rng.permutation(300), np.sort(rng.choice(300, 120, replace=False))
    beside = keys(rng.choice(names, (150, 2)))
    nodes, literal = Nodes(rank), {}
    for name in names[nodes.in_order(names)].tolist():
        if name not in literal:
            literal[name] = name
            for first, other in pairs_of(beside).tolist():
                if first == name:
                    literal.setdefault(other, name)
    known = np.full(300, -1, np.int32)
    for _ in range(len(names)):
        before = known.copy()
        for own in np.array_split(names, n_parts):
            some = beside[np.isin(beside >> 32, own)]
            known[own] = nodes.gather_blocks(own.astype(np.int32), some, before)
        if (known[names] >= 0).all():
            break
    assert_array_equal(known[names], [literal[name] for name in names.tolist()])


def test_keys_stand_for_pairs_of_different_names_both_ways():
    pairs = np.array([[7, 3], [3, 7], [5, 5], [2**31 - 1, 0]])
    found = keys(pairs)
    assert_array_equal(pairs_of(found), [[0, 2**31 - 1], [3, 7], [7, 3], [2**31 - 1, 0]])
    names, new = np.array([0, 3, 7, 2**31 - 1]), np.array([1, 1, 4, 1])
    again = named(found, lambda old: new[np.searchsorted(names, old)])
    assert_array_equal(pairs_of(again), [[1, 4], [4, 1]])
    assert_array_equal(places(np.array([5, 2, 9]), np.array([[9, 2]])), [[2, 1]])


def test_points_as_flat_and_so_near_that_chance_is_equal_too_come_by_their_coordinates():
    rng = np.random.default_rng(0)
    points = np.vstack([np.repeat(rng.uniform(0, 1, (50, 3)), 2, axis=0), [[0, 0, 0], [1, 1, 1]]])
    points[1:100:2] += 1e-9  # of an extent of 1, less than 2 ** -20

    def in_order(rows):
        known = Points.__new__(Points)
        known.unit, known.low, known.extent = 1.0, np.zeros(3), 1.0
        known.index, known.noise = SimpleNamespace(points=points[rows]), np.ones(len(rows))
        known.planes = SimpleNamespace(scale=np.ones(len(rows)))
        return rows[known.in_order(np.arange(len(rows)))]

    order = in_order(np.arange(102))
    for _ in range(3):
        assert_array_equal(in_order(rng.permutation(102)), order)
