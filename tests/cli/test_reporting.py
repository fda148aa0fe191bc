"""mcmd VERB --report: a page for each verb, refused before the work, with all parameters."""

import html
import os
import re
import shlex
import sys

import numpy as np
import pytest

from commands import error_line, files_in, run
from pages import read_page
from sklearn_mcmd import MCMDOutlierDetector
from sklearn_mcmd.io import PointCloud, read_points, write_points

VERBS = ("denoise", "normals", "segment", "edges")


def text_of(path):
    """The words of a page."""
    body = path.read_text(encoding="utf-8").partition("</style>")[2]
    return html.unescape(re.sub(r"<[^>]+>", " ", body))


def words_of(path):
    return " ".join(text_of(path).split())


@pytest.mark.parametrize("verb", VERBS)
def test_each_verb_writes_a_page_and_one_to_look_around_in(verb, room_file, tmp_path):
    folder = tmp_path / "report"
    result = run(verb, room_file, tmp_path / "out.laz", "--report", folder)
    assert result.exit_code == 0, result.output
    assert files_in(folder) == ["index.html", "view.html"]
    words = words_of(folder / "index.html")
    n = len(read_points(room_file))
    assert f"{n:,}" in words
    assert "room.laz" in words
    for axis in "xyz":
        assert re.search(rf" {axis} -?\d", words)
    assert (folder / "index.html").read_text().count("data:image/png") >= 3
    manifest, (shown,) = read_page((folder / "view.html").read_text())
    assert len(shown.rows) == n
    names = [attribute["name"] for attribute in manifest["attributes"]]
    wanted = {"denoise": "outlier_score", "segment": "region", "edges": "edge", "normals": "normal"}
    assert wanted[verb] in names


def test_the_output_is_the_same_with_a_report_and_without(room_file, tmp_path):
    a, b = tmp_path / "a.laz", tmp_path / "b.laz"
    assert run("denoise", room_file, a).exit_code == 0
    assert run("denoise", room_file, b, "--report", tmp_path / "r").exit_code == 0
    assert a.read_bytes() == b.read_bytes()


def test_the_report_of_a_plane_has_the_figures_of_its_text(tmp_path):
    rng = np.random.default_rng(0)
    wall = rng.uniform(0, 4, (600, 3)) * [1, 0, 1] + rng.normal(0, 0.004, (600, 3)) * [0, 1, 0]
    wall[:60, 1] += 0.2
    write_points(tmp_path / "wall.laz", PointCloud(np.round(wall, 4)))
    folder = tmp_path / "report"
    result = run(
        "plane", tmp_path / "wall.laz", tmp_path / "o.laz", "--unit", "m", "--report", folder
    )
    assert result.exit_code == 0, result.output
    words = words_of(folder / "index.html")
    assert "60 of 600 points (10.0 %) do not belong to the plane" in words
    assert "Minimal detectable bias (MDB)" in words
    text = (tmp_path / "o_report.txt").read_text()
    for line in ("critical value", "variance factor", "level of one point"):
        value = re.search(rf"{line} +(.*)", text)[1]
        assert f"{line} {value}" in words


def test_counts_are_those_of_the_output(room_file, tmp_path):
    out = tmp_path / "out.laz"
    run("denoise", room_file, out, "--mode", "mark", "--report", tmp_path / "r")
    found = int((read_points(out).attributes["classification"] == 7).sum())
    words = words_of(tmp_path / "r" / "index.html")
    assert f"{found:,} of {len(read_points(out)):,} points" in words
    assert "they are marked" in words


def test_the_worst_groups_and_points_are_named_once_with_the_reason(tmp_path):
    rng = np.random.default_rng(0)
    plane = rng.uniform(0, 6, (1200, 3)) * [1, 1, 0] + rng.normal(0, 0.005, (1200, 3))
    single = np.column_stack([np.arange(0.5, 6, 0.5), np.full(11, 3), np.arange(11) / 3 + 5])
    cloud = np.vstack([plane, single, rng.normal([3, 0, 9], 0.05, (20, 3))])
    np.save(tmp_path / "a.npy", cloud)
    for options in ((), ("--strictness", "paper")):
        run("denoise", tmp_path / "a.npy", tmp_path / "o.npy", *options, "--report", tmp_path / "r")
        words = words_of(tmp_path / "r" / "index.html")
        assert words.count("usual spacings from anything") == (0 if options else 9)
        assert words.count("group of 20, ") == (0 if options else 1)


def test_parameters_are_all_there_and_defaults_are_marked(room_file, tmp_path):
    options = ("--cutoff", 4, "--strictness", "isolated", "--report", tmp_path / "r")
    assert run("denoise", room_file, tmp_path / "out.laz", *options).exit_code == 0
    words = words_of(tmp_path / "r" / "index.html")
    assert "--cutoff 4 --strictness isolated --report" in words  # the command
    assert "--cutoff 4 --false-positive-rate none (default)" in words  # the table
    assert "--n-neighbors 50 (default)" in words
    assert "--strictness isolated --noise-scale the noise around each point (default)" in words
    assert "--quiet no (default)" in words


