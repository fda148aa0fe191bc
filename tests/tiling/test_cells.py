"""Points in cells of few points each, and what is known of a cloud of which parts are in memory."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from sklearn_mcmd.tiling._cells import Cells, CellWriter, Levels


@pytest.mark.parametrize("center", [None, [0.4, 0.5, 0.6]], ids=["boxes", "wedges"])
def test_each_point_is_in_the_one_cell_whose_box_it_is_in(center, tmp_path):
    X = np.random.default_rng(0).normal(0, 1, (5_000, 3)) ** 3  # dense in the middle
    X[:700] = X[0]
    writer = CellWriter(tmp_path, 500, center=center)
    for rows in np.array_split(np.arange(len(X)), 7):
        writer.add(X[rows], rows)
    writer.close()
    cells = Cells(tmp_path)
    assert np.sort(cells.counts)[-2] <= 500 <= cells.counts.max()  # copies are never divided
    assert cells.n_points == len(X)
    seen = np.concatenate([cells.rows(cell) for cell in range(len(cells))])
    assert_array_equal(np.sort(seen), np.arange(len(X)))
    for cell in range(len(cells)):
        xyz, rows = cells.points(cell), cells.rows(cell)
        places = cells.places(xyz)
        assert_array_equal(xyz, X[rows])
        assert (np.diff(rows) > 0).all()
        assert ((places >= cells.low[cell]) & (places < cells.high[cell])).all()
        assert_array_equal(cells.extent(cell), [places.min(axis=0), places.max(axis=0)])
    low, high = cells.low[3] - 0.1, cells.high[3] + 0.1
    places = cells.places(X)
    near = ((places >= low) & (places <= high)).all(axis=1)
    near[cells.rows(3)] = False
    xyz, rows, homes, at = cells.within(3, 0.1)
    assert_array_equal(np.sort(rows), np.flatnonzero(near))
    assert_array_equal(xyz, X[rows])
    assert_array_equal([cells.rows(home)[i] for home, i in zip(homes, at, strict=True)], rows)


def test_levels_of_parts_are_those_of_all_values_with_their_counts():
    levels, values = Levels(), np.random.default_rng(0).integers(0, 50, 1000) / 4
    for part in np.split(values, [300, 310, 600]):
        levels.add(*np.unique(part, return_counts=True))
    for merged, expected in zip(
        levels.merged(), np.unique(values, return_counts=True), strict=True
    ):
        assert_array_equal(merged, expected)
