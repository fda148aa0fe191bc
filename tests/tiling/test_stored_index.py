"""The nearest places in cells, against those of a search of all."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from sklearn.base import BaseEstimator

from sklearn_mcmd.planes._nearest import COMPILE_FROM, NearestPoints
from sklearn_mcmd.runtime._chunks import ORDER_FROM
from sklearn_mcmd.tiling import _stored_index
from sklearn_mcmd.tiling._cells import CellWriter, Constants
from sklearn_mcmd.tiling._stored_index import AROUND, StoredNearest, find_places, join_points
from sklearn_mcmd.tiling._sweeps import Job, Sweeps

RNG = np.random.default_rng(0)
# Half of the points are dense, and a few far from all others.
CLOUD = np.vstack([RNG.uniform(0, 1, (6_000, 3)), RNG.uniform(-1, 9, (6_000, 3))])
CLOUD[:20] *= 100
QUERIES = RNG.uniform(0, 1, (8 * ORDER_FROM, 3))


@pytest.fixture
def job(tmp_path):
    """The job whose places are those of the cloud, in cells of 4,000 points at most."""
    for name in ("cells", "found"):
        (tmp_path / name).mkdir()
    writer = CellWriter(tmp_path / "cells", 4_000)
    writer.add(CLOUD, np.arange(len(CLOUD)))
    writer.close()
    job = Job(tmp_path / "cells", tmp_path / "found", BaseEstimator(), Constants("float64", 0.0))

    def sweep(name, work, cells=job.cells):
        Sweeps(1, [])(name, work, cells, job=job)

    sweep("places", find_places)
    join_points(sweep, job)
    return job


@pytest.fixture
def n_far(monkeypatch):
    """Of each search beyond what lies around a cell, the number of queries."""
    found = []

    def search_all(self, cell, around, queries, *known, of=StoredNearest._search_all):
        found.append(len(queries))
        return of(self, cell, around, queries, *known)

    monkeypatch.setattr(StoredNearest, "_search_all", search_all)
    return found


def check(job, queries, k, share):
    """Whether the nearest of a share of all places, and of none in the first cell, are found."""
    whole, points = job.whole(), job.whole().open("points")
    among = np.random.default_rng(1).uniform(size=len(points)) < share
    among[whole.rows(0)] = False
    nearest = StoredNearest(whole, job.cells, lambda cell: among[whole.rows(cell)])
    queries = queries[np.argsort(job.cells.of(queries), kind="stable")]
    expected = NearestPoints(points, among).query(queries, k)
    for values, others in zip(nearest.query(queries, k), expected, strict=True):
        assert_array_equal(values, others)


@pytest.mark.parametrize(("k", "share"), [(1, 0.02), (16, 1.0), (16, 0.1), (128, 0.1), (128, 0.02)])
def test_nine_of_ten_queries_are_searched_once(k, share, job, n_far):
    check(job, QUERIES, k, share)
    assert sum(n_far) < 2 * (1 - AROUND) * len(QUERIES)


def test_around_a_cell_are_no_more_places_of_others_than_queries(job, n_far, monkeypatch):
    monkeypatch.setattr(_stored_index, "ORDER_FROM", COMPILE_FROM)
    seen = []

    def around(self, cell, queries, *given, of=StoredNearest._around):
        found = of(self, cell, queries, *given)
        seen.append((len(found.points) - len(self._load(cell)[0]), len(queries)))
        return found

    monkeypatch.setattr(StoredNearest, "_around", around)
    check(job, QUERIES[: 6 * COMPILE_FROM], 128, 0.5)
    assert all(n_outer <= n for n_outer, n in seen)
    assert any(n_outer == n for n_outer, n in seen)
    assert n_far
