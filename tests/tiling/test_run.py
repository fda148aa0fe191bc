"""Files by tiles are those that memory writes: one or many, with all that their points have."""

import os
import warnings
from functools import partial
from types import SimpleNamespace

import joblib
import laspy
import numpy as np
import pytest
from numpy.testing import assert_array_equal
from sklearn.base import clone

from sklearn_mcmd import (
    MCMDOutlierDetector,
    RegionGrowing,
    RobustNormalEstimator,
    SharpFeatureDetector,
)
from sklearn_mcmd.io import PointFileError, read_points, write_points
from sklearn_mcmd.io._classes import noise_classes
from sklearn_mcmd.io._point_cloud import without_outliers
from sklearn_mcmd.outliers._lowest_points import LowestPoints
from sklearn_mcmd.tiling import _memory, _process, _run, _sweeps, process_files
from sklearn_mcmd.tiling._cells import Constants
from sklearn_mcmd.tiling._sweeps import Job
from tiled import ESTIMATOR, columns_of, fit_in_memory, in_memory, names_in, street, two_files

TILE = 5_000
OUTLIERS = MCMDOutlierDetector(16, random_state=0)
REGIONS = RegionGrowing(20, normal_estimator=RobustNormalEstimator(24, random_state=0))
EDGES = SharpFeatureDetector(12, random_state=0)


@pytest.mark.parametrize(
    ("tile_size", "n_workers", "n_threads"),
    [(2_000, 1, 1), (50_000, 1, 1), (TILE, 1, 2), (TILE, 2, 1)],
)
def test_the_output_is_that_of_memory_for_any_tiles_threads_and_processes(
    street_file, tmp_path, monkeypatch, tile_size, n_workers, n_threads
):
    source, expected = street_file
    plan = _run.plan_run(12_000, 8e9, n_workers, tile_size=tile_size)
    plan = plan._replace(n_threads=n_threads)
    monkeypatch.setattr(_run, "plan_run", lambda *args, **kwargs: plan)
    estimator = clone(ESTIMATOR).set_params(n_neighbors=np.uint8(ESTIMATOR.n_neighbors))
    report = process_files(source, tmp_path / "out.laz", estimator)
    assert (tmp_path / "out.laz").read_bytes() == expected.read_bytes()
    assert report.n_workers == n_workers
    assert report.n_tiles >= 12_000 / tile_size
    assert names_in(tmp_path) == ["out.laz"]


@pytest.mark.parametrize(
    ("estimator", "n_jobs"), [(ESTIMATOR, 1), (OUTLIERS, 1), (REGIONS, 2), (EDGES, 2)]
)
def test_a_folder_is_one_cloud_and_keeps_its_attributes(estimator, n_jobs, tmp_path):
    cloud = street(5_000)
    folder, parts = two_files(tmp_path, cloud)
    gray = dict.fromkeys(("red", "green", "blue"), np.full(len(parts[1]), 7, np.uint16))
    write_points(folder / "b.las", parts[1].with_attributes(**gray))  # another point format
    report = process_files(folder, tmp_path / "out", estimator, tile_size=1_500, n_jobs=n_jobs)
    assert report.n_workers == n_jobs
    assert names_in(tmp_path / "out") == ["a.laz", "b.las"]
    found = [read_points(tmp_path / "out" / name) for name in ("a.laz", "b.las")]
    assert_array_equal(found[1].attributes["red"], 7)
    order = np.concatenate([part.attributes["intensity"] for part in parts])
    write_points(tmp_path / "all.las", cloud.subset(order))
    process_files(tmp_path / "all.las", tmp_path / "all.las", estimator)
    expected = read_points(tmp_path / "all.las")
    assert_array_equal(np.vstack([part.xyz for part in found]), expected.xyz)
    for name in expected.attributes.keys() - gray.keys():
        both = np.concatenate([part.attributes[name] for part in found])
        assert_array_equal(both, expected.attributes[name])


@pytest.mark.parametrize("estimator", [REGIONS, EDGES])
@pytest.mark.parametrize("colors", [True, False])
def test_colors_are_written_if_they_are_asked_for(estimator, colors, small_file, tmp_path):
    process_files(small_file, tmp_path / "b.las", estimator, tile_size=2_500, colors=colors)
    assert ("red" in read_points(tmp_path / "b.las").attributes) == colors


