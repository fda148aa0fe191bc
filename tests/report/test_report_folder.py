"""The folder of a report: refused before the work, and replaced only by whole pages."""

import sys
from pathlib import Path

import numpy as np
import pytest

from sklearn_mcmd.io import PointCloud
from sklearn_mcmd.report._contents import Contents, Run
from sklearn_mcmd.report._rendering import check_folder, write_report

RUN = Run(
    verb="denoise",
    command="mcmd denoise a b",
    parameters=(),
    source=Path("a.laz"),
    target=Path("b.laz"),
    seconds=1.0,
)
EMPTY = {name: [] for name in ("cards", "notes", "sections", "cloud_rows")}
CONTENTS = Contents(headline="Nothing.", checks="nothing", output="nothing", **EMPTY)


def test_a_page_is_written_and_other_files_stay(tmp_path):
    folder = tmp_path / "new" / "report"
    check_folder(folder)
    assert not folder.parent.exists()
    assert write_report(folder, RUN, CONTENTS) == folder / "index.html"
    (folder / "mine.txt").write_text("mine")
    (folder / "index.html").write_text("old")
    cloud = PointCloud(np.random.default_rng(0).uniform(size=(20, 3)))
    write_report(folder, RUN, CONTENTS._replace(shown=cloud))
    assert sorted(p.name for p in folder.iterdir()) == ["index.html", "mine.txt", "view.html"]
    assert (folder / "index.html").read_text() != "old"
    assert (folder / "mine.txt").read_text() == "mine"


def test_what_stands_in_the_place_of_the_folder_or_of_a_page_is_refused(tmp_path):
    (tmp_path / "file").write_text("")
    for folder in (tmp_path / "file", tmp_path / "file" / "report"):
        with pytest.raises(ValueError, match="file"):
            check_folder(folder)
    (tmp_path / "index.html").mkdir()
    with pytest.raises(ValueError, match=r"index\.html: is a folder"):
        check_folder(tmp_path)


@pytest.mark.parametrize("library", ["matplotlib", "jinja2"])
def test_without_a_library_the_message_says_what_to_install(library, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(ImportError, match=f"--report needs {library}.*pip install"):
        check_folder(tmp_path)
