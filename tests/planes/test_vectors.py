"""Vectors as values of compiled functions, against NumPy."""

import numba
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from sklearn_mcmd.planes._vectors_numba import BITS, add, load, multiply_add, store, where_below


@numba.njit
def apply(a, b, c, start, out):
    x, y, z = load(a, start), load(b, start), load(c, start)
    store(add(x, y), out[0], start)
    store(add(x, b[0]), out[1], start)
    store(where_below(x, y, z, x), out[2], start)
    store(where_below(x, b[0], c[0], x), out[3], start)


@numba.njit
def fuse(a, b, c, start, out):
    store(multiply_add(load(a, start), b[0], load(c, start)), out[0], start)


@pytest.mark.parametrize("dtype", [np.float32, np.int16])
def test_vectors_are_added_and_chosen_as_numpy_does(dtype):
    width = BITS // 8 // dtype().itemsize
    a, b, c = np.random.default_rng(0).integers(-9, 9, (3, 3 * width)).astype(dtype)
    out = np.full((4, 3 * width), 99, dtype)
    apply(a, b, c, width, out)
    expected = [a + b, a + b[0], np.where(a < b, c, a), np.where(a < b[0], c[0], a)]
    one = slice(width, 2 * width)
    assert_array_equal(out[:, one], np.array(expected)[:, one])
    out[:, one] = 99  # and nothing beside it was written
    assert (out == 99).all()


def test_nothing_is_below_a_nan_and_products_are_added():
    a, b, c = np.random.default_rng(0).normal(size=(3, 16)).astype(np.float32)
    out = np.empty((4, 16), np.float32)
    fuse(a, b, c, 0, out)
    assert_allclose(out[0], a * b[0] + c, rtol=1e-5, atol=1e-6)
    a[3], b[4] = np.nan, np.nan
    apply(a, b, c, 0, out)
    assert_array_equal(out[2], np.where(a < b, c, a))
