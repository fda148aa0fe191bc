"""Store what ``mcmd demo`` gives: its shares of outliers, and its picture.

mcmd demo && python benchmarks/demo_figures.py mcmd-demo

A test runs the demo and compares. README.md and the docs quote the shares.
"""

import argparse
import csv
from pathlib import Path

import numpy as np
from PIL import Image

from sklearn_mcmd.datasets import make_street
from sklearn_mcmd.io import read_points

DOCS = Path(__file__).resolve().parents[1] / "docs"
COLORS = 160  # of the picture's palette, which reduces its file to a third
CLEANED = {"coordinates": "clean.laz", "position": "clean_sensor.laz"}


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="that of mcmd demo")
    parser.add_argument("--output", type=Path, default=DOCS, help="docs/ unless given")
    options = parser.parse_args(arguments)
    with open(options.output / "benchmarks" / "demo.csv", "w", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows(table(options.folder))
    picture(options.folder).save(options.output / "images" / "demo.png", optimize=True)


def picture(folder):
    """The demo's picture in few colors."""
    drawn = Image.open(folder / "demo.png").convert("RGB")
    return drawn.quantize(COLORS, dither=Image.Dither.NONE)


def table(folder):
    """Percent of outliers found, of real points kept, of right labels, of each kind found."""
    kinds = make_street(1_000, random_state=0).outlier_kind_names[1:]
    before = counts(folder / "street.laz", len(kinds))
    rows = [["cleaned by", "found", "kept", "right", *kinds]]
    for name, file in CLEANED.items():
        kept = counts(folder / file, len(kinds))
        removed = before[1:] - kept[1:]
        right = (removed.sum() + kept[0]) / before.sum()
        shares = [
            removed.sum() / before[1:].sum(),
            kept[0] / before[0],
            right,
            *removed / before[1:],
        ]
        rows.append([name, *(f"{100 * share:.2f}" for share in shares)])
    return rows


def counts(path, n_kinds):
    """Numbers of real points and of each kind of outliers in a file of the demo."""
    return np.bincount(read_points(path).attributes["outlier_kind"], minlength=1 + n_kinds)


if __name__ == "__main__":
    main()
