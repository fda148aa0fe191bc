"""The packed table of neighbors, against the neighbors that went into it."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from sklearn_mcmd.planes._neighbor_table import NeighborTable, Packed


def table_of(indices):
    """A table of given neighbors."""
    return NeighborTable(lambda rows, k: indices[rows, :k].copy(), *indices.shape)


def neighbors(n, k, spread=None, seed=0):
    """Rows near each row, or any rows at all."""
    rng = np.random.default_rng(seed)
    spread = n if spread is None else spread
    near = np.arange(n)[:, None] + rng.integers(-spread, spread + 1, (n, k))
    return np.clip(near, 0, n - 1).astype(np.int32)


@pytest.mark.parametrize("k", [1, 5, 50, 77, 300, 4096, 5000])
@pytest.mark.parametrize("spread", [40, None])
def test_what_comes_out_is_what_went_in(k, spread):
    indices = neighbors(9000 if k < 300 else 600, k, spread)
    table = table_of(indices)
    n = len(indices)
    assert_array_equal(table.query(slice(5, 99), k, keep=False), indices[5:99])
    assert table.parts == [None] * len(table.parts)
    near = table.query(slice(None), k)
    assert near.dtype == np.int32
    assert_array_equal(near, indices)
    rows = np.random.default_rng(1).integers(0, n, 500)
    for fewer in {1, (k + 1) // 2, k}:
        assert_array_equal(table.query(rows, fewer), indices[rows, :fewer])
        assert_array_equal(table.query(slice(37, n - 5), fewer), indices[37 : n - 5, :fewer])


def test_neighbors_take_a_third_of_their_size():
    """One byte each, and lists of groups: 6 of 16 rows and their reach of 40 to both sides."""
    indices = neighbors(20_000, 50, spread=40)
    table = table_of(indices)
    table.query(slice(None), 50)
    assert all(isinstance(part, Packed) for part in table.parts)
    lists = sum(values.nbytes for part in table.parts for values in part[:-1])
    assert sum(part.codes.nbytes for part in table.parts) == indices.nbytes / 4
    assert lists < 0.03 * indices.nbytes


def test_parts_hold_as_many_as_their_rows_ask_for():
    indices = neighbors(3000, 300, spread=40)
    sizes = np.full(3000, 20)
    sizes[-1] = 300
    table = NeighborTable(lambda rows, k: indices[rows, :k].copy(), 3000, 300, sizes)
    near = table.query(slice(None), 30)
    assert_array_equal(near[:, :20], indices[:, :20])
    assert_array_equal(near[-1], indices[-1, :30])
    assert_array_equal(near[0, 20:], near[0, 0])  # what no row of the part asks for
    assert_array_equal(table.query(np.array([2999, 0]), 300)[0], indices[-1])


def test_rows_whose_neighbors_lie_in_more_groups_than_codes_can_name_keep_them():
    """The neighbors of two rows are in 8,192 groups."""

    def search(rows, k):
        odd = np.arange(rows.start, rows.stop)[:, None] % 2
        return (32 * np.arange(k) + 16 * odd).astype(np.int32)

    table = NeighborTable(search, 2**17, 4096)
    assert_array_equal(table.query(slice(0, 8), 4096), search(slice(0, 8), 4096))
