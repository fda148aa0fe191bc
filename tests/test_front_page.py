"""The front page of the docs shows a live page."""

import importlib
import re
import sys
from pathlib import Path

import pytest

from pages import read_page

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
if not DOCS.is_dir():
    pytest.skip("a checkout is needed", allow_module_level=True)
FRONT = (DOCS / "index.rst").read_text("utf-8")
FRAME = re.search(r'<iframe class="front-live" src="([^"]+)"[^>]*></iframe>', FRONT)


@pytest.fixture
def live_page(monkeypatch):
    monkeypatch.syspath_prepend(DOCS)
    yield importlib.import_module("live_page")
    sys.modules.pop("live_page", None)


def test_the_frame_shows_the_page_that_each_build_makes(live_page):
    assert FRAME[1] == live_page.PAGE
    assert '"live_page",' in (DOCS / "conf.py").read_text("utf-8")


def test_its_preview_is_there():
    (preview,) = re.findall(r"og:image: \S+/(_static/\S+)", FRONT)
    assert (DOCS / preview).is_file()


@pytest.mark.slow
def test_the_live_page_has_the_street_before_and_after(live_page, tmp_path):
    """`view/test_browser.py` looks at such pages in a browser."""
    manifest, clouds = read_page(live_page.write_page(tmp_path, n_points=2_000).read_text("utf-8"))
    assert [told["name"] for told in manifest["clouds"]] == ["scanned", "cleaned"]
    assert len(clouds[0].rows) == 2_000 > len(clouds[1].rows) > 1_600
