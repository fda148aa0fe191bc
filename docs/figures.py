"""The pictures of links, of the front page, of the first scan and of the guides, from one command.

python docs/figures.py                 # all of them, in docs/images/guide
python docs/figures.py preview doors   # these two

Clouds are simulated with fixed seeds, and results are those of the estimators. The pictures of
pages (``browser_pages``) need playwright and a browser: ``--browser /usr/bin/chromium``.
"""

import argparse
import io
import subprocess
import sys
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from figures_common import (
    DPI,
    FOLDER,
    VIEW,
    creases,
    detector,
    kept,
    normals,
    regions,
    save,
    street,
    write_jpg,
)
from figures_guides import GUIDE_PICTURES
from PIL import Image

from sklearn_mcmd.io import PointCloud, write_points
from sklearn_mcmd.plotting import (
    EdgeDisplay,
    NormalsDisplay,
    OutlierDisplay,
    SegmentationDisplay,
    normal_colors,
    plot_cloud,
    region_colors,
)

SOFTWARE_RENDERING = [
    *("--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader"),
    *("--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"),
]
DRAWN = "cloudPage.loaded && !cloudPage.renderer.moving && !cloudPage.renderer.scheduled"


def preview():
    """What links to the pages show, 1200 by 630: the street before and after."""
    fig, axes = plt.subplots(1, 2, figsize=(1200 / DPI, 630 / DPI), layout="constrained")
    flagged = detector().scores_ < detector().offset_
    plot_cloud(street().data, outliers=flagged, ax=axes[0])
    plot_cloud(kept(), color=normal_colors(normals().normals_), ax=axes[1])
    axes[1].set(xlim=axes[0].get_xlim(), ylim=axes[0].get_ylim())
    fig.suptitle("sklearn_mcmd cleans a laser scan without a parameter", fontsize=24)
    save(fig, "../../_static/preview.jpg")


def doors():
    """One small picture for each thing that the package does, of the same place."""
    for name, draw in {
        "door_clean": lambda ax: plot_cloud(
            street().data, outliers=detector().scores_ < detector().offset_, ax=ax
        ),
        "door_normals": lambda ax: plot_cloud(
            kept(), color=normal_colors(normals().normals_), ax=ax
        ),
        "door_segments": lambda ax: plot_cloud(
            kept(), color=region_colors(regions().labels_), ax=ax
        ),
        "door_edges": lambda ax: EdgeDisplay.from_estimator(creases(), kept(), view=VIEW, ax=ax),
    }.items():
        fig, ax = plt.subplots(figsize=(4.2, 3.3), layout="constrained")
        draw(ax)
        ax.set_title("")
        for bar in [*ax.artists]:
            bar.remove()
        low, high = np.percentile(np.asarray(ax.collections[0].get_offsets()), [2, 98], axis=0)
        ax.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
        save(fig, f"{name}.jpg", quality=80)


def first_scan():
    for name, draw in {
        "found": lambda ax: OutlierDisplay.from_predictions(
            street().data, detector().predict(street().data), ax=ax
        ),
        "normals": lambda ax: NormalsDisplay.from_estimator(normals(), kept(), ax=ax),
        "segments": lambda ax: SegmentationDisplay.from_estimator(regions(), kept(), ax=ax),
        "edges": lambda ax: EdgeDisplay.from_estimator(creases(), kept(), ax=ax),
    }.items():
        fig, ax = plt.subplots(figsize=(7.6, 5.2), layout="constrained")
        draw(ax)
        save(fig, f"first_scan_{name}.jpg")


def browser_pages(browser):
    """Pages that ``mcmd view`` and ``--report`` make, in a browser."""
    from playwright.sync_api import sync_playwright

    from sklearn_mcmd.plotting import view

    scores = -detector().scores_
    marked = PointCloud(
        street().data,
        {
            "outlier_score": scores.astype(np.float32),
            "classification": np.where(scores > -detector().offset_, 7, 0).astype(np.uint8),
        },
    )
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as play:
        folder = Path(folder)
        files = folder / "marked.laz", folder / "clean.laz"
        for file, cloud in zip(files, (marked, PointCloud(kept())), strict=True):
            write_points(file, cloud)
        view(files[0]).save(folder / "first_scan_page.html")
        view(*files).save(folder / "view_compare.html")
        command = ["denoise", str(files[0]), str(folder / "out.laz"), "--report", str(folder)]
        subprocess.run([sys.executable, "-m", "sklearn_mcmd", *command], check=True)
        window = play.chromium.launch(executable_path=browser, args=SOFTWARE_RENDERING)
        for name in ("first_scan_page", "view_compare", "report"):
            page = window.new_page(viewport={"width": 1200, "height": 680}, color_scheme="light")
            file = folder / ("index.html" if name == "report" else f"{name}.html")
            page.goto(file.as_uri())
            while name != "report" and not page.evaluate(f"Boolean({DRAWN})"):
                page.wait_for_timeout(200)
            write_jpg(Image.open(io.BytesIO(page.screenshot())), f"{name}.jpg", quality=82)
        window.close()


PICTURES = {
    function.__name__: function for function in (preview, doors, first_scan, *GUIDE_PICTURES)
}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", help=f"of {', '.join(PICTURES)}, browser_pages")
    parser.add_argument("--browser", help="Chromium, for browser_pages")
    options = parser.parse_args()
    FOLDER.mkdir(parents=True, exist_ok=True)
    names = options.names or [*PICTURES, *(["browser_pages"] if options.browser else [])]
    for name in names:
        if name == "browser_pages":
            browser_pages(options.browser)
        else:
            PICTURES[name]()


if __name__ == "__main__":
    main()
