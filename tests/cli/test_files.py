"""What the verbs read and write: whole files or none, and one clear line that says why."""

import numpy as np
import pytest

from commands import done, error_line, files_in, run
from sklearn_mcmd import SharpFeatureDetector
from sklearn_mcmd.cli import _files, _plane
from sklearn_mcmd.io import read_points, write_points


def test_output_may_replace_the_input(room_file, tmp_path):
    done("denoise", room_file, tmp_path / "apart.laz")
    done("denoise", room_file, room_file)
    apart, in_place = read_points(tmp_path / "apart.laz"), read_points(room_file)
    assert apart.attributes.keys() == in_place.attributes.keys()
    np.testing.assert_array_equal(apart.xyz, in_place.xyz)


def test_rays_without_a_return_are_told_once_and_apart_from_holes(room, tmp_path):
    xyz = np.insert(np.round(room.xyz, 3), 5, np.zeros((20, 3)), axis=0)
    xyz[0, 0] = np.nan
    np.save(tmp_path / "a.npy", xyz)
    result = done("normals", tmp_path / "a.npy", tmp_path / "out.npy")
    zeros, hole = [line for line in result.stderr.splitlines() if "left out" in line]
    assert f"20 of {len(xyz):,} points are 0, 0, 0" in zeros
    assert "a.npy: 1 point without coordinates is left out" in hole


@pytest.fixture
def coarse_file(tmp_path):
    """A box of 5 m in a national grid, in single precision: steps of 0.5 m."""
    X = np.random.default_rng(0).uniform([5e5, 5.4e6, 0], [5e5 + 5, 5.4e6 + 5, 5], (300, 3))
    np.save(tmp_path / "in.npy", X.astype(np.float32))
    return tmp_path / "in.npy"


VERBS = ["denoise", "normals", "segment", "edges", "plane"]


@pytest.mark.parametrize("verb", VERBS)
def test_single_precision_too_coarse_for_the_points_is_refused_unless_allowed(
    verb, coarse_file, tmp_path
):
    line = error_line(run(verb, coarse_file, tmp_path / "out.npy"))
    assert "coordinates as large as 5,400,00" in line
    assert "to steps of 0.5" in line
    assert files_in(tmp_path) == ["in.npy"]
    result = run(verb, coarse_file, tmp_path / "out.npy", "--allow-coarse")
    assert "to steps of 0.5" in result.stderr
    assert result.exit_code == (verb == "plane")  # a box is no plane


@pytest.mark.parametrize("verb", ["denoise", "plane"])
def test_single_precision_fine_enough_is_taken_without_a_word(verb, room, tmp_path):
    np.save(tmp_path / "in.npy", room.xyz.astype(np.float32))
    assert "steps of" not in done(verb, tmp_path / "in.npy", tmp_path / "out.npy").stderr


# ---- bad input: exit code 1, one line, nothing written --------------------------------------


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (None, "no such file"),
        ("truncated", "truncated"),
        ("1 2\n3 4\n", "2 column"),
        ("0 0 0\n1 0 0\n0 1 0\n", "3 points are too few for planes in 3D: at least 4"),
    ],
)
def test_bad_input_fails_with_one_line_and_writes_nothing(text, reason, tmp_path):
    path = tmp_path / "bad.xyz"
    if text == "truncated":
        path = tmp_path / "bad.laz"
        write_points(path, np.random.default_rng(0).uniform(size=(5000, 3)))
        path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    elif text is not None:
        path.write_text(text)
    before = files_in(tmp_path)
    for verb, target in (("denoise", ["out.laz"]), ("plane", ["out.laz"]), ("info", [])):
        if verb == "denoise" or "planes" not in reason:
            line = error_line(run(verb, path, *(tmp_path / name for name in target)))
            assert reason in line
    assert files_in(tmp_path) == before


# ---- bad output: refused before the long work -----------------------------------------------


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("out.docx", "unknown extension '.docx'"),
        ("nowhere/out.laz", "does not exist"),
        ("folder.laz", "is a folder"),
        ("x" * 260 + ".laz", "cannot be written: file name too long"),
    ],
)
def test_an_output_that_cannot_be_is_refused_before_the_input_is_read(
    name, reason, room_file, tmp_path, monkeypatch
):
    def read(*args, **kwargs):
        raise AssertionError("the input is read")

    monkeypatch.setattr(_files, "read_points", read)
    (tmp_path / "folder.laz").mkdir()
    target = tmp_path / name
    before = files_in(tmp_path)
    line = error_line(run("denoise", room_file, target))
    assert reason in line
    assert str(target) in line
    assert files_in(tmp_path) == before


@pytest.mark.parametrize("verb", [["denoise", "--mode", "mark"], *([one] for one in VERBS[1:])])
def test_e57_is_refused_where_it_cannot_hold_the_results(verb, room_file, tmp_path):
    line = error_line(run(*verb, room_file, tmp_path / "out.e57"))
    assert "out.e57: E57 has no place for" in line
    assert files_in(tmp_path) == ["room.laz"]


@pytest.mark.parametrize("verb", ["edges", "plane"])
def test_points_too_far_for_las_are_named_before_the_work(verb, room, tmp_path, monkeypatch):
    def work(*args, **kwargs):
        raise AssertionError("the long work began")

    monkeypatch.setattr(SharpFeatureDetector, "fit", work)
    monkeypatch.setattr(_plane.Plane, "tested", work)
    np.savetxt(tmp_path / "in.csv", np.r_[np.round(room.xyz, 3), [[1e10, 0, 0]]], delimiter=",")
    line = error_line(run(verb, tmp_path / "in.csv", tmp_path / "out.laz"))
    assert f"point {len(room) + 1} at (1e+10, 0, 0); remove them" in line
    assert files_in(tmp_path) == ["in.csv"]
