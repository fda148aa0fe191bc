"""Packed points are those that went in, within the stated error, each with its row."""

import itertools

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from pages import column, read_chunk
from sklearn_mcmd.view import _encoding
from sklearn_mcmd.view._encoding import Grid, pack_column, pack_points, shuffled

whole = st.sampled_from([np.uint8, np.uint16, np.uint32]).flatmap(
    lambda dtype: arrays(dtype, st.integers(1, 200))
)
clouds = arrays(
    np.float64,
    st.tuples(st.integers(1, 60), st.just(3)),
    elements=st.floats(-1e7, 1e7, width=32, allow_subnormal=False),
)


WRAPPED = [  # whose differences wrap around at the ends of the range
    np.cumsum(np.tile([top // 2 + 1, 3, top - 5, 1], 500), dtype=np.uint64).astype(dtype)
    for dtype, top in ((np.uint8, 255), (np.uint16, 65535), (np.uint32, 2**32 - 1))
]


@given(whole)
@example(WRAPPED[0])
@example(WRAPPED[1])
@example(WRAPPED[2])
def test_a_column_is_read_as_it_was_written(values):
    width, delta, data = pack_column(values)
    text = _encoding._text(data)
    assert column(text, len(values), width, delta, len(data)) == values.tolist()


@given(clouds)
@example(np.full((3, 3), 7.5))
@example(np.arange(6.0).reshape(2, 3))
@example(np.vstack([np.random.default_rng(0).uniform(size=(100, 3)), np.full((1, 3), 1e12)]))
@settings(max_examples=60)
def test_no_coordinate_is_off_by_more_than_the_stated_error(xyz):
    grid = Grid.of([xyz])
    assert grid.encode(xyz).max() < 2**31  # so that differences fit 32 bits with a sign
    rounding = 4 * np.spacing(np.abs(xyz).max())  # of float64 itself
    assert (
        np.abs(grid.decode(grid.encode(xyz)) - xyz).max()
        <= grid.error + rounding + 1e-9 * grid.step
    )


@pytest.mark.parametrize("extent", [1.0, 300.0, 5000.0])
def test_the_error_is_below_a_tenth_of_the_spacing(extent):
    xyz = np.random.default_rng(0).uniform(0, 1, (5000, 3)) * [extent, extent, 0.01 * extent]
    xyz[-1] = 100 * extent  # a stray point
    grid = Grid.of([xyz])
    nearest = np.median([np.sort(np.linalg.norm(xyz - p, axis=1))[1] for p in xyz[:300]])
    assert 0 < grid.error < 0.1 * nearest
    assert grid.spacing == pytest.approx(nearest, rel=0.15)


def test_coordinates_of_a_decimal_step_are_exact_also_far_from_the_origin():
    whole = np.random.default_rng(0).integers(0, 3000, (4000, 3))
    places = [4e5, 5e6, 1e2], [356_000.5, 5_640_000, -80], [-15, -15, -15]
    for decimal, place in itertools.product((0.01, 0.001), places):
        xyz = whole * decimal + np.array(place)  # as LAS makes them, off by rounding
        for made in (xyz, np.round(xyz, 3)):
            grid = Grid.of([made])
            assert (round(grid.step, 9), grid.error) == (decimal, 0.0)
            np.testing.assert_allclose(grid.decode(grid.encode(made)), made, rtol=0, atol=1e-8)
    xyz = np.round(np.random.default_rng(0).uniform(0, 100, (500, 3)), 6)
    assert Grid.of([xyz]).error > 0  # a finer step than needed is not kept


def test_each_point_keeps_its_row_and_its_values(monkeypatch):
    monkeypatch.setattr(_encoding, "FIRST_CHUNK", 64)
    monkeypatch.setattr(_encoding, "LARGEST_CHUNK", 256)
    rng = np.random.default_rng(1)
    n = 1000
    steps = np.column_stack([np.arange(n) * 3, rng.integers(0, 50, n), rng.integers(0, 9, n)])
    steps, values = steps.astype(np.uint32), rng.integers(0, 65536, n).astype(np.uint16)
    rows = shuffled(n, n)
    blocks = ["of another cloud"]
    chunks = pack_points(steps[rows], rows, [values[rows]], blocks)
    assert [chunk["n"] for chunk in chunks] == [64, 128, 256, 256, 256, 40]
    parts = [read_chunk(chunk, blocks) for chunk in chunks]
    x, y, z, row, value = (np.concatenate(column) for column in zip(*parts, strict=True))
    np.testing.assert_array_equal(np.sort(row), np.arange(n))
    np.testing.assert_array_equal(np.column_stack([x, y, z]), steps[row])
    np.testing.assert_array_equal(value, values[row])
