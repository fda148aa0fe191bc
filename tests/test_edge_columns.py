"""Columns of edges in a file."""

import numpy as np
from numpy.testing import assert_array_equal

from sklearn_mcmd.plotting._still import edge_columns

IS_EDGE, SCORE = np.array([True, False, True]), np.array([0.5, 12.0, 1.9])


def test_edges_are_red_and_surfaces_gray():
    columns = edge_columns(IS_EDGE, SCORE, True)
    colors = np.column_stack([columns[name] for name in ("red", "green", "blue")])
    assert_array_equal(colors, [[215, 30, 30], [170, 170, 170], [215, 30, 30]])
    assert colors.dtype == np.uint8
    assert all(column.flags.c_contiguous for column in columns.values())


def test_labels_and_scores_are_told_and_colors_only_if_asked():
    columns = edge_columns(IS_EDGE, SCORE, False)
    assert list(columns) == ["edge", "edge_score"]
    assert_array_equal(columns["edge"], [1, 0, 1])
    assert_array_equal(columns["edge_score"], SCORE.astype(np.float32))
    assert (columns["edge"].dtype, columns["edge_score"].dtype) == (np.uint8, np.float32)
