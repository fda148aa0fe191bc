"""Does it help region growing to remove outliers first?

Regions of a cloud as it is, and after the detector at each strictness. "flagged" and "no region"
are shares of the real points, in percent; a flagged point has no region. The truth of simulated
streets is known. "pure" is the share of the points in regions that are of their region's main
surface, which outliers in regions lower. "mean IoU" is that of the surfaces of 100 points or
more, which points without a region lower. In real clouds all points count as real.

    python benchmarks/bench_denoised_regions.py --seeds 3
    python benchmarks/bench_denoised_regions.py --clouds ../shared/data/pcl_building_region_growing
"""

import argparse
import warnings
from pathlib import Path

import numpy as np

DENOISED = ("no", "isolated", "groups", "surfaces")
SMALLEST = 100  # points of a surface that counts
HEAD = ("flagged", "no region", "pure", "mean IoU", "Rand", "regions")


def regions_after(strictness, X, threads):
    """Which points are kept, and the regions of all, -1 for none."""
    from sklearn_mcmd import MCMDOutlierDetector, RegionGrowing

    kept = np.ones(len(X), dtype=bool)
    if strictness != "no":
        detector = MCMDOutlierDetector(strictness=strictness, random_state=0, n_jobs=threads)
        kept = detector.fit_predict(X) == 1
    labels = np.full(len(X), -1)
    labels[kept] = RegionGrowing(random_state=0, n_jobs=threads).fit_predict(X[kept])
    return kept, labels


def figures(kept, labels, surface):
    """A row of the table; what only a truth tells is NaN without one."""
    real = np.ones(len(labels), dtype=bool) if surface is None else surface >= 0
    row = [100 * (~kept[real]).mean(), 100 * (labels[real] < 0).mean(), *[np.nan] * 3]
    if surface is not None:
        from sklearn_mcmd.metrics import segmentation_scores

        inside = labels >= 0
        pairs = np.zeros((labels.max() + 1, surface.max() + 2), dtype=int)
        np.add.at(pairs, (labels[inside], surface[inside]), 1)  # the last column has outliers
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # undefined ratios print as nan
            scores = segmentation_scores(surface, labels)
        large = scores.surface_sizes >= SMALLEST
        row[2] = 100 * pairs[:, :-1].max(axis=1).sum() / pairs.sum()
        row[3:] = 100 * scores.surface_iou[large].mean(), 100 * scores.adjusted_rand
    return [*row, labels.max() + 1]


def clouds(options):
    """Title, points and true surfaces of each cloud; several of one title are averaged."""
    for path in options.clouds or ():
        with np.load(Path(path) / "cloud.npz") as arrays:
            yield Path(path).name, arrays["xyz"].astype(np.float64), None
    if options.clouds:
        return
    from sklearn_mcmd.datasets import make_street

    for share in options.shares:
        for seed in range(options.seeds):
            street = make_street(options.size, outlier_share=share, random_state=seed)
            title = f"streets of {options.size:,} points, {100 * share:g} % outliers"
            yield title, street.data, street.surface


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--clouds", nargs="+", help="folders with cloud.npz, instead of streets")
    parser.add_argument("--size", type=int, default=100_000)
    parser.add_argument("--shares", type=float, nargs="+", default=[0.0, 0.1, 0.2])
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--threads", type=int, default=2)
    options = parser.parse_args()
    tables = {}
    for title, X, surface in clouds(options):
        rows = tables.setdefault(title, {})
        for strictness in DENOISED:
            kept, labels = regions_after(strictness, X, options.threads)
            rows.setdefault(strictness, []).append(figures(kept, labels, surface))
    for title, rows in tables.items():
        print(f"\n{title}\n{'denoised':12}" + "".join(f"{name:>11}" for name in HEAD))
        for strictness, found in rows.items():
            cells = "".join(f"{value:11.2f}" for value in np.mean(found, axis=0))
            print(f"{strictness:12}{cells}", flush=True)


if __name__ == "__main__":
    main()
