"""Plans stay within the memory."""

import numpy as np
import pytest

from sklearn_mcmd.tiling import process_files
from sklearn_mcmd.tiling._memory import (
    CELL_POINT,
    PROCESS,
    SMALLEST_CELL,
    USUAL_CELL,
    bytes_of_point,
    parse_memory,
    plan_run,
)
from tiled import ESTIMATOR, but, street, written

pytestmark = pytest.mark.usefixtures("measured")


@pytest.mark.parametrize(
    ("text", "size"),
    [("2GB", 2e9), ("500 MB", 5e8), ("1.5g", 1.5e9), ("1GiB", 2**30), ("700", 700), (5e8, 5e8)],
)
def test_sizes_are_read_as_people_write_them(text, size):
    assert parse_memory(text) == size


@pytest.mark.parametrize("memory", [6e8, 1e9, 4e9, 64e9])
@pytest.mark.parametrize("whole", [0.0, 0.15])
def test_all_processes_stay_within_the_memory_and_the_size_of_cells_does_not_depend_on_them(
    memory, whole
):
    sizes = set()
    for n_jobs in (1, 2, 7, 64):
        plan = plan_run(10**9, memory, n_jobs, None, 3_000, whole, "holds something of")
        assert 1 <= plan.n_workers * plan.n_threads <= n_jobs
        assert plan.memory <= memory
        assert plan.n_tiles * plan.tile_size >= 10**9
        sizes.add(plan.tile_size)
    (size,) = sizes
    assert SMALLEST_CELL // 2 < size <= USUAL_CELL
    assert (size == USUAL_CELL) == (memory > 3.9e9)


def test_what_one_process_does_with_all_points_takes_memory_of_the_others():
    assert plan_run(10**8, 4e9, 4, 10**5, 2_000).n_workers == 4
    assert plan_run(10**8, 4e9, 4, 10**5, 2_000, 24.0, "holds").n_workers < 4
    with pytest.raises(ValueError, match=r"at least 2830MB .* one process holds all 100,000,000 p"):
        plan_run(10**8, 2e9, 4, None, 2_000, 24.0, "holds")


def test_too_little_memory_is_refused_with_what_is_needed():
    with pytest.raises(ValueError, match="memory=330MB is too little: at least 4"):
        plan_run(10**6, PROCESS, 1, None, 2_000)


@pytest.mark.parametrize("n", [5_000, 40_000])
def test_what_a_point_takes_is_measured_by_fits(n):
    """Of so many numbers for each point, beside what a cell has."""
    xyz = np.random.default_rng(0).uniform(size=(n, 3))
    small, large = (
        bytes_of_point(lambda xyz, k=k: np.ones((len(xyz), k)), xyz) for k in (100, 300)
    )
    assert small > CELL_POINT + 800
    assert large - small == pytest.approx(1.1 * 1_600, rel=0.05)
    assert bytes_of_point(ESTIMATOR.fit, xyz) < 9_000


def test_memory_of_large_neighborhoods_is_measured_with_points_that_are_no_copies(tmp_path):
    path = written(tmp_path, street(600))
    report = process_files(path, tmp_path / "b.las", but(ESTIMATOR, n_neighbors=560))
    assert report.n_points == 600
