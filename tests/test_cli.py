"""The mcmd command: verbs, exit codes, one clear line for every error, whole files or none."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from sklearn_mcmd import MCMDOutlierDetector, RobustNormalEstimator, __version__
from sklearn_mcmd.cli import _denoise, _normals, app
from sklearn_mcmd.io import PointCloud, read_points, write_points

N_ROOM, N_STRAY = 900, 30  # few enough for the form that needs no compilation


@pytest.fixture
def room():
    """A floor and a wall with stray points in the air, and their labels."""
    rng = np.random.default_rng(0)
    floor = rng.uniform(0, 2, (N_ROOM // 2, 3)) * [1, 1, 0]
    wall = rng.uniform(0, 2, (N_ROOM // 2, 3)) * [1, 0, 1] + [0, 2, 0]
    stray = rng.uniform(0.3, 1.7, (N_STRAY, 3))
    surfaces = np.vstack([floor, wall]) + rng.normal(0, 0.003, (N_ROOM, 3))
    xyz = np.round(np.vstack([surfaces, stray]), 4)
    return PointCloud(xyz, {"intensity": np.arange(len(xyz), dtype=np.uint16)})


def rounded_plane():
    """A plane in steps coarser than its noise, 41 % of it off the middle one."""
    rng = np.random.default_rng(0)
    steps = 0.01 * np.round(rng.normal(0, 0.6, 300))
    return np.column_stack([rng.uniform(0, 1, (300, 2)), steps])


@pytest.fixture
def room_file(tmp_path, room):
    path = tmp_path / "room.laz"
    write_points(path, room)
    return path


def run(*args):
    """The outcome of a command, streams apart."""
    return CliRunner().invoke(app, [str(a) for a in args], prog_name="mcmd")


def error_line(result, code=1):
    """The one line on stderr of a command that failed as users' errors should."""
    assert result.exit_code == code, result.output
    assert result.stdout == ""
    lines = result.stderr.splitlines()
    assert len(lines) == 1
    assert lines[0].startswith("mcmd: error: ")
    return lines[0]


def files_in(folder):
    return sorted(p.name for p in folder.iterdir())


def expected_outliers(xyz, **params):
    return MCMDOutlierDetector(random_state=0, **params).fit_predict(xyz) == -1


# ---- mcmd denoise ---------------------------------------------------------------------------


def test_drop_writes_exactly_the_points_the_detector_keeps(room, room_file, tmp_path):
    result = run("denoise", room_file, tmp_path / "out.laz")
    assert result.exit_code == 0, result.output
    kept = ~expected_outliers(room.xyz)
    assert 0 < np.count_nonzero(~kept) < 0.2 * len(kept)
    out = read_points(tmp_path / "out.laz")
    np.testing.assert_array_equal(out.attributes["intensity"], np.flatnonzero(kept))
    np.testing.assert_array_equal(out.xyz, read_points(room_file).xyz[kept])


def test_mark_keeps_all_points_and_gives_outliers_class_7_in_laz(room, room_file, tmp_path):
    assert run("denoise", room_file, tmp_path / "out.laz", "--mode", "mark").exit_code == 0
    out = read_points(tmp_path / "out.laz")
    outlier = expected_outliers(room.xyz)
    np.testing.assert_array_equal(out.attributes["classification"], np.where(outlier, 7, 0))
    np.testing.assert_array_equal(out.attributes["intensity"], np.arange(len(outlier)))


@pytest.mark.parametrize("extension", ["csv", "npz", "pcd", "ply"])
def test_mark_writes_an_outlier_column_in_other_formats(extension, room, room_file, tmp_path):
    path = tmp_path / f"out.{extension}"
    if extension in ("pcd", "ply"):
        pytest.importorskip({"pcd": "pypcd4", "ply": "plyfile"}[extension])
    assert run("denoise", room_file, path, "--mode", "mark").exit_code == 0
    marked = read_points(path).attributes["outlier"].astype(bool)
    np.testing.assert_array_equal(marked, expected_outliers(room.xyz))


def test_marked_points_carry_their_robust_distance_as_float32(room, room_file, tmp_path):
    run("denoise", room_file, tmp_path / "out.laz", "--mode", "mark")
    score = read_points(tmp_path / "out.laz").attributes["outlier_score"]
    detector = MCMDOutlierDetector(random_state=0).fit(room.xyz)
    assert score.dtype == np.float32
    # Coordinates went through integers of 0.1 mm, which moves their last bits only.
    np.testing.assert_allclose(score, -detector.score_samples(room.xyz), rtol=1e-5, atol=1e-5)


