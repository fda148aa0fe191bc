"""Numbers as languages and programs write them."""

import numpy as np
import pytest

from sklearn_mcmd.io._numerals import named_nans, number_of, plain_numbers


@pytest.mark.parametrize(
    ("cell", "number"),
    [
        ("1.0D+00", 1), ("-1.5d2", -150), (".5D1", 5), ("1.D0", 1), ("0.25D-02", 0.0025),
        ("5,411,234.500", 5411234.5), ("-1,234.", -1234), ("5,411,234", 5411234),
        ("1e5", 1e5), ("N/A", np.nan), ("", np.nan),
    ],
)  # fmt: skip
def test_numbers_are_read_as_they_are_meant(cell, number):
    swapped = cell.translate(str.maketrans(",.", ".,"))
    np.testing.assert_equal([number_of(cell), number_of(swapped, comma=True)], [number] * 2)


@pytest.mark.parametrize(
    "cell",
    ["12d34", "3D", "1d2", "1_000.5", "wall", "1,234", "1,5", "12,34,567", "1,23.5", "0,123.5",
     "1,234,56", ",123,456", "1.5.2"],
)  # fmt: skip
def test_what_may_be_meant_otherwise_is_no_number(cell):
    assert number_of(cell) is None


def test_nan_and_infinity_of_windows_get_their_names():
    line = "1.#QNAN -1.#IND 1,#SNAN -nan(ind) nan(snan) 1.#INF -1.#INF00 1.#INF00e+000 1.#QNAN0"
    assert named_nans(line) == "nan -nan nan -nan nan inf -inf inf nan"
    line = "1 2 3 # 1. # INF, (a) nan"
    assert named_nans(line) == line


@pytest.mark.parametrize(
    ("line", "comma", "plain"),
    [
        ("1.5D0 2 1.#INF # last", False, "1.5e0 2 inf "),
        ("1,5;2,5D1;3", True, "1.5;2.5e1;3"),
        ("1.234;2,5", True, "1_234;2.5"),  # which NumPy refuses
    ],
)
def test_lines_become_those_that_numpy_reads(line, comma, plain):
    assert plain_numbers(line, comma) == plain
