"""Reports of runs by tiles: found in the outputs, and equal to what memory tells."""

import re
import shutil

import numpy as np
import pytest

from commands import done
from pages import read_page
from sklearn_mcmd.io import read_points, write_points
from sklearn_mcmd.report import _shown
from sklearn_mcmd.report._shown import sample_of
from tiled import street

N = 4_400
TILES = ("--memory", "1GB", "--n-jobs", 1)


@pytest.fixture
def folder(tmp_path):
    """Two streets of which the second repeats a part of the first."""
    cloud = street(N)
    (tmp_path / "in").mkdir()
    write_points(tmp_path / "in" / "a.laz", cloud)
    write_points(tmp_path / "in" / "b.laz", cloud.subset(slice(0, N // 2)))
    return tmp_path / "in"


def counts(page):
    text = re.sub(r"<[^>]+>", " ", page.read_text(encoding="utf-8").partition("</style>")[2])
    return re.findall(r"([\d,]+) outliers", text)


def test_outliers_of_tiles_are_those_of_memory(tmp_path):
    write_points(tmp_path / "a.laz", street(N))
    a, b = tmp_path / "r1", tmp_path / "r2"
    options = ("--mode", "mark", "--report")
    done("denoise", tmp_path / "a.laz", tmp_path / "b.laz", *options, a)
    (tmp_path / "in").mkdir()
    shutil.copy(tmp_path / "a.laz", tmp_path / "in" / "a.laz")
    done("denoise", tmp_path / "in", tmp_path / "out", *options, b, *TILES)
    assert counts(a / "index.html")[0] == counts(b / "index.html")[0]
    clouds = [read_page((r / "view.html").read_text())[1][0] for r in (a, b)]
    outliers = [np.sort(cloud.rows[cloud.columns["outlier"][0] == 1]) for cloud in clouds]
    assert outliers[0].size > 0
    assert (outliers[0] == outliers[1]).all()


def test_a_sample_is_every_so_many_th_point_across_files_and_parts(folder, monkeypatch):
    monkeypatch.setattr(_shown, "PART", 1000)
    paths = sorted(folder.iterdir())
    whole = np.vstack([read_points(path).xyz for path in paths])
    for step in (1, 7, 5000):
        sample = sample_of(paths, step)
        assert (sample.xyz == whole[::step]).all()


def test_a_run_that_removes_has_a_report_without_maps(folder, tmp_path):
    done("denoise", folder, folder, "--report", tmp_path / "r", *TILES)
    page = (tmp_path / "r" / "index.html").read_text()
    assert "--mode mark keeps outliers" in page
    assert "data:image/webp" not in page


def test_normals_of_tiles_state_the_sample(folder, tmp_path, monkeypatch):
    monkeypatch.setattr(_shown, "SAMPLE", 1_100)
    options = ("--features", "normal_error", "--report", tmp_path / "r")
    done("normals", folder, tmp_path / "out", *options, *TILES)
    page = (tmp_path / "r" / "index.html").read_text()
    assert "one point of 6, 1,100 of 6,600 points" in page
    assert "standard error" in page


@pytest.mark.parametrize(("verb", "word"), [("segment", "regions hold"), ("edges", "lie on edges")])
def test_regions_and_edges_of_tiles_are_those_of_memory(verb, word, folder, tmp_path):
    alone = tmp_path / "alone"
    alone.mkdir()
    shutil.copy(folder / "b.laz", alone / "b.laz")
    lines = []
    for name, source, options in (("r1", alone / "b.laz", ()), ("r2", alone, TILES)):
        target = tmp_path / ("out" if options else "o.laz")
        done(verb, source, target, "--report", tmp_path / name, *options)
        page = (tmp_path / name / "index.html").read_text()
        lines.append(re.search(rf'class="headline">([^<]*{word}[^<]*)<', page)[1])
    assert lines[0] == lines[1]