def test_options_of_denoise_reach_the_detector(room, room_file, tmp_path):
    result = run(
        *("denoise", room_file, tmp_path / "out.npy", "--mode", "mark", "--n-neighbors", 20),
        *("--method", "mcmd_md", "--cutoff", 4, "--outlier-rate", 0.2, "--random-state", 3),
        *("--n-jobs", 1),
    )
    assert result.exit_code == 0, result.output
    detector = MCMDOutlierDetector(20, method="mcmd_md", cutoff=4, outlier_rate=0.2, random_state=3)
    marked = np.load(tmp_path / "out.npy")["outlier"]
    np.testing.assert_array_equal(marked, detector.fit_predict(room.xyz) == -1)


@pytest.mark.parametrize(
    ("options", "parameters"),
    [
        (("--noise-scale", "own"), {"noise_scale": "own"}),
        (("--noise-scale", "pooled"), {"noise_scale": "pooled"}),
        (("--noise-scale", 0.02), {"noise_scale": 0.02}),
        (("--max-iter", 1), {"max_iter": 1}),
        (("--no-borrow",), {"borrow": False}),
        (("--drop-groups",), {"keep_groups": False}),
        (("--noise-scale", 0.002, "--keep-groups"), {"noise_scale": 0.002, "keep_groups": True}),
    ],
)
def test_rulers_passes_and_groups_reach_the_detector(options, parameters, room, tmp_path):
    xyz = np.vstack([room.xyz, rounded_plane() + np.array([5, 0, 0])])
    np.save(tmp_path / "in.npy", xyz)
    result = run(
        *("denoise", tmp_path / "in.npy", tmp_path / "out.npy", "--mode", "mark", *options)
    )
    assert result.exit_code == 0, result.output
    marked = np.load(tmp_path / "out.npy")["outlier"]
    np.testing.assert_array_equal(marked, expected_outliers(xyz, **parameters))
    for left_out in parameters:  # each made a difference
        others = {name: value for name, value in parameters.items() if name != left_out}
        assert (marked != expected_outliers(xyz, **others)).any()


@pytest.mark.parametrize("value", ["lokal", "-0.01", "0", "nan", "inf"])
def test_a_noise_scale_that_is_no_word_and_no_positive_number_is_wrong_usage(
    value, room_file, tmp_path
):
    result = run("denoise", room_file, tmp_path / "out.laz", "--noise-scale", value)
    assert result.exit_code == 2
    assert "--noise-scale" in result.stderr
    assert files_in(tmp_path) == ["room.laz"]


def test_the_summary_states_points_share_removed_and_seconds(room, room_file, tmp_path):
    result = run("denoise", room_file, tmp_path / "out.laz")
    n = int(expected_outliers(room.xyz).sum())
    lines = [line.split() for line in result.stdout.splitlines()[1:]]
    assert lines[0] == ["points", "930"]
    assert lines[1] == ["removed", str(n), f"({100 * n / 930:.2f}", "%)"]
    assert lines[2][0] == "seconds"
    assert float(lines[2][1]) >= 0
    assert result.stderr == ""


def test_quiet_prints_nothing(room_file, tmp_path):
    result = run("denoise", room_file, tmp_path / "out.laz", "--quiet")
    assert (result.exit_code, result.output) == (0, "")


@pytest.mark.parametrize("verb", ["denoise", "normals"])
def test_output_may_replace_the_input(verb, room_file, tmp_path):
    assert run(verb, room_file, tmp_path / "apart.laz").exit_code == 0
    assert run(verb, room_file, room_file).exit_code == 0
    apart, in_place = read_points(tmp_path / "apart.laz"), read_points(room_file)
    assert apart.attributes.keys() == in_place.attributes.keys()
    np.testing.assert_array_equal(apart.xyz, in_place.xyz)


@pytest.mark.parametrize("verb", ["denoise", "normals"])
def test_the_same_seed_gives_the_same_bytes_on_any_number_of_threads(verb, room_file, tmp_path):
    for name, n_jobs in (("a", 1), ("b", 2)):
        run(verb, room_file, tmp_path / f"{name}.csv", "--n-jobs", n_jobs)
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()


def test_few_points_give_one_warning_line_and_an_answer(room, tmp_path):
    write_points(tmp_path / "few.csv", room.subset(slice(0, 30)))
    result = run("denoise", tmp_path / "few.csv", tmp_path / "out.csv")
    assert result.exit_code == 0
    assert result.stderr == (
        "mcmd: warning: n_neighbors=50 is more than the number of distinct points, 30 of "
        "n_samples=30: neighborhoods of all of them are used.\n"
    )


