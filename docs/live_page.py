"""The live page on the front of the docs: the demo's street before and after, to turn and to zoom.

Each build of the pages makes it, as `live/street.html`: 60,000 points, cleaned and not, with a
slider between them. `python docs/live_page.py FOLDER` makes it alone.
"""

import sys
from pathlib import Path

import numpy as np

from sklearn_mcmd import MCMDOutlierDetector
from sklearn_mcmd.datasets import make_street
from sklearn_mcmd.io import PointCloud
from sklearn_mcmd.plotting import view

PAGE = "live/street.html"
N_POINTS = 60_000  # of the demo


def write_page(folder, n_points=N_POINTS):
    """Write the page below the folder, and return its path."""
    path = Path(folder) / PAGE
    path.parent.mkdir(parents=True, exist_ok=True)
    xyz = np.round(make_street(n_points, outlier_share=0.1, random_state=0).data, 4)
    scores = -MCMDOutlierDetector(random_state=0).fit(xyz).scores_
    scan = PointCloud(xyz, {"outlier_score": np.minimum(scores, 100)})
    return view(scan, scan.subset(scores <= 3), names=["scanned", "cleaned"]).save(path)


def write_of_build(app, error):
    if error is None and app.builder.name == "html":
        write_page(app.outdir)


def setup(app):
    app.connect("build-finished", write_of_build)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


if __name__ == "__main__":
    print(write_page(sys.argv[1]))
