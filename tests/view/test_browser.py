"""The page in a browser: what a hand does there gives the numbers that NumPy knows."""

import numpy as np
import pytest

from pages import Tab
from sklearn_mcmd.io import PointCloud
from sklearn_mcmd.plotting import view

pytestmark = pytest.mark.slow

N = 100_000  # points of the scan


def test_the_page_loads_all_points_with_their_values(tab, scan):
    rows = np.array(tab.ask("Array.from(cloudPage.scene.clouds[0].rows)"))
    np.testing.assert_array_equal(np.sort(rows), np.arange(N))
    xyz = np.array(
        tab.ask(
            "(() => { const c = cloudPage.scene.clouds[0]; return Array.from({ length: 500 },"
            " (_, i) => cloudPage.scene.coordinates(c, i)); })()"
        )
    )
    np.testing.assert_allclose(xyz, scan.xyz[rows[:500]], rtol=0, atol=1e-6)
    assert tab.text("#counts") == "100,000 points"


def test_the_threshold_counts_and_hides(tab, scan):
    scores = scan.attributes["outlier_score"]
    assert tab.text("#n-above") == f"{np.count_nonzero(scores > 3):,}"
    field = tab.tab.locator("#threshold-value")
    field.press("m")  # a letter in a field is no command
    assert not tab.ask("cloudPage.measuring")
    field.fill("10")
    field.press("Enter")
    field.blur()
    tab.tab.click("#threshold-mode button[data-key=hide]")
    tab.rest()
    # A score within the error of its 16 bits of the threshold may be on either side.
    n_above = int(tab.text("#n-above").replace(",", ""))
    n_near = np.count_nonzero(np.abs(scores - 10) < 0.002)
    assert abs(n_above - np.count_nonzero(scores > 10)) <= n_near
    assert tab.text("#counts") == f"{N - n_above:,} of 100,000 points shown"


def test_a_click_tells_all_of_a_point_and_its_row(tab, scan):
    tab.tab.keyboard.press("2")  # from above, nothing lies over a point of the floor
    tab.tab.click("#outliers button[data-key=hide]")
    tab.rest()
    rng = np.random.default_rng(0)
    floor = np.flatnonzero(scan.attributes["region"] == 0)
    n_same = 0
    for row in rng.choice(floor, 8, replace=False):
        x, y = tab.place(row)
        if y > 600 or (x < 330 and y > 300):
            continue  # under the buttons or the card
        tab.tab.mouse.click(x, y)
        picked = tab.picked_row()
        card = tab.card()
        assert f"Row {picked:,}" in tab.text("#card")
        shown = [float(card[axis]) for axis in "xyz"]
        np.testing.assert_allclose(shown, scan.xyz[picked], atol=1e-6)
        assert card["intensity"] == str(scan.attributes["intensity"][picked])
        assert card["region"] == "0"
        assert float(card["outlier_score"]) == pytest.approx(
            scan.attributes["outlier_score"][picked], abs=0.002
        )
        assert card["normal"] == "0.0000 0.0000 1.0000"
        n_same += picked == row
    assert n_same >= 2  # elsewhere another point is as near to the pixel's middle


def test_distances_are_those_of_the_points(tab, scan):
    tab.tab.keyboard.press("2")
    tab.tab.keyboard.press("m")
    tab.rest()
    for n, (x, y) in enumerate([(450, 300), (520, 420), (400, 480)], 1):
        tab.tab.mouse.click(x, y)
        tab.wait_for(f"cloudPage.overlay.measured.length === {n}")
    rows = tab.ask("cloudPage.overlay.measured.map(({ cloud, i }) => cloud.rows[i])")
    assert len(rows) == 3
    a, b, c = scan.xyz[rows]
    card = {name: float(value) for name, value in tab.card().items()}
    assert card["length"] == pytest.approx(np.linalg.norm(c - b), abs=1e-3)
    assert card["horizontal"] == pytest.approx(np.linalg.norm((c - b)[:2]), abs=1e-3)
    np.testing.assert_allclose([card[f"d{axis}"] for axis in "xyz"], c - b, atol=1e-3)
    total = np.linalg.norm(b - a) + np.linalg.norm(c - b)
    assert card["all 2 parts"] == pytest.approx(total, abs=1e-3)
    tab.tab.keyboard.press("Escape")
    assert tab.ask("document.getElementById('card').hidden")


def test_the_section_box_cuts_where_it_says(tab, scan):
    tab.tab.keyboard.press("b")
    tab.ask(
        "Object.assign(cloudPage.scene.box, { low: [0.25, 0, 0], high: [0.75, 1, 0.5] });"
        "cloudPage.cut(true)"
    )
    low, high = scan.xyz.min(axis=0), scan.xyz.max(axis=0)
    share = (scan.xyz - low) / (high - low)
    inside = (share[:, 0] >= 0.25) & (share[:, 0] <= 0.75) & (share[:, 2] <= 0.5)
    shown = tab.ask("cloudPage.scene.nVisible()")
    assert abs(shown - inside.sum()) <= 0.001 * N  # the box is a step larger on each side
    tab.tab.keyboard.press("b")
    assert tab.text("#counts") == "100,000 points"


def test_every_attribute_can_color_and_a_picture_of_it_is_drawn(tab):
    tab.tab.keyboard.press("n")
    assert tab.ask("cloudPage.renderer.lineSets.get('normals').n") > 10_000
    names = tab.ask("cloudPage.scene.attributes.map((a) => a.name)")
    assert set(names) == {
        *("normal", "outlier_score", "outlier", "region", "intensity", "height"),
    }
    for _ in names:
        tab.tab.keyboard.press("c")
        tab.rest()
        assert tab.ask("new Set(cloudPage.scene.clouds[0].colors).size") >= 2
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


def test_two_clouds_are_compared_at_the_divider_which_names_one_that_lacks_what_colors(
    chromium, scan, tmp_path
):
    page = view(scan, PointCloud(scan.xyz[::2]), names=["before", "after"])
    tab = Tab(chromium, page.save(tmp_path / "two.html"))
    colored = tab.ask("cloudPage.scene.color.name")
    assert tab.text("#left-name") == "before"
    assert tab.text("#right-name") == f"after (gray: it has no {colored})"
    tab.tab.locator("#divider").press("ArrowRight")
    assert tab.ask("cloudPage.renderer.split.at") == pytest.approx(0.52, abs=0.01)
    parts = tab.ask("cloudPage.renderer.shownParts().map(({ cloud }) => cloud.name)")
    assert parts == ["before", "after"]
    assert tab.said == []
    tab.context.close()


def test_a_distance_has_colors_whose_middle_is_zero(chromium, scan, tmp_path):
    distance = np.linspace(-0.2, 1.0, N)
    page = view(PointCloud(scan.xyz, {"distance": distance}), names=["moved"])
    tab = Tab(chromium, page.save(tmp_path / "moved.html"))
    assert tab.ask("cloudPage.scene.palette") == "blue-red"
    low, high = tab.ask(
        "cloudPage.scene.colorRange(cloudPage.scene.color)"
        ".map((code) => decodeNumber(cloudPage.scene.color, code))"
    )
    assert low == pytest.approx(-high, abs=1e-4)
    assert tab.said == []
    tab.context.close()