@pytest.mark.parametrize(("mode", "n_jobs"), [("drop", 1), ("mark", 2)])
@pytest.mark.parametrize("chosen", [False, True], ids=["all", "some classes"])
def test_outliers_are_dropped_or_marked_as_in_memory(mode, n_jobs, chosen, tmp_path):
    """Points that are withheld or of other classes are kept, and have no score."""
    path, expected, target = (tmp_path / name for name in ("a.laz", "b.laz", "c.laz"))
    cloud, rng = street(6_000), np.random.default_rng(0)
    classes, withheld = rng.choice([1, 2, 6, 9], len(cloud)), rng.random(len(cloud)) < 0.1
    options, used = {}, np.ones(len(cloud), bool)
    if chosen:
        cloud = cloud.with_attributes(classification=classes, withheld=withheld)
        options = {"only_classes": [1, 2, 6], "ignore_classes": [6]}
        used = ~withheld & np.isin(classes, [1, 2])
    write_points(path, cloud)
    cloud = read_points(path)
    fitted = fit_in_memory(cloud.xyz[used], OUTLIERS)
    scores = np.full(len(cloud), np.nan)
    scores[used] = -fitted.scores_
    is_outlier = scores > -fitted.offset_
    if mode == "drop":
        write_points(expected, without_outliers(cloud, ~is_outlier))
    else:
        lowest = LowestPoints(len(cloud), 16)
        noise = noise_classes(cloud, is_outlier, is_outlier, used, lowest)
        assert set(noise) == {0, 7, 18}
        made = cloud.with_attributes(outlier_score=scores.astype(np.float32))
        write_points(expected, made, noise=noise)
    options |= {"mode": mode, "tile_size": 1_500, "n_jobs": n_jobs}
    report = process_files(path, target, OUTLIERS, **options)
    assert target.read_bytes() == expected.read_bytes()
    assert report.n_workers == n_jobs
    assert (report.n_points, report.n_judged) == (len(cloud), used.sum())
    assert (report.n_outliers, report.removed_fraction) == (is_outlier.sum(), is_outlier.mean())
    assert names_in(tmp_path) == ["a.laz", "b.laz", "c.laz"]


def test_few_points_among_many_of_other_classes_are_judged_as_in_memory(tmp_path):
    cloud, is_ground = street(3_000), np.arange(3_000) % 7 == 0
    write_points(tmp_path / "a.las", cloud.with_attributes(classification=1 + is_ground))
    fitted = fit_in_memory(read_points(tmp_path / "a.las").xyz[is_ground], OUTLIERS)
    options = {"mode": "mark", "only_classes": [2], "tile_size": 150}
    process_files(tmp_path / "a.las", tmp_path / "b.las", OUTLIERS, **options)
    found = read_points(tmp_path / "b.las").attributes["outlier_score"]
    assert_array_equal(found[is_ground], -fitted.scores_.astype(np.float32))
    assert np.isnan(found[~is_ground]).all()


def test_a_file_of_nothing_but_outliers_is_warned_of(tmp_path):
    (tmp_path / "in").mkdir()
    write_points(tmp_path / "in" / "a.las", street(1_500))
    write_points(tmp_path / "in" / "b.las", [[3e5, 0, 5e3], [4e5, 9e3, 0]])
    with pytest.warns(UserWarning, match=r"out.b\.las: all points are outliers") as caught:
        process_files(tmp_path / "in", tmp_path / "out", OUTLIERS)
    assert [warning.filename for warning in caught] == [__file__]
    with pytest.raises(PointFileError, match="holds no points"):
        read_points(tmp_path / "out" / "b.las")


def test_points_on_no_surface_that_take_more_than_the_memory_are_warned_of(tmp_path, monkeypatch):
    monkeypatch.setattr(_memory, "REST_POINT", 10**6)
    write_points(tmp_path / "a.las", np.random.default_rng(0).uniform(0, 5, (3_000, 3)))
    options = {"memory": "500MB", "tile_size": 2_000}
    with pytest.warns(UserWarning, match=r"of 3,000 different points .* more than memory=500MB"):
        process_files(tmp_path / "a.las", tmp_path / "b.las", REGIONS, **options)


def test_bounds_in_the_header_do_not_matter(small_file, tmp_path):
    expected = in_memory(small_file, tmp_path / "expected.las")
    with open(small_file, "rb+") as file:
        file.seek(179)
        file.write(np.array([1.0, 0.0, 1.0, 0.0, 1.0, 0.0]).tobytes())
    process_files(small_file, tmp_path / "out.las", ESTIMATOR, tile_size=2_000)
    assert (tmp_path / "out.las").read_bytes() == expected.read_bytes()


def test_an_output_may_replace_its_input(small_file, tmp_path):
    expected = in_memory(small_file, tmp_path / "expected.las").read_bytes()
    for tile_size in (2_000, 2_500):  # the second finds columns of these names
        process_files(small_file, small_file, ESTIMATOR, tile_size=tile_size)
        assert small_file.read_bytes() == expected


