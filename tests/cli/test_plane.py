"""mcmd plane: what it writes, what it refuses, and that nothing is lost."""

import re

import numpy as np
import pytest

from commands import done, error_line, files_in, run, usage_error
from sklearn_mcmd.adjustment import BaardaPlaneDetector, FuzzyPlaneDetector, scan_weights
from sklearn_mcmd.io import PointCloud, read_points, write_points

N, N_OUTLIERS = 600, 60


@pytest.fixture
def wall():
    """A wall at map coordinates, a tenth of it at one edge bulging by 8 to 30 sigma."""
    rng = np.random.default_rng(0)
    u, v = np.sort(rng.uniform(0, 6, N))[::-1], rng.uniform(0, 3, N)
    off = rng.normal(0, 0.004, N)
    off[:N_OUTLIERS] += rng.uniform(0.032, 0.12, N_OUTLIERS)
    along, out = np.array([0.8, 0.6, 0.0]), np.array([0.6, -0.8, 0.0])
    xyz = np.outer(u, along) + np.outer(v, [0, 0, 1]) + np.outer(off, out)
    return PointCloud(np.round(xyz + np.array([512345, 5403210, 212]), 4), {"row": np.arange(N)})


@pytest.fixture
def wall_file(tmp_path, wall):
    path = tmp_path / "wall.laz"
    write_points(path, wall)
    return path


@pytest.fixture(autouse=True)
def _matplotlib():
    pytest.importorskip("matplotlib")


def test_outliers_of_a_wall_become_noise_and_all_points_stay(wall_file, tmp_path):
    done("plane", wall_file, tmp_path / "out.laz")
    out = read_points(tmp_path / "out.laz")
    np.testing.assert_array_equal(np.flatnonzero(out.attributes["classification"] == 7), range(60))
    np.testing.assert_array_equal(out.attributes["row"], np.arange(N))
    np.testing.assert_array_equal(out.xyz, read_points(wall_file).xyz)
    assert files_in(tmp_path) == ["out.laz", "wall.laz"]


@pytest.mark.parametrize(
    ("options", "detector"),
    [
        (
            (
                *("--test", "t", "--alpha", 0.2, "--correction", "none"),
                *("--elimination", "all", "--no-robust-start"),
            ),
            BaardaPlaneDetector(
                0.2,
                test="t",
                correction="none",
                elimination="all",
                surface="orthogonal",
                sigma0="auto",
            ),
        ),
        (
            ("--toward", "512345,5404000,212", "--no-robust-start"),
            BaardaPlaneDetector(surface="orthogonal", sigma0="auto", toward=[512345, 5404000, 212]),
        ),
        (
            ("--method", "fuzzy", "--sigma0", 0.004),
            FuzzyPlaneDetector(sigma0=0.004, surface="orthogonal"),
        ),
    ],
)
def test_what_is_written_is_the_detectors_with_these_options(
    options, detector, wall_file, tmp_path
):
    done("plane", wall_file, tmp_path / "out.npz", *options)
    out, xyz = read_points(tmp_path / "out.npz").attributes, read_points(wall_file).xyz
    is_outlier = detector.fit(xyz).labels_ == -1
    assert 0 < np.count_nonzero(is_outlier) < N
    np.testing.assert_array_equal(out["outlier"].astype(bool), is_outlier)
    np.testing.assert_array_equal(out["test_statistic"], detector.test_statistic_.astype("f4"))
    np.testing.assert_array_equal(out["residual"], detector.residuals(xyz).astype("f4"))


@pytest.mark.parametrize(
    ("args", "words"),
    [
        (("b.laz", "--method", "fuzzy", "--elimination", "all"), "--elimination"),
        (("b.laz", "--method", "fuzzy", "--robust-start"), "--robust-start"),
        (("--report", "r"), "is missing, which --report needs"),
    ],
)
def test_options_that_do_not_go_together_are_wrong_usage(args, words):
    assert words in usage_error(run("plane", "a.laz", *args))


