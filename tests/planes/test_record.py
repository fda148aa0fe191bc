"""The records: parts are taken and put back, slices are views, padding is told."""

import numpy as np
from numpy.testing import assert_array_equal

from sklearn_mcmd.planes._record import Neighborhoods, Planes


def numbered(n, d=3):
    planes = Planes.empty(n, d)
    for i, values in enumerate(planes):
        values[:] = 100 * i + np.arange(n).reshape(n, *[1] * (values.ndim - 1))
    return planes


def test_an_empty_record_has_a_row_for_each_plane():
    planes = Planes.empty(5, 4)
    assert [values.shape for values in planes[:3]] == [(5, 4)] * 3
    assert [values.shape for values in planes[3:]] == [(5,)] * 5


def test_taken_rows_hold_all_that_is_known_of_them():
    rows = np.array([3, 0, 3])
    for whole, part in zip(numbered(5), numbered(5).take(rows), strict=True):
        assert_array_equal(part, whole[rows])


def test_a_slice_is_a_view_that_can_be_filled():
    planes = numbered(5)
    planes.take(slice(1, 3)).scale[:] = -7.0
    assert_array_equal(planes.scale[[0, 1, 2, 3]], [300, -7, -7, 303])


def test_what_is_put_is_what_was_taken_and_nothing_else_changes():
    planes, other = numbered(5), numbered(9)
    planes.put(np.array([1, 4]), other.take(np.array([8, 6])))
    for values, original, others in zip(planes, numbered(5), other, strict=True):
        assert_array_equal(values[[1, 4]], others[[8, 6]])
        assert_array_equal(values[[0, 2, 3]], original[[0, 2, 3]])


def test_neighborhoods_know_which_members_are_padding():
    around = Neighborhoods(np.array([[4, 2, 7], [5, 1, 5], [6, 6, 6]]), np.array([3, 2, 1]))
    expected = [[True, True, True], [True, True, False], [True, False, False]]
    assert_array_equal(around.valid, expected)
    assert_array_equal(around.take([1, 2]).valid, expected[1:])
