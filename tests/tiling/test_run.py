"""Files by tiles: one or many, with all that their points have, however work is divided."""

from types import SimpleNamespace

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
from sklearn_mcmd.tiling import _process, _run, _tasks, process_files
from tiled import ESTIMATOR, names_in, street, two_files

REGIONS = RegionGrowing(20, normal_estimator=RobustNormalEstimator(24, random_state=0))
EDGES = SharpFeatureDetector(12, random_state=0)
VERBS = {
    "outliers": MCMDOutlierDetector(16, random_state=0),
    "normals": RobustNormalEstimator(np.uint8(16), orientation="mst", random_state=0),
    "regions": REGIONS,
    "edges": EDGES,
}


@pytest.mark.parametrize("name", VERBS)
def test_the_output_is_the_same_for_any_threads_and_processes(small_file, tmp_path, name):
    estimator, outputs = VERBS[name], []
    for n_workers, n_threads in (1, 1), (1, 2), (2, 1):
        plan = _run.plan_run(5_000, 8e9, n_workers, 1_500, 5_000)
        plan = plan._replace(n_threads=n_threads)
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(_run, "plan_run", lambda *args, plan=plan, **known: plan)
            report = process_files(small_file, tmp_path / "out.laz", estimator)
        assert (report.n_workers, report.n_tiles) == (n_workers, 4)
        outputs.append((tmp_path / "out.laz").read_bytes())
    assert outputs[0] == outputs[1] == outputs[2]
    assert names_in(tmp_path) == ["out.laz", "small.las"]


@pytest.mark.parametrize("name", VERBS)
def test_a_folder_is_one_cloud_and_keeps_its_attributes(name, tmp_path):
    cloud, estimator = street(5_000), VERBS[name]
    folder, parts = two_files(tmp_path, cloud)
    gray = dict.fromkeys(("red", "green", "blue"), np.full(len(parts[1]), 7, np.uint16))
    write_points(folder / "b.las", parts[1].with_attributes(**gray))  # another point format
    process_files(folder, tmp_path / "out", estimator)
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


def test_a_file_of_nothing_but_outliers_is_warned_of(tmp_path):
    (tmp_path / "in").mkdir()
    write_points(tmp_path / "in" / "a.las", street(1_500))
    write_points(tmp_path / "in" / "b.las", [[3e5, 0, 5e3], [4e5, 9e3, 0]])
    with pytest.warns(UserWarning, match=r"out.b\.las: all points are outliers") as caught:
        process_files(tmp_path / "in", tmp_path / "out", VERBS["outliers"])
    assert [warning.filename for warning in caught] == [__file__]
    with pytest.raises(PointFileError, match="holds no points"):
        read_points(tmp_path / "out" / "b.las")


def test_an_output_may_replace_its_input_whatever_bounds_are_in_the_header(small_file, tmp_path):
    process_files(small_file, tmp_path / "expected.las", ESTIMATOR, tile_size=2_000)
    with open(small_file, "rb+") as file:
        file.seek(179)
        file.write(np.array([1.0, 0.0, 1.0, 0.0, 1.0, 0.0]).tobytes())
    for _ in range(2):  # the second finds columns of these names
        process_files(small_file, small_file, ESTIMATOR, tile_size=2_000)
        assert small_file.read_bytes() == (tmp_path / "expected.las").read_bytes()


def test_several_files_may_become_one(tmp_path):
    (tmp_path / "in").mkdir()
    paths = [tmp_path / "in" / "b.laz", tmp_path / "in" / "a.las"]
    for seed, path in enumerate(paths):
        write_points(path, street(2_500, seed))
    for target in ("joined.laz", "out"):
        process_files(paths, tmp_path / target, ESTIMATOR, tile_size=2_000)
    parts = [read_points(tmp_path / "out" / path.name) for path in paths]
    joined = read_points(tmp_path / "joined.laz")
    assert_array_equal(joined.xyz, np.vstack([part.xyz for part in parts]))
    for name, values in joined.attributes.items():
        assert_array_equal(values, np.concatenate([part.attributes[name] for part in parts]))
    assert names_in(tmp_path) == ["in", "joined.laz", "out"]


@pytest.mark.parametrize("how", ["changes", "vanishes"])
def test_an_input_that_changes_during_the_run_is_noticed(small_file, tmp_path, monkeypatch, how):
    compute = _tasks.compute_cells

    def change(*args):
        compute(*args)
        small_file.rename(tmp_path / "before.las")
        if how == "changes":
            write_points(small_file, street(5_000))

    monkeypatch.setattr(_tasks, "compute_cells", change)
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


def test_estimators_start_no_threads_of_their_own_beside_the_processes(monkeypatch, tmp_path):
    verbs, report = [], SimpleNamespace(together="")
    monkeypatch.setattr(_process, "run_by_tiles", lambda verb, *_: verbs.append(verb) or report)
    growing = clone(REGIONS).set_params(n_jobs=8, normal_estimator__n_jobs=-1)
    process_files(tmp_path / "a.las", tmp_path / "b.las", growing, n_jobs=2)
    (estimator,) = (verb.estimator for verb in verbs)
    assert (estimator.n_jobs, estimator.normal_estimator.n_jobs) == (1, 1)
    assert (growing.n_jobs, growing.normal_estimator.n_jobs) == (8, -1)


def test_a_warning_of_the_thread_that_reads_ahead_names_the_line_of_the_caller(tmp_path):
    write_points(path := tmp_path / "a.las", street(3_000))
    las = laspy.read(path)
    las.add_extra_dim(laspy.ExtraBytesParams("normals", "3f8"))
    las.write(path)
    with pytest.warns(match="the results replace what the input calls normals") as caught:
        process_files(path, tmp_path / "b.las", ESTIMATOR, tile_size=1_000, n_jobs=1)
    assert [warning.filename for warning in caught] == [__file__]
