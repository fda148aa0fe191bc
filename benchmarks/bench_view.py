"""Pages of clouds beside those of plotly and K3D: size, making, loading, picking, frames.

    python benchmarks/bench_view.py 100_000 1_000_000 5_000_000

Needs Playwright and an installed Chromium, which draws without a graphics card here; plotly and k3d
are measured where they are installed. Points of a street, in random order, which is the hardest to
compress, and in the order of a scanner, with class and score.
"""

import argparse
import shutil
import tempfile
import time
from pathlib import Path

import numpy as np

from sklearn_mcmd.io import PointCloud
from sklearn_mcmd.plotting import view

FLAGS = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader"]
FLAGS += ["--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"]
PATIENCE = 150  # seconds until a page counts as not shown
READY = "window.cloudPage?.loaded && !cloudPage.renderer.moving"
WORK = """async () => {
    const app = cloudPage, told = { first: app.firstShown, all: app.loadTime };
    const timed = (act) => { const t = performance.now(); act(); return performance.now() - t; };
    const five = (act) => timed(() => { for (let i = 0; i < 5; i++) act(i); }) / 5;
    told.pick = five((i) => pick(app.renderer, 400 + 20 * i, 350));
    app.scene.threshold.mode = "hide";
    app.judgeAll();
    told.threshold = five(() => app.judgeAll());
    let frames = 0;
    app.renderer.afterFrame = () => frames++;
    for (const end = performance.now() + 5000; performance.now() < end; ) {
        app.camera.turn(3, 0);
        app.renderer.changed();
        await new Promise(requestAnimationFrame);
    }
    const ms = Object.entries(told).map(([name, time]) => `${name} ${time.toFixed()} ms, `);
    return ms.join("") + `${frames / 5} frames/s`;
}"""


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("sizes", nargs="+", type=int)
    for n in parser.parse_args().sizes:
        for order in ("random", "scanner"):
            report(f"ours, {order}", our_page, street(n, order), READY, WORK)
        for make in (plotly_page, k3d_page):
            shown = "document.querySelector('canvas')"
            report(make.__name__, make, street(n, "random"), shown, "() => 'a picture'")


def street(n, order):
    """A road of 200 m between two walls, with 5 mm of noise, 2 % outliers, and millimeters."""
    rng = np.random.default_rng(0)
    across = rng.uniform(0, 40, n) if order == "random" else 40 * (np.arange(n) % 2000) / 2000
    road = across < 20
    outlier = rng.random(n) < 0.02
    xyz = np.empty((n, 3))
    xyz[:, 0] = rng.uniform(0, 200, n) if order == "random" else np.linspace(0, 200, n)
    xyz[:, 1] = np.where(road, across - 10, np.where(across < 30, 10, -10))
    xyz[:, 2] = np.where(road, 0, across % 10)
    xyz += rng.normal(0, np.where(outlier, 1, 0.005)[:, None], (n, 3))
    score = np.where(outlier, rng.lognormal(3, 1, n), rng.gamma(2, 0.4, n))
    classes = np.where(outlier, 7, np.where(road, 11, 6)).astype(np.uint8)
    place = [356_000, 5_640_000, 80]
    return PointCloud(np.round(xyz + place, 3), {"classification": classes, "outlier_score": score})


def report(name, make, cloud, ready, work):
    """One line on a page: its size, how long it took to make and to show, and its own words."""
    with tempfile.TemporaryDirectory() as folder:
        path, start = Path(folder) / "page.html", time.process_time()
        try:
            make(cloud, path)
        except ImportError as err:
            print(err)
            return
        made, start = time.process_time() - start, time.monotonic()
        words = in_browser(path, ready, work) or f"not shown within {PATIENCE} s"
        shown, size = time.monotonic() - start, path.stat().st_size / 1e6
    words = f"{size:5.1f} MB, made in {made:.1f} s, open for {shown:.0f} s: {words}"
    print(f"{len(cloud):>9,} {name:14} {words}", flush=True)


def our_page(cloud, path):
    view(cloud, names=["street"]).save(path)


def plotly_page(cloud, path):
    import plotly.graph_objects as go

    x, y, z = local(cloud).T
    marker = {"size": 1, "color": cloud.attributes["outlier_score"].astype(np.float32)}
    classes = cloud.attributes["classification"]
    points = go.Scatter3d(x=x, y=y, z=z, mode="markers", marker=marker, customdata=classes)
    go.Figure(points).write_html(path, include_plotlyjs=True)


def k3d_page(cloud, path):
    import k3d

    plot = k3d.plot()
    score = cloud.attributes["outlier_score"].astype(np.float32)
    plot += k3d.points(local(cloud), attribute=score, point_size=0.02, shader="flat")
    plot.snapshot_type = "full"
    path.write_text(plot.get_snapshot(), encoding="utf-8")


def local(cloud):
    return (cloud.xyz - cloud.xyz.min(axis=0)).astype(np.float32)


def in_browser(path, ready, work):
    """What a function gives in the page once it is ready; None if that takes too long."""
    from playwright.sync_api import Error, sync_playwright

    program = shutil.which("chromium") or shutil.which("google-chrome")
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=program, args=FLAGS)
        try:
            tab = browser.new_page(viewport={"width": 1000, "height": 700})
            tab.set_default_timeout(1000 * PATIENCE)
            tab.goto(path.as_uri())
            end = time.monotonic() + PATIENCE
            while not tab.evaluate(f"Boolean({ready})"):
                if time.monotonic() > end:
                    return None
                time.sleep(0.05)
            tab.evaluate("new Promise((done) => requestAnimationFrame(() => setTimeout(done)))")
            return tab.evaluate(work)
        except Error:
            return None
        finally:
            browser.close()


if __name__ == "__main__":
    main()
