"""mcmd denoise: the detector's outliers, dropped or marked, and nothing else changed."""

import html

import numpy as np
import pytest

from benchmarks.simulators import make_lidar_turn
from commands import done, error_line, run
from sklearn_mcmd import MCMDOutlierDetector
from sklearn_mcmd.io import PointCloud, read_points, write_points
from sklearn_mcmd.io._classes import noise_classes
from sklearn_mcmd.outliers._lowest_points import LowestPoints


def rounded_plane():
    """A plane in steps coarser than its noise, 41 % of it off the middle one."""
    rng = np.random.default_rng(0)
    steps = 0.01 * np.round(rng.normal(0, 0.6, 300))
    return np.column_stack([rng.uniform(0, 1, (300, 2)), steps])


def expected_outliers(xyz, **params):
    return MCMDOutlierDetector(**{"random_state": 0, **params}).fit_predict(xyz) == -1


def test_drop_writes_exactly_the_points_the_detector_keeps_and_counts_the_others(
    room, room_file, tmp_path
):
    result = done("denoise", room_file, tmp_path / "out.laz")
    kept = ~expected_outliers(room.xyz)
    n = np.count_nonzero(~kept)
    assert 0 < n < 0.2 * len(kept)
    lines = [line.split() for line in result.stdout.splitlines()[1:]]
    assert lines[:2] == [["points", "930"], ["removed", str(n), f"({100 * n / 930:.2f}", "%)"]]
    assert (lines[2][0], result.stderr) == ("seconds", "")
    out = read_points(tmp_path / "out.laz")
    np.testing.assert_array_equal(out.attributes["intensity"], np.flatnonzero(kept))
    np.testing.assert_array_equal(out.xyz, read_points(room_file).xyz[kept])


def test_mark_keeps_all_points_and_gives_outliers_class_7_or_18_in_laz(room, room_file, tmp_path):
    done("denoise", room_file, tmp_path / "out.laz", "--mode", "mark")
    out = read_points(tmp_path / "out.laz")
    outlier = expected_outliers(room.xyz)
    used = np.ones(len(outlier), bool)
    classes = noise_classes(read_points(room_file), outlier, used, LowestPoints(len(used), 50))
    assert set(classes) == {0, 18}  # the room has no outliers under its floor
    np.testing.assert_array_equal(out.attributes["classification"], classes)
    np.testing.assert_array_equal(out.attributes["intensity"], np.arange(len(outlier)))


@pytest.fixture
def mixed(room):
    """The room, a plane in coarse steps, a thin post, and a ghost of twelve points in the air."""
    rng = np.random.default_rng(1)
    ghost = np.array([1, 6, 1]) + rng.normal(0, 0.05, (12, 3))
    post = np.column_stack([np.full((30, 2), 1.5), np.linspace(0.1, 1.5, 30)])
    return np.vstack([room.xyz, rounded_plane() + np.array([5, 0, 0]), post, ghost])


@pytest.mark.parametrize(
    ("options", "parameters"),
    [
        (
            ("--strictness", "paper", "--n-neighbors", 20, "--method", "mcmd_md"),
            {"strictness": None, "n_neighbors": 20, "method": "mcmd_md"},
        ),
        (
            ("--cutoff", 4, "--random-state", 3, "--max-outlier-rate", 0.2),
            {"cutoff": 4, "random_state": 3, "max_outlier_rate": 0.2},
        ),
        (("--false-positive-rate", 0.05), {"false_positive_rate": 0.05}),
        (("--strictness", "isolated"), {"strictness": "isolated"}),
        (("--contamination", 0.05), {"contamination": 0.05}),
        (
            ("--strictness", "surfaces", "--noise-scale", 0.002),
            {"strictness": "surfaces", "noise_scale": 0.002},
        ),
    ],
)
def test_what_is_judged_and_by_what_reaches_the_detector(options, parameters, mixed, tmp_path):
    np.save(tmp_path / "in.npy", mixed)
    done(*("denoise", tmp_path / "in.npy", tmp_path / "out.npy", "--mode", "mark", *options))
    marked = np.load(tmp_path / "out.npy")["outlier"]
    np.testing.assert_array_equal(marked, expected_outliers(mixed, **parameters))
    assert (marked != expected_outliers(mixed)).any()


# ---- where the sensor stood -----------------------------------------------------------------


@pytest.fixture
def turn(tmp_path):
    """A turn of a spinning sensor at the origin, in a file."""
    xyz = make_lidar_turn(4_000, random_state=0).data
    xyz = xyz[xyz.any(axis=1)]  # rays without a return are left out when they are read
    np.save(tmp_path / "turn.npy", xyz)
    return tmp_path / "turn.npy", xyz


def test_the_position_of_the_sensor_reaches_the_detector(turn, tmp_path):
    path, xyz = turn
    done("denoise", path, tmp_path / "out.npy", "--mode", "mark", "--sensor", "0,0,0")
    expected = MCMDOutlierDetector(sensor_origin="origin", random_state=0).fit(xyz).scores_
    scores = np.load(tmp_path / "out.npy")["outlier_score"]
    np.testing.assert_array_equal(scores, (-expected).astype(np.float32))
    plain = MCMDOutlierDetector(random_state=0).fit(xyz).scores_
    assert (plain != expected).any()