def test_fuzzy_that_leaves_no_point_says_so_and_gives_no_nan(tmp_path):
    xyz = np.random.default_rng(0).uniform(size=(400, 3)) * [1, 1, 0]
    xyz[3, 2] = 0.5  # off an exact plane: sigma0 is that of the robust plane, rounding
    write_points(tmp_path / "flat.npz", PointCloud(xyz))
    out, page = tmp_path / "out.npz", tmp_path / "report"
    result = run("plane", tmp_path / "flat.npz", out, "--method", "fuzzy", "--report", page)
    assert "The tests reject 400 of 400 points" in result.stderr
    assert "without outliers none" in result.stdout
    for text in (result.stdout, (page / "index.html").read_text()):
        assert not re.search(r"\bnan\b", text)


def test_a_rejected_global_test_is_said_on_the_terminal_and_in_the_report(wall_file, tmp_path):
    options = ("--sigma0", 0.002, "--unit", "m", "--report", tmp_path / "report")
    result = run("plane", wall_file, tmp_path / "out.laz", *options)
    assert re.search(
        "warning: the global test rejects this plane .p = .*--sigma0 0.002", result.stderr
    )
    assert re.search(
        r"global test +p = \S+ with all points, \S+ without outliers; rejected", result.stdout
    )
    page = (tmp_path / "report" / "index.html").read_text()
    assert page.count("the global test rejects this plane") == 1
    assert "global test" not in done("plane", wall_file, "--sigma0", 0.004).stderr


ALONG = np.outer(np.linspace(0, 10, 500), [0.3, 0.4, 0.2])
ALONG += np.array([512345, 5403210, 212])
NO_PLANES = {  # the detectors' own errors are in tests/adjustment
    "a line": (ALONG, "points of the cloud lie on one line"),
    "a line in millimeters": (np.round(ALONG, 3), "determine no plane"),
    "a box": (np.random.default_rng(0).uniform(0, 1, (500, 3)), "determine no plane"),
}


@pytest.mark.parametrize("kind", NO_PLANES)
def test_points_that_determine_no_plane_are_refused(kind, tmp_path):
    xyz, words = NO_PLANES[kind]
    write_points(tmp_path / "a.npy", PointCloud(xyz))
    line = error_line(run("plane", tmp_path / "a.npy", tmp_path / "out.csv"))
    assert words in line
    assert line.count("a.npy: ") == 1
    assert files_in(tmp_path) == ["a.npy"]