def test_the_command_of_a_report_is_what_was_typed_and_runs(room_file, tmp_path):
    typed = ["denoise", str(room_file), str(tmp_path / "o u.laz"), "--sensor", "102,102,110.5"]
    typed += ["--ignore-class", "6,9", "--memory=1GB", "--noise-scale", "0.012345678", "-q"]
    typed += ["--report", str(tmp_path / "r")]
    assert run(*typed).exit_code == 0
    page = (tmp_path / "r" / "index.html").read_text()
    command = html.unescape(re.search(r'<pre class="command".*?>(.*?)</pre>', page)[1])
    assert shlex.split(command) == ["mcmd", *typed]
    words = words_of(tmp_path / "r" / "index.html")
    for shown in ("--ignore-class 6,9", "--sensor 102,102,110.5", "--memory 1000000000"):
        assert f"{shown} --" in words  # the table
    assert "--noise-scale 0.012345678 --cutoff" in words


def test_the_input_of_a_report_has_all_points_and_those_that_were_used(tmp_path):
    xyz = np.random.default_rng(0).uniform(size=(400, 3)) * [9, 9, 0.01]
    classes = np.repeat(np.uint8([6, 2]), [100, 300])
    write_points(tmp_path / "a.laz", PointCloud(xyz, {"classification": classes}))
    for options, told in (((), "points 400 x"), (("--ignore-class", 6), "points 400 used 300,")):
        run("denoise", tmp_path / "a.laz", tmp_path / "o.laz", *options, "--report", tmp_path / "r")
        assert told in words_of(tmp_path / "r" / "index.html")


def test_flags_are_in_the_command_as_typed(room_file, tmp_path):
    options = ("--no-refine", "--quiet", "--report", tmp_path / "a b")
    assert run("segment", room_file, tmp_path / "out.laz", *options).exit_code == 0
    words = words_of(tmp_path / "a b" / "index.html")
    assert "--no-refine" in words
    assert "--report '" in words
    assert "--quiet" in words


def test_names_of_files_and_attributes_are_escaped(tmp_path):
    rng = np.random.default_rng(0)
    name = "<script>alert(1)</script>"
    cloud = PointCloud(rng.uniform(size=(300, 3)), {name: np.arange(300)})
    source = tmp_path / ("<i>&.npz" if os.name == "posix" else "&.npz")
    write_points(source, cloud)
    assert run("denoise", source, tmp_path / "o.npz", "--report", tmp_path / "r").exit_code == 0
    page = (tmp_path / "r" / "index.html").read_text()
    assert "<script" not in page
    assert "<i>&." not in page
    assert html.escape(name) in page


def test_pages_for_which_there_is_no_room_are_named_and_leave_nothing(tmp_path):
    resource = pytest.importorskip("resource")
    source, page = tmp_path / "a.npy", tmp_path / "v.html"
    np.save(source, np.random.default_rng(0).uniform(size=(60, 3)) * [1, 1, 0.01])
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (8192, before[1]))  # as full as a disk can be
    try:
        lines = [
            error_line(run("view", source, "-o", page)),
            error_line(run("denoise", source, tmp_path / "b.npy", "--report", tmp_path / "r")),
        ]
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert f"{page}: cannot be written: file too large" in lines[0]
    assert "view.html: cannot be written: file too large" in lines[1]
    assert "v.html" not in files_in(tmp_path)
    assert files_in(tmp_path / "r") == []


def refuse_to_work(monkeypatch):
    def work(*args, **kwargs):
        raise AssertionError("the long work began")

    monkeypatch.setattr(MCMDOutlierDetector, "fit", work)


def test_a_folder_that_cannot_be_written_is_refused_before_the_work(
    room_file, tmp_path, monkeypatch
):
    refuse_to_work(monkeypatch)
    (tmp_path / "taken").write_text("")
    line = error_line(run("denoise", room_file, tmp_path / "o.laz", "--report", tmp_path / "taken"))
    assert "taken" in line
    assert files_in(tmp_path) == ["room.laz", "taken"]


def test_without_matplotlib_the_error_says_what_to_install(room_file, tmp_path, monkeypatch):
    refuse_to_work(monkeypatch)
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    line = error_line(run("denoise", room_file, tmp_path / "o.laz", "--report", tmp_path / "r"))
    assert "--report needs matplotlib" in line
    assert "pip install" in line