def test_points_without_finite_coordinates_are_counted_in_a_warning(room, tmp_path):
    rows = "".join(f"{x} {y} {z}\n" for x, y, z in room.xyz)
    (tmp_path / "holes.xyz").write_text(rows + "nan 0 0\n0 inf 0\n")
    result = run("denoise", tmp_path / "holes.xyz", tmp_path / "out.xyz")
    assert result.exit_code == 0
    assert "2 points without finite coordinates are left out" in result.stderr
    assert len(result.stderr.splitlines()) == 1


def test_the_default_keeps_a_plane_in_steps_coarser_than_its_noise(tmp_path):
    write_points(tmp_path / "rounded.csv", rounded_plane())
    result = run("denoise", tmp_path / "rounded.csv", tmp_path / "out.csv")
    assert (result.exit_code, result.stderr) == (0, "")
    assert len(read_points(tmp_path / "out.csv")) > 0.95 * 300


@pytest.mark.parametrize("option", [("--noise-scale", "own"), ("--drop-groups",)])
def test_exact_planes_are_warned_about_where_they_make_outliers(option, tmp_path):
    write_points(tmp_path / "rounded.csv", rounded_plane())
    result = run("denoise", tmp_path / "rounded.csv", tmp_path / "out.csv", *option)
    assert result.exit_code == 0
    assert "lie exactly in one plane" in result.stderr
    assert len(result.stderr.splitlines()) == 1


# ---- mcmd normals ---------------------------------------------------------------------------


def test_normals_adds_the_estimators_results_as_float32(room, room_file, tmp_path):
    result = run("normals", room_file, tmp_path / "out.laz")
    assert result.exit_code == 0, result.output
    out = read_points(tmp_path / "out.laz").attributes
    fitted = RobustNormalEstimator(random_state=0).fit(read_points(room_file).xyz)
    expected = {
        "surface_variation": fitted.surface_variation_,
        "removed_fraction": fitted.removed_fraction_,
        **{f"normal_{a}": fitted.normals_[:, i] for i, a in enumerate("xyz")},
        **{f"eigenvalue_{i}": fitted.eigenvalues_[:, i] for i in range(3)},
    }
    for name, values in expected.items():
        assert out[name].dtype == np.float32
        np.testing.assert_array_equal(out[name], values.astype(np.float32))
    np.testing.assert_array_equal(out["intensity"], np.arange(len(room)))


def test_normals_look_at_the_viewpoint_also_at_negative_coordinates(room_file, tmp_path):
    result = run(
        *("normals", room_file, tmp_path / "out.npy"),
        *("--orientation", "viewpoint", "--viewpoint", "-1,0.5,-9"),
    )
    assert result.exit_code == 0, result.output
    out = np.load(tmp_path / "out.npy")
    to_viewpoint = np.array([-1, 0.5, -9]) - np.column_stack([out[a] for a in "xyz"])
    normals = np.column_stack([out[f"normal_{a}"] for a in "xyz"])
    assert (np.einsum("ij,ij->i", normals, to_viewpoint) >= -1e-5).all()


@pytest.mark.parametrize("orientation", ["none", "up", "mst"])
def test_every_orientation_gives_unit_normals(orientation, room_file, tmp_path):
    result = run("normals", room_file, tmp_path / "out.npy", "--orientation", orientation)
    assert result.exit_code == 0, result.output
    out = np.load(tmp_path / "out.npy")
    length = np.sqrt(sum(out[f"normal_{a}"].astype(float) ** 2 for a in "xyz"))
    np.testing.assert_allclose(length, 1.0, atol=1e-6)
    if orientation != "mst":
        assert (out["normal_z"] >= 0).all()


def test_a_radius_makes_normals_more_local(room, room_file, tmp_path):
    assert run("normals", room_file, tmp_path / "out.npy", "--radius", 0.15).exit_code == 0
    fitted = RobustNormalEstimator(radius=0.15, random_state=0).fit(room.xyz)
    out = np.load(tmp_path / "out.npy")
    np.testing.assert_array_equal(out["removed_fraction"], fitted.removed_fraction_.astype("f4"))


