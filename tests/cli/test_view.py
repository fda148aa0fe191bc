"""``mcmd view`` makes a page of the outputs of all verbs and of all formats."""

import numpy as np
import pytest

from commands import done, error_line, files_in, run
from pages import read_page
from sklearn_mcmd.io import PointCloud, write_points


def page_of(*args, path):
    done("view", *args, "-o", path)
    return read_page(path.read_text(encoding="utf-8"))


@pytest.mark.parametrize(
    ("verb", "color", "kind"),
    [
        (["denoise", "--mode", "mark"], "outlier_score", "number"),
        (["normals"], "normal", "normal"),
        (["segment"], "region", "class"),
        (["edges"], "edge", "class"),
        (["plane"], "residual", "number"),
    ],
)
def test_the_result_of_each_verb_is_what_the_page_colors_by(verb, color, kind, room_file, tmp_path):
    done(*verb, room_file, tmp_path / "out.laz", "-q")
    manifest, (shown,) = page_of(tmp_path / "out.laz", path=tmp_path / "page.html")
    assert manifest["start"] == color
    by_name = {attribute["name"]: attribute for attribute in manifest["attributes"]}
    assert by_name[color]["kind"] == kind
    if color == "outlier_score":
        assert by_name["classification"]["outliers"]
    numbers = by_name["intensity"]
    np.testing.assert_array_equal(shown.columns["intensity"][0] - 1 + numbers["low"], shown.rows)


def test_two_files_are_two_clouds_and_the_summary_tells_all(room, room_file, tmp_path):
    write_points(tmp_path / "less.laz", room.subset(slice(0, 100)))
    page = tmp_path / "both.html"
    result = run("view", room_file, tmp_path / "less.laz", "-o", page, "--title", "Both")
    lines = result.stdout.splitlines()
    assert lines[0] == f"{room_file}, {tmp_path / 'less.laz'} -> {page}"
    assert [line.split()[0] for line in lines[1:]] == ["points", "coordinates", "size", "seconds"]
    assert "(spacing 0.0457)" in lines[2]
    manifest, clouds = read_page(page.read_text(encoding="utf-8"))
    assert manifest["title"] == "Both"
    assert [len(cloud.rows) for cloud in clouds] == [930, 100]


def test_options_choose_color_attributes_and_number(room_file, tmp_path):
    page = tmp_path / "page.html"
    options = ("--color", "height", "--only", "intensity", "--max-points", "50", "-q")
    result = done("view", room_file, "-o", page, *options)
    assert result.stdout == ""
    assert result.stderr.splitlines() == [
        "mcmd: warning: the page holds 50 of 930 points, chosen at random"
    ]
    manifest, (shown,) = read_page(page.read_text(encoding="utf-8"))
    assert (manifest["start"], list(shown.columns), len(shown.rows)) == (
        "height",
        ["intensity"],
        50,
    )


def test_the_files_of_a_folder_are_one_cloud(room, tmp_path):
    folder = tmp_path / "rooms"
    folder.mkdir()
    half = len(room) // 2
    write_points(folder / "a.laz", room.subset(slice(half)))
    write_points(
        folder / "b.npz", PointCloud(room.xyz[half:], {"intensity": np.arange(9e3)[:half]})
    )
    result = done("view", folder, "-o", tmp_path / "page.html")
    assert "attributes that not all clouds have are left out: classification" in result.stderr
    manifest, (shown,) = read_page((tmp_path / "page.html").read_text(encoding="utf-8"))
    assert manifest["title"] == "rooms"
    assert len(shown.rows) == len(room)
    assert "intensity" in {attribute["name"] for attribute in manifest["attributes"]}


@pytest.mark.parametrize(
    ("source", "page", "options", "words"),
    [
        ("missing.laz", "p.html", (), "missing.laz: no such file"),
        ("room.laz", "p.laz", (), "ends in .html"),
        ("room.laz", "no/p.html", (), "does not exist"),
        ("room.laz", "p.html", ("--color", "hue"), "'hue'"),
        ("room.laz", "p.html", ("--only", "hue"), "'hue'"),
    ],
)
def test_errors_are_one_line_and_leave_no_page(source, page, options, words, room_file, tmp_path):
    assert words in error_line(run("view", tmp_path / source, "-o", tmp_path / page, *options))
    assert files_in(tmp_path) == ["room.laz"]
