"""Precision and recall from scores: the docs' figures.

Real clouds with injected outliers: a tenth of each cloud's points is added as outliers, as in
``bench_real.py``. The dots are verdicts of detectors that have a cutoff of their own.

    python benchmarks/draw_precision_recall.py --out docs/images/precision_recall.png

Simulated scans, without and with the position of the sensor, where a tenth are outliers:

    python benchmarks/draw_precision_recall.py --sensor
"""

import argparse
import io

import matplotlib

matplotlib.use("agg")
import matplotlib.pyplot as plt
import numpy as np
from _real_clouds import inject, load_clouds
from _real_methods import METHODS
from PIL import Image
from scipy.stats import rankdata
from simulators import make_mobile_scan
from sklearn.metrics import (
    average_precision_score,
    precision_recall_curve,
    precision_score,
    recall_score,
)

from sklearn_mcmd import MCMDOutlierDetector
from sklearn_mcmd.datasets import make_lidar_turn, make_street

# In the order of `load_clouds`. Their licences are CC0, BSD and BSD.
CLOUDS = {
    "ahn3_amsterdam_2397": "airborne, city",
    "autzen_trim": "airborne, hillside with trees",
    "isprs_samp31": "airborne, town, overlapping swaths",
}
DETECTORS = {
    "default": "MCMDOutlierDetector()",
    "SOR 20": "SOR, 20 neighbors",
    "LOF, told": "LocalOutlierFactor",
    "IsolationForest, told": "IsolationForest",
}


# Of the detector, for simulated scans.
FORMS = {
    "coordinates alone": {},
    'coordinates alone, strictness="isolated"': {"strictness": "isolated"},
    "the sensor's position known": {"known": True},
}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sensor", action="store_true", help="simulated scans, two ways")
    parser.add_argument("--data", default="../shared/data", help="folder of real clouds")
    parser.add_argument("--out", help="default: the docs' picture")
    parser.add_argument("--limit", type=int, help="crop clouds to so many points")
    parser.add_argument("--points", type=int, default=30_000, help="of each simulated scan")
    options = parser.parse_args()
    panels = simulated(options.points) if options.sensor else real(options.data, options.limit)
    figure, axes = plt.subplots(1, 3, figsize=(12, 4), sharey=True, layout="constrained")
    for ax, (title, curves) in zip(axes, panels, strict=True):
        for label, (truth, outlyingness, flagged) in curves:
            rank = rankdata(outlyingness, method="dense")
            precision, recall, _ = precision_recall_curve(truth, rank, drop_intermediate=True)
            (line,) = ax.plot(100 * recall, 100 * precision, label=label)
            if flagged is not None:
                at = recall_score(truth, flagged), precision_score(truth, flagged)
                ax.plot(100 * at[0], 100 * at[1], "o", color=line.get_color())
            print(f"{title:36}{label:44}{100 * average_precision_score(truth, rank):8.1f}")
        ax.set(title=title, xlabel="recall: outliers flagged (%)", ylim=(0, 103))
        ax.grid(alpha=0.3)
    axes[0].set_ylabel("precision: outliers among the flagged (%)")
    axes[0].legend(loc="lower left", fontsize=9)
    picture = io.BytesIO()
    figure.savefig(picture, dpi=75)
    name = "precision_recall_sensor.png" if options.sensor else "precision_recall.png"
    out = options.out or f"docs/images/{name}"
    Image.open(picture).convert("RGB").quantize(64).save(out, optimize=True)


def real(folder, limit):
    """Title and curves of each real cloud: label, truth, scores, and what is flagged or None."""
    for cloud in load_clouds(folder, list(CLOUDS), limit):
        kept = np.ones(len(cloud.points), dtype=bool) if cloud.noise is None else ~cloud.noise
        points, kind = inject(cloud.points[kept], np.random.default_rng(0))
        truth, curves = kind != "real", []
        for method, label in DETECTORS.items():
            labels, outlyingness = METHODS[method](points, truth.mean())
            flagged = None if "told" in method else labels == -1
            curves.append((label, (truth, outlyingness, flagged)))
        yield CLOUDS[cloud.name], curves


def simulated(n):
    """The same of simulated scans."""
    how = {"outlier_share": 0.1, "random_state": 0}
    street = make_street(n, sampling="scan_lines", tree=True, **how)
    mobile = make_mobile_scan(n, far_share=0, **how)
    turn = make_lidar_turn(n, outlier_kinds=("particle", "mixed_pixel"), **how)
    for title, made, position in (
        ("street in scan lines, tree", street, street.sensor_origins[0]),
        ("mobile scan", mobile, mobile.sensor_origins),
        ("spinning turn", turn, turn.sensor_origins),
    ):
        curves = []
        for label, form in FORMS.items():
            form = dict(form)
            origins = position if form.pop("known", False) else None
            detector = MCMDOutlierDetector(random_state=0, **form)
            detector.fit(made.data, sensor_origin=origins)
            flagged = detector.scores_ < detector.offset_
            curves.append((label, (made.target == -1, -detector.scores_, flagged)))
        yield title, curves


if __name__ == "__main__":
    main()
