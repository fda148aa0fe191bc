"""What is known of a whole cloud, of which only parts are in memory."""

import numpy as np
from numpy.testing import assert_array_equal

from sklearn_mcmd.tiling._cells import Levels


def test_levels_of_parts_are_those_of_all_values_with_their_counts():
    levels, values = Levels(), np.random.default_rng(0).integers(0, 50, 1000) / 4
    for part in np.split(values, [300, 310, 600]):
        levels.add(*np.unique(part, return_counts=True))
    for merged, expected in zip(
        levels.merged(), np.unique(values, return_counts=True), strict=True
    ):
        assert_array_equal(merged, expected)
