"""Precision and recall of detectors on real clouds with injected outliers: the docs' figure.

A tenth of each cloud's points is added as outliers, as in ``bench_real.py``. The dots are verdicts
of detectors that have a cutoff of their own.

    python benchmarks/draw_precision_recall.py --out docs/images/precision_recall.png
"""

import argparse
import io

import matplotlib

matplotlib.use("agg")
import matplotlib.pyplot as plt
import numpy as np
from _real_clouds import inject, load_clouds
from bench_real import METHODS
from PIL import Image
from scipy.stats import rankdata
from sklearn.metrics import (
    average_precision_score,
    precision_recall_curve,
    precision_score,
    recall_score,
)

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


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", default="../shared/data", help="folder of real clouds")
    parser.add_argument("--out", default="docs/images/precision_recall.png")
    parser.add_argument("--limit", type=int, help="crop clouds to so many points")
    options = parser.parse_args()
    figure, axes = plt.subplots(1, 3, figsize=(12, 4), sharey=True, layout="constrained")
    clouds = load_clouds(options.data, list(CLOUDS), options.limit)
    for ax, cloud in zip(axes, clouds, strict=True):
        real = np.ones(len(cloud.points), dtype=bool) if cloud.noise is None else ~cloud.noise
        points, kind = inject(cloud.points[real], np.random.default_rng(0))
        truth = kind != "real"
        for method, label in DETECTORS.items():
            labels, outlyingness = METHODS[method](points, truth.mean())
            rank = rankdata(outlyingness, method="dense")
            precision, recall, _ = precision_recall_curve(truth, rank, drop_intermediate=True)
            (line,) = ax.plot(100 * recall, 100 * precision, label=label)
            flagged = labels == -1
            if "told" not in method:
                at = recall_score(truth, flagged), precision_score(truth, flagged)
                ax.plot(100 * at[0], 100 * at[1], "o", color=line.get_color())
            print(f"{cloud.name:24}{label:24}{100 * average_precision_score(truth, rank):8.1f}")
        ax.set(title=CLOUDS[cloud.name], xlabel="recall: outliers flagged (%)", ylim=(0, 103))
        ax.grid(alpha=0.3)
    axes[0].set_ylabel("precision: outliers among the flagged (%)")
    axes[0].legend(loc="lower left", fontsize=9)
    picture = io.BytesIO()
    figure.savefig(picture, dpi=75)
    Image.open(picture).convert("RGB").quantize(64).save(options.out, optimize=True)


if __name__ == "__main__":
    main()