def test_normals_of_the_input_are_replaced_with_a_warning(room, tmp_path):
    stale = np.tile([9.0, 9.0, 9.0], (len(room), 1))
    write_points(tmp_path / "in.npz", room.with_attributes(normals=stale))
    result = run("normals", tmp_path / "in.npz", tmp_path / "out.laz")
    assert result.exit_code == 0, result.output
    assert result.stderr == "mcmd: warning: the results replace what the input calls normals\n"
    assert (read_points(tmp_path / "out.laz").attributes["normal_x"] <= 1).all()


@pytest.mark.parametrize(
    "options",
    [
        ["--orientation", "viewpoint"],
        ["--viewpoint", "1,2,3"],
        ["--orientation", "viewpoint", "--viewpoint", "1,2"],
        ["--orientation", "viewpoint", "--viewpoint", "1,2,here"],
        ["--orientation", "viewpoint", "--viewpoint", "1,2,nan"],
        ["--orientation", "down"],
    ],
)
def test_a_wrong_viewpoint_is_wrong_usage(options, room_file, tmp_path):
    result = run("normals", room_file, tmp_path / "out.laz", *options)
    assert result.exit_code == 2
    assert "viewpoint" in result.stderr
    assert files_in(tmp_path) == ["room.laz"]


def test_features_are_written_as_float32_attributes(room, room_file, tmp_path):
    names = ["roughness", "planarity", "normal_error"]
    result = run("normals", room_file, tmp_path / "out.laz", "--features", ",".join(names))
    assert result.exit_code == 0, result.output
    out = read_points(tmp_path / "out.laz").attributes
    fitted = RobustNormalEstimator(features=names, random_state=0).fit(room.xyz)
    for name, values in zip(names, fitted.features_.T, strict=True):
        assert out[name].dtype == np.float32
        np.testing.assert_allclose(out[name], values, rtol=1e-4, atol=1e-6)


def test_all_features_are_written_where_asked_for(room_file, tmp_path):
    assert run("normals", room_file, tmp_path / "out.npy", "--features", "all").exit_code == 0
    names = np.load(tmp_path / "out.npy").dtype.names
    assert {"linearity", "eigenentropy", "normal_error"} < set(names)
    assert names.count("removed_fraction") == 1


def test_an_unknown_feature_is_wrong_usage(room_file, tmp_path):
    result = run("normals", room_file, tmp_path / "out.laz", "--features", "planarity,flatness")
    assert result.exit_code == 2
    assert "flatness" in result.stderr
    assert files_in(tmp_path) == ["room.laz"]


# ---- mcmd info, --version, --help -----------------------------------------------------------


def test_info_counts_points_and_duplicates_and_shows_bounds(tmp_path):
    grid = np.stack(np.meshgrid(range(4), range(5), [7.0]), axis=-1).reshape(-1, 3)
    write_points(tmp_path / "grid.csv", PointCloud(np.vstack([grid, grid[:2]])))
    result = run("info", tmp_path / "grid.csv")
    assert result.exit_code == 0
    rows = dict(line.split(maxsplit=1) for line in result.stdout.splitlines()[1:])
    assert rows["format"] == "CSV"
    assert rows["points"] == "22"
    assert rows["duplicates"] == "2 (9.09 %)"
    assert rows["spacing"].startswith("1 ")
    assert rows["y"].startswith("0.00000 to 4.00000 ")


def test_info_shows_ranges_of_attributes_and_gathers_the_constant(room, tmp_path):
    values = {"ones": np.ones(len(room)), "half": np.where(room.xyz[:, 0] > 1, np.nan, 1.5)}
    write_points(tmp_path / "room.npz", room.with_attributes(**values))
    out = run("info", tmp_path / "room.npz").stdout
    assert "uint16, 0 to 929" in out
    assert "float64, 1.5 to 1.5, some NaN" in out
    assert "ones 1" in out.split("constant")[1]


def test_info_names_the_coordinate_system_of_a_las_file(room, tmp_path):
    laspy = pytest.importorskip("laspy")
    from laspy.vlrs.known import WktCoordinateSystemVlr

    las = laspy.create(point_format=6, file_version="1.4")
    las.x, las.y, las.z = room.xyz.T
    las.header.vlrs.append(WktCoordinateSystemVlr('PROJCS["Amersfoort / RD New",GEOGCS["x"]]'))
    las.write(tmp_path / "crs.las")
    assert "Amersfoort / RD New\n" in run("info", tmp_path / "crs.las").stdout


def test_info_works_on_a_single_point(tmp_path):
    (tmp_path / "one.xyz").write_text("1 2 3\n")
    result = run("info", tmp_path / "one.xyz")
    assert result.exit_code == 0, result.output
    assert "spacing" not in result.stdout