@pytest.mark.parametrize("verb", VERBS)
@pytest.mark.parametrize("n", [5, 60])
def test_tiny_clouds_have_reports(verb, n, tmp_path):
    xyz = np.random.default_rng(0).uniform(size=(n, 3))
    write_points(tmp_path / "a.laz", PointCloud(xyz))
    result = run(verb, tmp_path / "a.laz", tmp_path / "b.laz", "--report", tmp_path / "r")
    assert result.exit_code == 0, result.output
    assert "Few points." in words_of(tmp_path / "r" / "index.html")


@pytest.mark.parametrize(
    "options",
    [("--strictness", "paper"), ("--strictness", "surfaces"), ("--contamination", 0.05)],
)
def test_every_kind_of_verdict_has_a_report(options, room_file, tmp_path):
    result = run("denoise", room_file, tmp_path / "o.laz", *options, "--report", tmp_path / "r")
    assert result.exit_code == 0, result.output


@pytest.mark.parametrize("criterion", ["eigenvalue", "surface_variation", "removed_fraction"])
def test_every_criterion_of_edges_has_a_report(criterion, room_file, tmp_path):
    options = ("--criterion", criterion, "--report", tmp_path / "r")
    result = run("edges", room_file, tmp_path / "o.laz", *options)
    assert result.exit_code == 0, result.output
    assert f"limit of {criterion}" in words_of(tmp_path / "r" / "index.html")


def test_normals_by_least_squares_of_chosen_sizes_have_a_report(room_file, tmp_path):
    options = ("--n-neighbors", "auto", "--method", "mcmd_md", "--report", tmp_path / "r")
    assert run("normals", room_file, tmp_path / "o.laz", *options).exit_code == 0
    pca = ("--method", "pca", "--features", "all", "--report", tmp_path / "r")
    assert run("normals", room_file, tmp_path / "o.laz", *pca).exit_code == 0
    assert files_in(tmp_path / "r") == ["index.html", "view.html"]


def degrees_file(folder, n):
    """A box of ten meters, in degrees beside meters."""
    xyz = np.random.default_rng(0).uniform(size=(n, 3)) * 10
    write_points(folder / "degrees.laz", PointCloud(xyz / [111e3, 67e3, 1] + [13.4, 52.5, 40]))
    return folder / "degrees.laz"


def warnings_on(page):
    notes = re.findall(r"<li><strong>(.*?)</strong> <span>(.*?)</span>", page.read_text())
    return [html.unescape(text) for title, text in notes if title == "Warned on the terminal."]


@pytest.mark.parametrize("verb", [*VERBS, "plane"])
def test_what_a_run_warned_of_stands_on_its_page(verb, room_file, tmp_path):
    result = run(verb, degrees_file(tmp_path, 900), tmp_path / "o.laz", "--report", tmp_path / "r")
    assert result.exit_code == 0, result.output
    (warned,) = warnings_on(tmp_path / "r" / "index.html")
    assert f"mcmd: warning: {warned}" in result.stderr.splitlines()
    assert "x and y seem to be degrees" in warned
    assert "Nothing to warn of" not in words_of(tmp_path / "r" / "index.html")
    result = run(verb, room_file, tmp_path / "o.laz", "--report", tmp_path / "r")
    assert "warning" not in result.stderr
    assert warnings_on(tmp_path / "r" / "index.html") == []  # of another run


def test_what_a_run_by_tiles_warned_of_stands_on_its_page(small_machine, tmp_path):
    options = ("--memory", "2MB", "--n-jobs", 1, "--report", tmp_path / "r")
    result = run("denoise", degrees_file(tmp_path, 6_000), tmp_path / "o.laz", *options)
    assert "tiles" in result.stdout, result.output
    warned = warnings_on(tmp_path / "r" / "index.html")
    assert [f"mcmd: warning: {text}" for text in warned] == result.stderr.splitlines()
    assert "x and y seem to be degrees" in warned[0]


def test_what_the_page_says_itself_is_not_said_twice(tmp_path):
    """A position that is doubted, and planes without noise."""
    rng = np.random.default_rng(0)
    plane = rng.uniform(0, 6, (2_000, 3)) * [1, 1, 0]
    plane[::25, 2] = rng.uniform(0.05, 0.3, 80)
    viewpoint = {"pcd_viewpoint": (3.0, 3.0, 0.5, 1.0, 0.0, 0.0, 0.0)}
    pytest.importorskip("pypcd4")
    write_points(tmp_path / "a.pcd", PointCloud(plane, {}, viewpoint))
    strict = ("--strictness", "surfaces", "--report", tmp_path / "r")
    result = run("denoise", tmp_path / "a.pcd", tmp_path / "o.npy", *strict)
    words = words_of(tmp_path / "r" / "index.html")
    for warned, title in (
        ("but points do not look as if measured from there", "Where was the sensor?"),
        ("are outliers only because most of their neighbors", "Planes without noise."),
    ):
        assert warned in result.stderr
        assert title in words
    assert warnings_on(tmp_path / "r" / "index.html") == []
