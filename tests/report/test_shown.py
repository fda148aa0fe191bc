"""Reports of runs by tiles: found in the outputs, and equal to what memory tells."""

import re

import numpy as np
import pytest

from commands import done
from pages import read_page
from sklearn_mcmd.io import read_points, write_points
from sklearn_mcmd.report import _shown
from sklearn_mcmd.report._shown import sample_of
from sklearn_mcmd.tiling import _run
from tiled import street

N = 4_400
TILES = ("--memory", "1GB", "--n-jobs", 1)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Two streets of which the second repeats a part of the first."""
    monkeypatch.setattr(_run, "bytes_of_point", lambda *_: 3_000.0)  # to measure it takes longer
    cloud = street(N)
    (tmp_path / "in").mkdir()
    write_points(tmp_path / "in" / "a.laz", cloud)
    write_points(tmp_path / "in" / "b.laz", cloud.subset(slice(0, N // 2)))
    return tmp_path / "in"


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


@pytest.mark.parametrize(
    ("verb", "column", "word"),
    [
        ("denoise", "outlier", "are outliers"),
        ("segment", "region", "regions hold"),
        ("edges", "edge", "lie on edges"),
    ],
)
def test_what_tiles_find_is_reported_as_in_memory(verb, column, word, folder, tmp_path):
    (folder / "a.laz").unlink()
    told = []
    for name, source, options in (("r1", folder / "b.laz", ()), ("r2", folder, TILES)):
        target = tmp_path / ("out" if options else "o.laz")
        options = (*options, *(("--mode", "mark") if verb == "denoise" else ()))
        done(verb, source, target, "--report", tmp_path / name, *options)
        page = (tmp_path / name / "index.html").read_text()
        headline = re.search(rf'class="headline">([^<]*{word}[^<]*)<', page)[1]
        (shown,) = read_page((tmp_path / name / "view.html").read_text())[1]
        told.append((headline, shown.columns[column][0][np.argsort(shown.rows)].tolist()))
    assert told[0] == told[1]
    assert len(set(told[0][1])) > 1
