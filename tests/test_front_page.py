"""The front page of the docs shows a live page, which draws points in a browser."""

import importlib
import re
import sys
from pathlib import Path

import pytest

from pages import STILL, Tab

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
def test_the_live_page_draws_its_points_in_the_frame(live_page, chromium, tmp_path):
    live_page.write_page(tmp_path, n_points=20_000)
    (tmp_path / "index.html").write_text(f"<!doctype html>{FRAME[0]}")
    context = chromium.new_context(viewport={"width": 900, "height": 600})
    said, tab = [], context.new_page()
    tab.on("console", lambda message: said.append(message.text))
    tab.on("pageerror", lambda error: said.append(str(error)))
    tab.goto((tmp_path / "index.html").as_uri())
    frame = next(part for part in tab.frames if part.url.endswith(live_page.PAGE))
    Tab.wait_for(Frame(frame, said), f"Boolean(window.cloudPage && {STILL})")
    n_drawn, n_colors = frame.evaluate(DRAWN)
    assert n_drawn > 5_000  # pixels that are not of the background
    assert n_colors > 50
    assert "of 20,000" not in frame.inner_text("#counts")  # all are shown
    assert said == []
    context.close()


class Frame:
    """What `Tab.wait_for` asks."""

    def __init__(self, frame, said):
        self.ask, self.said = frame.evaluate, said


# Pixels that differ from that in the corner, and their colors.
DRAWN = """(() => {
    const { gl, canvas } = cloudPage.renderer;
    cloudPage.renderer.drawWhole();
    const bits = new Uint8Array(4 * canvas.width * canvas.height), colors = new Set();
    gl.readPixels(0, 0, canvas.width, canvas.height, gl.RGBA, gl.UNSIGNED_BYTE, bits);
    const back = bits.slice(0, 3).join(" ");
    let drawn = 0;
    for (let i = 0; i < bits.length; i += 4) {
        const color = bits.slice(i, i + 3).join(" ");
        colors.add(color);
        drawn += color !== back;
    }
    return [drawn, colors.size];
})()"""
