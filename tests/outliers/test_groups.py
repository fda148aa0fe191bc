"""What groups look like, many at once or few."""

import tracemalloc

import numpy as np
from numpy.testing import assert_array_equal

from sklearn_mcmd.outliers import _groups
from sklearn_mcmd.outliers._groups import Shapes

RNG = np.random.default_rng(0)


def test_shapes_do_not_depend_on_how_many_groups_are_asked_for_at_once(monkeypatch):
    group = np.concatenate([np.arange(50), RNG.integers(0, 50, 500)])
    points = RNG.normal(0, 1, (550, 3)) * np.array([[1, 0.1, 0.01], [1, 0.01, 0]])[group % 2]
    shapes = Shapes.of(points + group[:, None], group)
    assert 0 < np.count_nonzero(shapes.straight) < 50
    monkeypatch.setattr(_groups, "GROUPS_AT_ONCE", 7)
    for values, expected in zip(Shapes.of(points + group[:, None], group), shapes, strict=True):
        assert_array_equal(values, expected)
    none = Shapes.of(np.empty((0, 3)), np.empty(0, np.int32))
    assert [values.shape[0] for values in none] == [0] * len(shapes)


def test_the_shapes_of_many_groups_take_a_quarter_of_a_kilobyte_each():
    n = 100_000
    points, group = RNG.normal(0, 1, (n, 3)), np.arange(n)
    tracemalloc.start()
    Shapes.of(points, group)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 256 * n