def test_several_files_may_become_one(tmp_path):
    (tmp_path / "in").mkdir()
    paths = [tmp_path / "in" / "b.laz", tmp_path / "in" / "a.las"]
    for seed, path in enumerate(paths):
        write_points(path, street(2_500, seed))
    process_files(paths, tmp_path / "joined.laz", ESTIMATOR, tile_size=2_000)
    clouds, joined = [read_points(path) for path in paths], read_points(tmp_path / "joined.laz")
    xyz = np.vstack([cloud.xyz for cloud in clouds])
    expected = dict(zip(*columns_of(fit_in_memory(xyz)), strict=True))
    expected["intensity"] = np.concatenate([cloud.attributes["intensity"] for cloud in clouds])
    for name, values in expected.items():
        assert_array_equal(joined.attributes[name], values)
    assert_array_equal(joined.xyz, xyz)
    assert names_in(tmp_path) == ["in", "joined.laz"]


@pytest.mark.parametrize("how", ["changes", "vanishes"])
def test_an_input_that_changes_during_the_run_is_noticed(small_file, tmp_path, monkeypatch, how):
    compute = _sweeps.compute_cells

    def change(*args):
        compute(*args)
        if not small_file.exists() or (tmp_path / "before.las").exists():
            return
        small_file.rename(tmp_path / "before.las")
        if how == "changes":
            write_points(small_file, street(5_000))

    monkeypatch.setattr(_sweeps, "compute_cells", change)
    message = {
        "changes": r"small\.las: has changed since it was read$",
        "vanishes": r"small\.las: cannot be read: no such file.*kept in .*out\.las\.tiles",
    }
    with pytest.raises(ValueError, match=message[how]):
        process_files(small_file, tmp_path / "out.las", ESTIMATOR, tile_size=2_000)
    assert not (tmp_path / "out.las").exists()
    monkeypatch.undo()
    (tmp_path / "before.las").replace(small_file)
    report = process_files(small_file, tmp_path / "out.las", ESTIMATOR, tile_size=2_000)
    assert report.n_resumed == (report.n_tiles if how == "vanishes" else 0)


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write")
def test_a_read_only_output_is_refused_before_the_work(small_file, tmp_path):
    target = tmp_path / "out.las"
    target.touch(mode=0o400)
    with pytest.raises(PointFileError, match="write-protected"):
        process_files(small_file, target, ESTIMATOR)


@pytest.mark.parametrize(("n_workers", "expected"), [(1, [3] * 5), (4, [3, 3, 3, 6, 12])])
def test_the_last_tiles_get_the_threads_of_idle_processes(n_workers, expected, tmp_path):
    counts, given = np.array([50, 20, 40, 10, 30]), {}
    cells = SimpleNamespace(counts=counts, folder=tmp_path / "cells")
    job = Job(tmp_path, tmp_path, ESTIMATOR, Constants("float64", 0.0), n_threads=3)

    def work(cell, job):
        given[cell] = job.n_threads

    with joblib.parallel_config("threading"):
        _sweeps.compute_cells(partial(work, job=job), cells, range(5), n_workers)
    assert [given[cell] for cell in np.argsort(-counts)] == expected


def test_estimators_start_no_threads_of_their_own_beside_the_processes(monkeypatch, tmp_path):
    verbs, report = [], SimpleNamespace(together="")
    monkeypatch.setattr(_process, "run_by_tiles", lambda verb, *_: verbs.append(verb) or report)
    growing = clone(REGIONS).set_params(n_jobs=8, normal_estimator__n_jobs=-1)
    process_files(tmp_path / "a.las", tmp_path / "b.las", growing, n_jobs=2)
    (estimator,) = (verb.estimator for verb in verbs)
    assert (estimator.n_jobs, estimator.normal_estimator.n_jobs) == (1, 1)
    assert (growing.n_jobs, growing.normal_estimator.n_jobs) == (8, -1)


def test_a_process_that_is_replaced_as_it_holds_much_is_no_leak_to_warn_of(monkeypatch, tmp_path):
    """Joblib says so of processes that hold 300 MB more than at first, as those of tiles may."""

    def parallel(**_):
        def work_off(tasks):
            for function, known, _ in tasks:
                text = "A worker stopped while some jobs were given to the executor."
                warnings.warn(text, UserWarning, stacklevel=1)
                yield function(*known)

        return work_off

    monkeypatch.setattr(_sweeps, "Parallel", parallel)
    cells = SimpleNamespace(counts=np.array([2, 1]), folder=tmp_path / "cells")
    assert _sweeps.compute_cells(partial(pow, 10), cells, range(2), 2) == {0: 1, 1: 10}


def test_a_warning_of_the_thread_that_reads_ahead_names_the_line_of_the_caller(tmp_path):
    write_points(path := tmp_path / "a.las", street(3_000))
    las = laspy.read(path)
    las.add_extra_dim(laspy.ExtraBytesParams("normals", "3f8"))
    las.write(path)
    with pytest.warns(match="the results replace what the input calls normals") as caught:
        process_files(path, tmp_path / "b.las", ESTIMATOR, tile_size=1_000, n_jobs=1)
    assert [warning.filename for warning in caught] == [__file__]
