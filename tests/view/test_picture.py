"""The picture of the page, and what is saved of it, in a browser."""

import numpy as np
import pytest

pytestmark = pytest.mark.slow


def test_a_picture_is_drawn(tab):
    tab.ask("cloudPage.renderer.drawWhole()")
    colors = tab.ask(
        """(() => {
            const { gl, canvas } = cloudPage.renderer;
            cloudPage.renderer.drawWhole();
            const bits = new Uint8Array(4 * canvas.width * canvas.height);
            gl.readPixels(0, 0, canvas.width, canvas.height, gl.RGBA, gl.UNSIGNED_BYTE, bits);
            const all = new Set();
            for (let i = 0; i < bits.length; i += 4) all.add(bits.slice(i, i + 3).join(" "));
            return all.size;
        })()"""
    )
    assert colors > 50


def test_the_saved_picture_is_what_the_page_shows(tab, tmp_path):
    image = pytest.importorskip("matplotlib.image")
    tab.tab.locator("#color-by").select_option(label="outlier_score")
    tab.tab.locator("#color-by").blur()
    tab.measure((300, 200), (520, 420))
    with tab.tab.expect_download() as download:
        tab.tab.click("#tool-picture")
    assert download.value.suggested_filename == "scan.png"
    download.value.save_as(tmp_path / "picture.png")
    for name in ("tools", "card"):
        tab.ask(f"document.getElementById('{name}').style.display = 'none'")
    width, height = tab.ask("[cloudPage.camera.width, cloudPage.camera.height]")
    stage = {"x": 0, "y": 0, "width": width, "height": height}
    tab.tab.screenshot(path=tmp_path / "page.png", clip=stage)
    saved, page = (image.imread(tmp_path / f"{n}.png")[..., :3] for n in ("picture", "page"))
    assert saved.shape == page.shape
    # A backdrop blurs on the page only; without legend or line a hundredth differs, and more.
    assert np.mean(np.abs(saved - page).max(axis=2) > 0.3) < 0.001