def test_version_is_printed(tmp_path):
    result = run("--version")
    assert (result.exit_code, result.stdout) == (0, f"mcmd {__version__}\n")


@pytest.mark.parametrize("verb", ["denoise", "normals", "segment", "info", "demo"])
def test_every_verb_has_help(verb):
    result = run(verb, "--help")
    assert result.exit_code == 0
    assert "Usage: mcmd" in result.stdout


# ---- bad input: exit code 1, one line, nothing written --------------------------------------


def bad_input(kind, folder):
    path = folder / "bad.xyz"
    if kind == "missing":
        return path
    if kind == "folder":
        path.mkdir()
    elif kind == "truncated laz":
        rng = np.random.default_rng(0)
        write_points(folder / "bad.laz", rng.uniform(size=(5000, 3)))
        path = folder / "bad.laz"
        path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    else:
        text = {
            "empty": "",
            "only nan": "nan nan nan\n" * 9,
            "two columns": "1 2\n3 4\n",
            "words": "x y z\none two three\n",
            "three points": "0 0 0\n1 0 0\n0 1 0\n",
        }
        path.write_text(text[kind])
    return path


@pytest.mark.parametrize(
    ("kind", "reason"),
    [
        ("missing", "no such file"),
        ("folder", "is a folder"),
        ("truncated laz", "cannot be read"),
        ("empty", "is empty"),
        ("only nan", "holds no points with finite coordinates"),
        ("two columns", "2 column"),
        ("words", "'one' is not a number"),
        ("three points", "n_samples=3 is too few"),
    ],
)
@pytest.mark.parametrize("verb", ["denoise", "normals"])
def test_bad_input_fails_with_one_line_and_writes_nothing(verb, kind, reason, tmp_path):
    path = bad_input(kind, tmp_path)
    before = files_in(tmp_path)
    assert reason in error_line(run(verb, path, tmp_path / "out.laz"))
    assert files_in(tmp_path) == before


@pytest.mark.parametrize("kind", ["missing", "folder", "truncated laz", "empty", "words"])
def test_info_fails_on_bad_input_with_one_line(kind, tmp_path):
    error_line(run("info", bad_input(kind, tmp_path)))


@pytest.mark.parametrize("option", [("--n-neighbors", 3), ("--outlier-rate", 1), ("--mode", "x")])
def test_options_out_of_range_are_wrong_usage(option, room_file, tmp_path):
    result = run("denoise", room_file, tmp_path / "out.laz", *option)
    assert result.exit_code == 2
    assert option[0] in result.stderr
    assert files_in(tmp_path) == ["room.laz"]


def bad_output(kind, folder):
    if kind == "no extension":
        return folder / "out"
    if kind == "unknown extension":
        return folder / "out.docx"
    if kind == "copc":
        return folder / "out.copc.laz"
    if kind == "missing folder":
        return folder / "nowhere" / "out.laz"
    if kind == "file as folder":
        return folder / "room.laz" / "out.laz"
    (folder / "out.laz").mkdir()
    return folder / "out.laz"


@pytest.mark.parametrize(
    ("kind", "reason"),
    [
        ("no extension", "no extension"),
        ("unknown extension", "unknown extension '.docx'"),
        ("copc", "COPC can be read but not written"),
        ("missing folder", "does not exist"),
        ("file as folder", "does not exist"),
        ("a folder", "is a folder"),
    ],
)
@pytest.mark.parametrize("verb", ["denoise", "normals"])
def test_an_output_that_cannot_be_is_refused_before_the_work(
    verb, kind, reason, room_file, tmp_path, monkeypatch
):
    def work(*args, **kwargs):
        raise AssertionError("the long work began")

    monkeypatch.setattr(_denoise, "_find_outliers", work)
    monkeypatch.setattr(_normals, "_find_normals", work)
    target = bad_output(kind, tmp_path)
    before = files_in(tmp_path)
    line = error_line(run(verb, room_file, target))
    assert reason in line
    assert str(target) in line
    assert files_in(tmp_path) == before


def test_an_attribute_the_output_cannot_hold_is_refused_before_the_work(
    room, tmp_path, monkeypatch
):
    write_points(tmp_path / "in.npz", room.with_attributes(**{"a" * 40: np.ones(len(room))}))
    monkeypatch.setattr(_denoise, "_find_outliers", None)  # calling it would be a TypeError
    line = error_line(run("denoise", tmp_path / "in.npz", tmp_path / "out.laz"))
    assert "longer than the 32 bytes" in line
    assert str(tmp_path / "out.laz") in line