def test_the_files_of_a_folder_are_tested_as_one_plane(wall, wall_file, tmp_path):
    folder = tmp_path / "parts"
    folder.mkdir()
    for i, name in enumerate(("a.las", "b.laz")):
        write_points(folder / name, wall.subset(slice(i * N // 2, (i + 1) * N // 2)))
    run("plane", wall_file, tmp_path / "whole.laz")
    done("plane", folder, tmp_path / "joined.laz")
    whole, joined = (
        read_points(tmp_path / f"{name}.laz").attributes for name in ("whole", "joined")
    )
    for name, values in whole.items():
        np.testing.assert_array_equal(joined[name], values)


def moved(path, wall, shift):
    cloud = PointCloud(np.round(wall.xyz + shift * np.array([0.6, -0.8, 0.0]), 4))
    write_points(path, cloud)
    return path


def test_another_wall_is_compared(wall, wall_file, tmp_path):
    other = moved(tmp_path / "later.laz", wall, 0.02)
    result = done("plane", wall_file, tmp_path / "out.laz", "--against", other, "--unit", "m")
    assert re.search(r"against +moved\n", result.stdout)
    offset = re.search(r"offset +(\S+) ± (\S+) m along the normal \(significant", result.stdout)
    assert abs(abs(float(offset[1])) - 0.02) < 0.001  # both have the same noise
    same = run("plane", wall_file, "--against", wall_file)
    assert re.search(r"against +same\n", same.stdout)
    told = "--against", other, "--registration", "30mm", "--unit", "m"
    unsure = run("plane", wall_file, *told).stdout
    assert re.search(r"against +same\n", unsure)
    assert re.search(r"registration +± 0.03 m are in both errors\n", unsure)
    assert "name the other by --against" in usage_error(run("plane", wall_file, *told[2:]))
    line = error_line(run("plane", wall_file, "--against", tmp_path / "nix.laz"))
    assert "nix.laz: no such file" in line


def test_a_folder_to_compare_with_is_one_wall_in_one_coordinate_system(wall, wall_file, tmp_path):
    laspy, folder = pytest.importorskip("laspy"), tmp_path / "later"
    folder.mkdir()
    for name in ("west.laz", "east.laz"):
        moved(folder / name, wall, 0.02)
    assert re.search(r"against +moved\n", done("plane", wall_file, "--against", folder).stdout)
    las = laspy.read(folder / "east.laz")
    wkt = 'LOCAL_CS["site",UNIT["metre",1]]'
    las.header.vlrs.append(laspy.vlrs.known.WktCoordinateSystemVlr(wkt))
    las.write(folder / "east.laz")
    assert "no system" in error_line(run("plane", wall_file, "--against", folder))


def test_without_an_output_the_summary_is_that_of_one_and_nothing_is_written(wall_file, tmp_path):
    told = done("plane", wall_file, "--sigma0", 0.004)
    assert files_in(tmp_path) == ["wall.laz"]
    written = run("plane", wall_file, tmp_path / "out.laz", "--sigma0", 0.004)
    # The first line names the files, and the last has the seconds.
    assert told.stdout.splitlines()[1:-1] == written.stdout.splitlines()[1:-1]


@pytest.mark.parametrize(("share", "is_asked"), [(0.18, False), (0.22, True), (0.45, True)])
def test_a_fifth_of_outliers_raises_the_question_whether_it_is_one_plane(share, is_asked, tmp_path):
    rng, n = np.random.default_rng(0), 1000
    xyz = np.c_[4 * rng.random((n, 2)), np.zeros(n)] + rng.normal(0, 0.003, (n, 3))
    n_wall = int(share * n)
    xyz[:n_wall] = xyz[:n_wall, [0, 2, 1]] + [0, 0, 0.1]
    np.save(tmp_path / "a.npy", xyz)
    said = done("plane", tmp_path / "a.npy").stderr
    words = r"[24]\d\.\d % of the 1,000 points are outliers: is it one plane\?.*mcmd segment"
    assert bool(re.search(words, said)) == is_asked


def test_weights_from_a_station_are_those_of_the_instrument_and_told_by_range(tmp_path):
    rng, station = np.random.default_rng(0), np.array([-3.0, -2.0, 1.2])
    xyz = rng.uniform((0, 0, 0), (4, 0, 2.5), (2_000, 3))
    ranges = np.linalg.norm(xyz - station, axis=1)
    cosine = 2 / ranges
    precise = np.hypot(0.002 * cosine, np.radians(0.03) * ranges * np.sqrt(1 - cosine**2))
    xyz[:, 1] += rng.normal(0, precise)
    np.save(tmp_path / "a.npy", xyz)
    options = ("plane", tmp_path / "a.npy", "--unit", "m", "--weights-from=-3,-2,1.2")
    told = done(*options, "--range-error", "2mm", "--angle-error", "0.03").stdout
    assert re.search(r"instrument +[34] of 4 ranges", told)
    wrong = done(*options, "--range-error", "2mm", "--angle-error", "0.3").stdout
    assert re.search(r"instrument +[01] of 4 ranges", wrong)
    weights = scan_weights(xyz, station, range_error=0.002, angle_error=0.03).weights
    settings = {"sigma0": "auto", "surface": "orthogonal", "robust_start": True}
    fitted = BaardaPlaneDetector(**settings, random_state=0).fit(xyz, weights=weights)
    assert f"{fitted.sigma0_:.4g} m (estimated)" in told
    assert "is missing: weights of a scan take a position and both" in usage_error(run(*options))
    alone = run("plane", tmp_path / "a.npy", "--range-ppm", "10")
    assert "weights of a scan take a position" in usage_error(alone)
