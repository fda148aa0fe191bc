"""Columns on disk by their rows, and cells that answer as parts of a cloud in memory."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from sklearn_mcmd import RegionGrowing, RobustNormalEstimator
from sklearn_mcmd.io import read_points
from sklearn_mcmd.segmentation import _narrow_faces, _parts
from sklearn_mcmd.tiling import TilingError, _cell_parts, process_files
from sklearn_mcmd.tiling._stored_columns import Column, RevisedColumn
from tiled import fit_in_memory, run_is_killed, written

NORMALS = RobustNormalEstimator(24, random_state=0)
KERB = RegionGrowing(20, max_angle=5, normal_estimator=NORMALS)


@pytest.fixture
def kerb(tmp_path):
    """A file of a road, a kerb two points high, which is a narrow face, and a footpath."""
    rng = np.random.default_rng(2)
    sizes, height = (3_000, 380, 3_000), 0.127
    along, across = rng.uniform(0, 6, sum(sizes)), rng.uniform(size=sum(sizes))
    y = np.split(across, np.cumsum(sizes)[:2])
    z = np.concatenate([np.zeros(3_000), height * y[1], np.full(3_000, height)])
    y = np.concatenate([-y[0], 0 * y[1], y[2]])
    xyz = np.column_stack([along, y, z]) + rng.normal(0, 0.004, (len(z), 3))
    return written(tmp_path, np.round(xyz, 3))


@pytest.fixture
def column(tmp_path):
    np.save(tmp_path / "all.a.npy", np.arange(20.0).reshape(10, 2))
    return tmp_path / "all.a.npy"


@pytest.mark.parametrize(
    ("rows", "values"),
    [
        (slice(3, 6), -np.ones((3, 2))),
        (slice(4, 4), np.empty((0, 2))),
        (np.array([9, 0, 3, 2, 8]), -np.arange(10.0).reshape(5, 2)),
        (np.array([7]), -1.0),
        (np.empty(0, np.intp), np.empty((0, 2))),
    ],
)
def test_rows_of_a_column_are_written_and_no_others(column, rows, values):
    expected, found = np.load(column), Column(column)
    assert (len(found), found.shape) == (10, (10, 2))
    expected[rows] = values
    found[rows] = values
    assert_array_equal(np.load(column), expected)
    assert_array_equal(Column(column)[rows], expected[rows])


def test_a_column_becomes_what_it_was_unless_it_was_not_changed(column):
    before, found = np.load(column), RevisedColumn(column)
    found.restore()
    assert_array_equal(np.load(column), before)
    found[np.array([8, 1])] = 0.0
    assert not np.array_equal(np.load(column), before)
    for _ in range(2):
        RevisedColumn(column).restore()
        assert_array_equal(np.load(column), before)


@pytest.mark.parametrize("n_calls", [0, 1, 2])
def test_a_run_that_ends_while_planes_of_narrow_faces_change_begins_with_those_before(
    kerb, tmp_path, n_calls
):
    options = {"tile_size": 2_000, "n_jobs": 1}
    process_files(kerb, tmp_path / "b.las", KERB, **options)
    place = "_stored_columns.RevisedColumn.__setitem__"
    assert run_is_killed(kerb, tmp_path / "c.las", place, n_calls, KERB, **options)
    process_files(kerb, tmp_path / "c.las", KERB, **options)
    assert (tmp_path / "c.las").read_bytes() == (tmp_path / "b.las").read_bytes()


@pytest.mark.parametrize("n_jobs", [1, 2])
def test_narrow_faces_are_those_of_memory_whatever_parts_are(kerb, tmp_path, n_jobs, monkeypatch):
    if n_jobs == 1:  # other processes have their own
        monkeypatch.setattr(_narrow_faces, "ROWS", 300)
        monkeypatch.setattr(_parts, "PART", 700)
    expected = fit_in_memory(read_points(kerb).xyz, KERB).labels_
    process_files(kerb, tmp_path / "b.las", KERB, tile_size=2_000, n_jobs=n_jobs)
    assert_array_equal(read_points(tmp_path / "b.las").attributes["region"], expected)


def test_a_cell_that_fails_to_answer_has_its_line(kerb, tmp_path, monkeypatch):
    def answers(*_):
        raise MemoryError("enough")

    monkeypatch.setattr(_cell_parts, "answers", answers)
    with pytest.warns(match="MemoryError: enough"), pytest.raises(TilingError, match="4 of 4"):
        process_files(kerb, tmp_path / "b.las", KERB, tile_size=2_000, n_jobs=1)