def test_e57_is_refused_where_it_cannot_hold_the_results(room_file, tmp_path):
    assert "normals" in error_line(run("normals", room_file, tmp_path / "out.e57"))
    pytest.importorskip("pye57")
    mark = run("denoise", room_file, tmp_path / "out.e57", "--mode", "mark")
    assert "no place to mark outliers" in error_line(mark)
    assert files_in(tmp_path) == ["room.laz"]


@pytest.mark.parametrize(
    ("error", "code", "text"),
    [
        (MemoryError(), 1, "not enough memory"),
        (KeyboardInterrupt(), 130, "interrupted"),
    ],
)
def test_memory_and_interrupts_end_in_one_line_and_keep_the_old_file(
    error, code, text, room_file, monkeypatch
):
    def fail(*args, **kwargs):
        raise error

    before = room_file.read_bytes()
    monkeypatch.setattr(_denoise, "_find_outliers", fail)
    assert text in error_line(run("denoise", room_file, room_file), code)
    assert room_file.read_bytes() == before
    assert files_in(room_file.parent) == ["room.laz"]


def test_an_error_of_the_program_itself_is_not_hidden(room_file, tmp_path, monkeypatch):
    monkeypatch.setattr(_denoise, "_find_outliers", lambda *args, **kwargs: 1 / 0)
    result = run("denoise", room_file, tmp_path / "out.laz")
    assert isinstance(result.exception, ZeroDivisionError)


# ---- as a program ---------------------------------------------------------------------------


def program(*args, code=None):
    command = [sys.executable, *(["-c", code] if code else ["-m", "sklearn_mcmd"])]
    return subprocess.run(
        [*command, *map(str, args)],
        capture_output=True,
        text=True,
        cwd=Path(__file__).parents[1],
        timeout=120,
    )


def test_the_module_runs_as_a_program_and_exits_with_the_verbs_code(room_file, tmp_path):
    done = program("denoise", room_file, tmp_path / "out.laz", "--n-jobs", 1)
    assert (done.returncode, done.stderr) == (0, "")
    failed = program("info", tmp_path / "none.laz")
    assert failed.returncode == 1
    assert failed.stderr == f"mcmd: error: {tmp_path / 'none.laz'}: no such file\n"


@pytest.mark.parametrize("library", ["typer", "rich"])
def test_without_its_libraries_the_command_names_the_extra(library):
    done = program(
        code=f"import sys; sys.modules[{library!r}] = None\n"
        "from sklearn_mcmd.__main__ import main; main()"
    )
    assert done.returncode == 1
    assert done.stdout == ""
    assert len(done.stderr.splitlines()) == 1
    assert 'pip install "sklearn-mcmd[cli]"' in done.stderr


def test_help_loads_no_library_that_it_does_not_need():
    done = program(
        code="import sys, sklearn_mcmd.cli\n"
        "print([m for m in ('matplotlib', 'numba', 'laspy') if m in sys.modules])"
    )
    assert done.stdout == "[]\n", done.stderr


@pytest.mark.parametrize("option", ["--radius", "--cutoff"])
@pytest.mark.parametrize("value", ["0", "-1", "nan"])
def test_numbers_that_must_be_positive_are_wrong_usage(tmp_path, option, value):
    result = run("normals", tmp_path / "in.xyz", tmp_path / "out.xyz", option, value)
    assert result.exit_code == 2
    assert option in result.stderr


def test_zero_threads_are_wrong_usage(tmp_path):
    result = run("denoise", tmp_path / "in.xyz", tmp_path / "out.xyz", "--n-jobs", "0")
    assert result.exit_code == 2


def test_single_precision_files_at_national_grid_coordinates_warn(tmp_path):
    X = np.random.default_rng(0).uniform([5e5, 5.4e6, 0], [5e5 + 5, 5.4e6 + 5, 5], (300, 3))
    np.save(tmp_path / "in.npy", X.astype(np.float32))
    result = run("normals", tmp_path / "in.npy", tmp_path / "out.npy")
    assert result.exit_code == 0
    assert "float32 rounds coordinates" in result.stderr


def test_the_demo_replaces_no_file_unasked(tmp_path):
    (tmp_path / "clean.laz").write_text("precious")
    result = run("demo", tmp_path)
    assert result.exit_code == 1
    assert "already holds clean.laz" in result.stderr
    assert (tmp_path / "clean.laz").read_text() == "precious"
    assert not (tmp_path / "street.laz").exists()
