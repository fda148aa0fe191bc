"""Files by tiles: one or many, with all that their points have, however work is divided."""

from types import SimpleNamespace

import laspy
import numpy as np
import pytest
from numpy.testing import assert_array_equal

from sklearn_mcmd.io import PointFileError, read_points, write_points
from sklearn_mcmd.tiling import _process, _run, process_files
from tiled import ESTIMATOR, OUTLIERS, REGIONS, VERBS, but, names_in, street, two_files


@pytest.mark.parametrize("verb", VERBS)
def test_the_output_is_the_same_for_any_threads_and_processes(small_file, tmp_path, verb):
    outputs = []
    for n_workers, n_threads in (1, 1), (2, 2):
        plan = _run.plan_run(2_000, 8e9, n_workers, 600, 5_000)
        plan = plan._replace(n_threads=n_threads)
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(_run, "plan_run", lambda *args, plan=plan, **known: plan)
            report = process_files(small_file, tmp_path / "out.laz", VERBS[verb])
        assert (report.n_workers, report.n_tiles) == (n_workers, 4)
        outputs.append((tmp_path / "out.laz").read_bytes())
    assert outputs[0] == outputs[1]
    assert names_in(tmp_path) == ["out.laz", "small.las"]


@pytest.mark.parametrize("verb", VERBS)
def test_a_folder_is_one_cloud_and_keeps_its_attributes(verb, tmp_path):
    """As one file of the same points."""
    cloud, estimator = street(1_200), VERBS[verb]
    folder, parts = two_files(tmp_path, cloud)
    gray = dict.fromkeys(("red", "green", "blue"), np.full(len(parts[1]), 7, np.uint16))
    write_points(folder / "b.las", parts[1].with_attributes(**gray))  # another point format
    process_files(folder, tmp_path / "out", estimator, tile_size=700)
    assert names_in(tmp_path / "out") == ["a.laz", "b.las"]
    found = [read_points(tmp_path / "out" / name) for name in ("a.laz", "b.las")]
    assert_array_equal(found[1].attributes["red"], 7)
    order = np.concatenate([part.attributes["intensity"] for part in parts])
    write_points(tmp_path / "all.las", cloud.subset(order))
    process_files(tmp_path / "all.las", tmp_path / "all.las", estimator, tile_size=700)
    expected = read_points(tmp_path / "all.las")
    for name in ("xyz", *(expected.attributes.keys() - gray.keys())):
        values = [(cloud.attributes | {"xyz": cloud.xyz})[name] for cloud in (expected, *found)]
        assert_array_equal(np.concatenate(values[1:]), values[0])
    assert names_in(tmp_path) == ["all.las", "in", "out"]


def test_a_file_of_nothing_but_outliers_is_warned_of(tmp_path):
    (tmp_path / "in").mkdir()
    write_points(tmp_path / "in" / "a.las", street(1_500))
    write_points(tmp_path / "in" / "b.las", [[3e5, 0, 5e3], [4e5, 9e3, 0]])
    with pytest.warns(UserWarning, match=r"out.b\.las: all points are outliers") as caught:
        process_files(tmp_path / "in", tmp_path / "out", OUTLIERS)
    assert [warning.filename for warning in caught] == [__file__]
    with pytest.raises(PointFileError, match="holds no points"):
        read_points(tmp_path / "out" / "b.las")


def test_an_output_may_replace_its_input_whatever_bounds_are_in_the_header(small_file, tmp_path):
    process_files(small_file, tmp_path / "expected.las", ESTIMATOR, tile_size=800)
    with open(small_file, "rb+") as file:
        file.seek(179)
        file.write(np.array([1.0, 0.0, 1.0, 0.0, 1.0, 0.0]).tobytes())
    for _ in range(2):  # the second finds columns of these names
        process_files(small_file, small_file, ESTIMATOR, tile_size=800)
        assert small_file.read_bytes() == (tmp_path / "expected.las").read_bytes()


def test_estimators_have_plain_parameters_and_no_threads_of_their_own(monkeypatch, tmp_path):
    """The folder of a run knows parameters by their repr; processes work beside each other."""
    verbs, report = [], SimpleNamespace(together="")
    monkeypatch.setattr(_process, "run_by_tiles", lambda verb, *_: verbs.append(verb) or report)
    growing = but(REGIONS, n_neighbors=np.uint8(20), n_jobs=8, normal_estimator__n_jobs=-1)
    process_files(tmp_path / "a.las", tmp_path / "b.las", growing, n_jobs=2)
    (estimator,) = (verb.estimator for verb in verbs)
    assert type(estimator.n_neighbors) is int
    assert (estimator.n_jobs, estimator.normal_estimator.n_jobs) == (1, 1)
    assert (growing.n_jobs, growing.normal_estimator.n_jobs) == (8, -1)


def test_a_warning_of_what_results_replace_names_the_line_of_the_caller(tmp_path):
    write_points(path := tmp_path / "a.las", street(3_000))
    las = laspy.read(path)
    las.add_extra_dim(laspy.ExtraBytesParams("normals", "3f8"))
    las.write(path)
    with pytest.warns(match="the results replace what the input calls normals") as caught:
        process_files(path, tmp_path / "b.las", ESTIMATOR, tile_size=1_000, n_jobs=1)
    assert [warning.filename for warning in caught] == [__file__]
