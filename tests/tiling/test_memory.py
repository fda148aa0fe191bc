"""Plans stay within the memory."""

from collections import defaultdict
from contextlib import contextmanager

import pytest

from sklearn_mcmd import (
    MCMDOutlierDetector,
    RegionGrowing,
    RobustNormalEstimator,
    SharpFeatureDetector,
)
from sklearn_mcmd.tiling._memory import PROCESS, parse_memory, plan_run, usual_memory
from sklearn_mcmd.tiling._stored_columns import StoredColumns
from tiled import divide


@pytest.mark.parametrize(
    ("text", "size"),
    [("2GB", 2e9), ("500 MB", 5e8), ("1.5g", 1.5e9), ("1GiB", 2**30), ("700", 700), (5e8, 5e8)],
)
def test_sizes_are_read_as_people_write_them(text, size):
    assert parse_memory(text) == size


@pytest.mark.parametrize("text", ["much", "", "-2GB", "2XB", "0GB"])
def test_what_is_no_size_is_refused(text):
    with pytest.raises(ValueError, match="write it like 2GB"):
        parse_memory(text)


def test_the_usual_memory_is_a_share_of_the_machines():
    assert 1e8 < usual_memory() < 1e14


@pytest.mark.parametrize("n_jobs", [1, 2, 64])
@pytest.mark.parametrize("memory", [1e9, 2e9, 64e9])
def test_all_processes_together_stay_within_the_memory(n_jobs, memory):
    plan = plan_run(10**9, memory, n_jobs, n_features=3)
    assert 1 <= plan.n_workers * plan.n_threads <= n_jobs
    assert plan.memory <= memory
    assert plan.n_tiles * plan.tile_size >= 10**9


def test_more_memory_means_larger_tiles():
    sizes = [plan_run(10**9, memory, 1).tile_size for memory in (1e9, 2e9, 4e9)]
    assert sizes == sorted(sizes)
    assert sizes[0] > 5e5


@pytest.mark.parametrize(
    ("n_points", "memory", "n_jobs", "expected"),
    [
        (10_000_000, 1e12, 1, (1, 1)),
        (10_000_000, 1e12, 4, (4, 1)),  # each process has work
        (10**9, 2e9, 2, (1, 2)),  # threads share a large tile where each would have a small one
        (10**9, 8e9, 2, (2, 1)),
        (1_000, 8e9, 4, (1, 4)),
    ],
)
def test_processes_have_large_tiles_or_share_them(n_points, memory, n_jobs, expected):
    plan = plan_run(n_points, memory, n_jobs)
    assert (plan.n_workers, plan.n_threads) == expected
    assert plan.n_tiles >= plan.n_workers
    assert (plan.n_tiles == 1) == (plan.tile_size >= n_points)


def test_regions_of_many_points_need_memory_however_small_tiles_are():
    with pytest.raises(ValueError, match=r"at least 10480MB .*regions of all 100,000,000 points"):
        plan_run(10**8, 4e9, 4, work="regions")
    plan = plan_run(10**8, 12e9, 2, work="regions")
    assert plan.n_workers == 2
    assert plan.memory <= 12e9
    assert plan_run(10**8, 10.9e9, 2, work="regions").n_workers == 1


def test_a_hundred_million_points_are_judged_within_4_gib():
    assert plan_run(10**8, 4 * 2**30, 2, work="outliers").memory <= 4 * 2**30
    with pytest.raises(ValueError, match=r"one process judges all 100,000,000 points"):
        plan_run(10**8, 3e9, 2, work="outliers")


def test_too_little_memory_is_refused_with_what_is_needed():
    with pytest.raises(ValueError, match="at least 4"):
        plan_run(10**6, PROCESS, 1)


@pytest.mark.parametrize(
    "estimator",
    [
        MCMDOutlierDetector(20, random_state=0),
        RobustNormalEstimator("auto", random_state=0),
        RegionGrowing(normal_estimator=RobustNormalEstimator(20, random_state=0)),
        SharpFeatureDetector(20, random_state=0),
    ],
)
def test_one_process_that_works_on_all_places_frees_what_it_opens(
    estimator, small_file, tmp_path, monkeypatch
):
    """Else all that it has read of files stays in its memory: 300 bytes a point."""
    at_work, names, freed, kept = [], defaultdict(set), set(), set()
    releasing, opened = StoredColumns.releasing, StoredColumns.open

    @contextmanager
    def begin(whole):
        at_work.append(whole)
        with releasing(whole):
            yield
        at_work.remove(whole)
        freed.update(names[whole])

    def note(whole, name, *kinds, **more):
        names[whole].add(name)
        kept.update(name for of in at_work if whole is not of)
        return opened(whole, name, *kinds, **more)

    monkeypatch.setattr(StoredColumns, "releasing", begin)
    monkeypatch.setattr(StoredColumns, "open", note)
    divide(small_file, tmp_path / "out.las", estimator, tile_size=1_500, n_jobs=1)
    assert {"points", "near"} <= freed
    assert not kept
