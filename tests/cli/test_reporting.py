"""mcmd VERB --report: a page for each verb, refused before the work, with all parameters."""

import html
import re
import shlex
import sys

import numpy as np
import pytest

from commands import done, error_line, files_in, run
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
    done(verb, room_file, tmp_path / "out.laz", "--report", folder)
    assert files_in(folder) == ["index.html", "view.html"]
    words = words_of(folder / "index.html")
    n = len(read_points(room_file))
    assert f"{n:,}" in words
    assert "room.laz" in words
    for axis in "xyz":
        assert re.search(rf" {axis} -?\d", words)
    assert (folder / "index.html").read_text().count('src="data:image/') == 3
    manifest, (shown,) = read_page((folder / "view.html").read_text())
    assert len(shown.rows) == n
    names = [attribute["name"] for attribute in manifest["attributes"]]
    wanted = {"denoise": "outlier_score", "segment": "region", "edges": "edge", "normals": "normal"}
    assert wanted[verb] in names


def test_the_output_is_the_same_with_a_report_and_without(room_file, tmp_path):
    a, b, folder = tmp_path / "a.laz", tmp_path / "b.laz", tmp_path / "r"
    done("denoise", room_file, a, "--report", folder)
    (folder / "mine.txt").write_text("old")
    before = (folder / "index.html").read_text()
    done("denoise", room_file, b, "--report", folder)
    assert a.read_bytes() == b.read_bytes()
    assert files_in(folder) == ["index.html", "mine.txt", "view.html"]
    assert (folder / "mine.txt").read_text() == "old"
    assert (folder / "index.html").read_text() != before


@pytest.mark.parametrize("name", ["index.html", "view.html"])
def test_a_page_that_no_report_has_made_is_not_replaced(name, room_file, tmp_path):
    (page := tmp_path / "site" / name).parent.mkdir()
    page.write_text("<html>mine</html>")
    line = error_line(run("denoise", room_file, tmp_path / "a.laz", "--report", page.parent))
    assert f"{name}: no report has made it; give --report another folder" in line
    assert (files_in(page.parent), page.read_text()) == ([name], "<html>mine</html>")
    assert not (tmp_path / "a.laz").exists()


def test_the_command_of_a_report_is_what_was_typed_and_runs(room_file, tmp_path):
    typed = ["denoise", str(room_file), str(tmp_path / "o u.laz"), "--sensor", "102,102,110.5"]
    typed += ["--ignore-class", "6,9", "--memory=1GB", "--noise-scale", "0.012345678", "-q"]
    typed += ["--report", str(tmp_path / "r")]
    done(*typed)
    page = (tmp_path / "r" / "index.html").read_text()
    command = html.unescape(re.search(r'<pre class="command".*?>(.*?)</pre>', page)[1])
    assert shlex.split(command) == ["mcmd", *typed]
    words = words_of(tmp_path / "r" / "index.html")
    for shown in (
        "--ignore-class 6,9",
        "--sensor 102,102,110.5",
        "--memory 1000000000",
        "--n-neighbors 50 (default)",
        "--false-positive-rate none (default)",
    ):
        assert f"{shown} --" in words  # the table
    assert "--noise-scale 0.012345678 --cutoff" in words


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


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("file", "report: is no folder; give --report another folder"),
        ("page", "index.html: is a folder"),
        ("matplotlib", "--report needs matplotlib, which is not installed: pip install"),
        ("jinja2", "--report needs jinja2, which is not installed: pip install"),
    ],
)
def test_a_report_that_cannot_be_is_refused_before_the_work(
    fault, words, room_file, tmp_path, monkeypatch
):
    def work(*args, **kwargs):
        raise AssertionError("the long work began")

    monkeypatch.setattr(MCMDOutlierDetector, "fit", work)
    folder = tmp_path / "report"
    if fault == "file":
        folder.write_text("")
    elif fault == "page":
        (folder / "index.html").mkdir(parents=True)
    else:
        monkeypatch.setitem(sys.modules, fault, None)
    before = files_in(tmp_path)
    line = error_line(run("denoise", room_file, tmp_path / "o.laz", "--report", folder))
    assert words in line
    assert files_in(tmp_path) == before


@pytest.mark.parametrize(
    ("verb", "options", "words"),
    [
        ("denoise", ("--strictness", "paper"), "outliers"),
        ("denoise", ("--strictness", "surfaces", "--ignore-class", 6), "used 870,"),
        ("edges", ("--criterion", "eigenvalue"), "limit of eigenvalue"),
        ("normals", ("--n-neighbors", "auto", "--method", "pca"), "normals"),
    ],
)
def test_every_kind_of_verdict_has_a_report(verb, options, words, room, tmp_path):
    classes = np.repeat([6, 1], [60, len(room) - 60]).astype(np.uint8)
    write_points(tmp_path / "in.laz", room.with_attributes(classification=classes))
    options = (*options, "--report", tmp_path / "r")
    done(verb, tmp_path / "in.laz", tmp_path / "o.laz", *options)
    assert words in words_of(tmp_path / "r" / "index.html")


@pytest.mark.parametrize("verb", VERBS)
def test_tiny_clouds_have_reports(verb, tmp_path):
    xyz = np.random.default_rng(0).uniform(size=(5, 3))
    write_points(tmp_path / "a.laz", PointCloud(xyz))
    done(verb, tmp_path / "a.laz", tmp_path / "b.laz", "--report", tmp_path / "r")
    assert "Few points." in words_of(tmp_path / "r" / "index.html")


def warnings_on(page):
    notes = re.findall(r"<li><strong>(.*?)</strong> <span>(.*?)</span>", page.read_text())
    return [html.unescape(text) for title, text in notes if title == "Warned on the terminal."]


@pytest.mark.parametrize("verb", ["denoise", "plane"])
def test_what_a_run_warned_of_stands_on_its_page(verb, room_file, tmp_path):
    xyz = np.random.default_rng(0).uniform(size=(900, 3)) * 10 / [111e3, 67e3, 1]
    write_points(tmp_path / "degrees.laz", PointCloud(xyz + np.array([13.4, 52.5, 40])))
    source = tmp_path / "degrees.laz"
    result = done(verb, source, tmp_path / "o.laz", "--report", tmp_path / "r")
    (warned,) = warnings_on(tmp_path / "r" / "index.html")
    assert f"mcmd: warning: {warned}" in result.stderr.splitlines()
    assert "x and y seem to be degrees" in warned
    assert "Nothing to warn of" not in words_of(tmp_path / "r" / "index.html")
    run("denoise", room_file, tmp_path / "o.laz", "--report", tmp_path / "r")
    assert warnings_on(tmp_path / "r" / "index.html") == []  # of another run