def test_a_turn_is_recognized_unless_that_is_refused(turn, tmp_path, small_machine):
    write_points(tmp_path / "in.las", np.round(turn[1], 3))
    tiles = ("--memory", "2MB", "--n-jobs", 1)
    clouds, told = {}, "sensor   0, 0, 0 (a turn about the origin)"
    for name, options in {
        "told": ("--sensor", "0,0,0"),
        "seen": (),
        "tiles": tiles,
        "not": ("--sensor", "none"),
        "paper": ("--strictness", "paper"),
    }.items():
        result = done("denoise", tmp_path / "in.las", tmp_path / f"{name}.las", *options)
        assert (told.split() in [line.split() for line in result.output.splitlines()]) == (
            name in ("seen", "tiles")
        )
        clouds[name] = (tmp_path / f"{name}.las").read_bytes()
    assert clouds["told"] == clouds["seen"] != clouds["not"]


def test_a_thinned_turn_says_how_to_tell_where_the_sensor_was(turn, tmp_path):
    """With one point in each cell of 2 m it has no even steps. Beside it nothing is said."""
    thinned = turn[1][np.unique(np.floor(turn[1] / 2), axis=0, return_index=True)[1]]
    for moved, options, said in (
        (0, (), True),
        (0, ("--sensor", "none"), False),
        (0, ("--sensor", "0,0,0"), False),
        ([15, 0, 0], (), False),
    ):
        np.save(tmp_path / "thinned.npy", thinned + np.array(moved))
        result = done("denoise", tmp_path / "thinned.npy", tmp_path / "out.npy", *options)
        assert ("no position is seen" in " ".join(result.stdout.split())) == said


def test_a_place_that_a_file_states_in_vain_is_told_and_one_that_is_typed_is_used(turn, tmp_path):
    pytest.importorskip("pypcd4")
    path, page = tmp_path / "in.pcd", tmp_path / "report" / "index.html"
    viewpoint = {"pcd_viewpoint": (9.0, 9.0, 1.0, 1.0, 0.0, 0.0, 0.0)}
    write_points(path, PointCloud(np.load(turn[0]) + 50.0, {}, viewpoint))
    for options, said in (
        ((), "sensor was at 9, 9, 1 (PCD's VIEWPOINT), but points do not look as if"),
        (("--sensor", "9,9,1"), "9, 9, 1 (given)"),
        (("--sensor", "9,9,1"), "outliers are so by rays alone"),
    ):
        result = done("denoise", path, tmp_path / "out.npy", *options, "--report", page.parent)
        for words in (result.stdout, html.unescape(page.read_text())):
            assert said in " ".join(words.split())


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--sensor", "auto"), "no position of the sensor is known"),
        (("--sensor", "0,0,0", "--strictness", "paper"), "--sensor has no meaning"),
        (("--trajectory", "missing.csv"), "missing.csv"),
    ],
)
def test_a_position_that_cannot_be_used_is_refused(turn, tmp_path, options, message):
    result = run("denoise", turn[0], tmp_path / "out.npy", *options)
    assert result.exit_code in (1, 2)
    assert message in " ".join(result.output.split())
    assert not (tmp_path / "out.npy").exists()


# ---- intensity ------------------------------------------------------------------------------


@pytest.mark.parametrize("rows", [slice(None), slice(900)])
def test_the_intensity_of_the_points_that_are_used_reaches_the_detector(rows, room, tmp_path):
    light = np.random.default_rng(0).integers(1, 9, len(room))
    classes = np.repeat([1, 2], [900, 30]).astype(np.uint8)
    cloud = PointCloud(room.xyz, {"intensity": light, "classification": classes})
    write_points(tmp_path / "in.npz", cloud)
    options = ("--intensity", "--mode", "mark", *(("--only-class", 1) if rows.stop else ()))
    done("denoise", tmp_path / "in.npz", tmp_path / "out.npz", *options)
    scores = read_points(tmp_path / "out.npz").attributes["outlier_score"][rows]
    detector = MCMDOutlierDetector(random_state=0)
    expected = -detector.fit(room.xyz[rows], intensity=light[rows]).scores_
    np.testing.assert_array_equal(scores, expected.astype(np.float32))


def test_intensity_that_is_not_there_or_has_no_use_is_refused(turn, room_file, tmp_path):
    line = error_line(run("denoise", turn[0], tmp_path / "out.npy", "--intensity"))
    assert "turn.npy: --intensity: the file has none" in line
    options = ("--intensity", "--strictness", "paper")
    line = error_line(run("denoise", room_file, tmp_path / "out.npy", *options))
    assert "--intensity has no meaning where each point is judged by one plane alone" in line
    assert not (tmp_path / "out.npy").exists()
