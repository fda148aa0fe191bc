"""What the pictures of the pages share: the scan of the first pages, colors, and small files."""

import io
from functools import cache
from pathlib import Path

import matplotlib

matplotlib.use("agg")
import matplotlib.pyplot as plt
import numpy as np
from PIL import Image

from sklearn_mcmd import (
    MCMDOutlierDetector,
    RegionGrowing,
    RobustNormalEstimator,
    SharpFeatureDetector,
)
from sklearn_mcmd.datasets import make_street

FOLDER = Path(__file__).parent / "images" / "guide"
DPI = 110
# Okabe and Ito's colors, which the common color blindnesses keep apart.
GRAY, RED, BLUE, GREEN = "#9aa3ad", "#d55e00", "#0072b2", "#009e73"
VIEW = (-64.0, 26.0)  # of edges
plt.rcParams.update({"font.size": 10, "axes.spines.top": False, "axes.spines.right": False})


@cache
def street():
    """The street that `mcmd demo` writes: 60,000 points, a tenth of them outliers."""
    scan = make_street(60_000, outlier_share=0.1, random_state=0)
    scan.data = np.round(scan.data, 4)
    return scan


@cache
def detector():
    return MCMDOutlierDetector(random_state=0).fit(street().data)


@cache
def kept():
    return street().data[detector().scores_ >= detector().offset_]


@cache
def normals():
    return RobustNormalEstimator(random_state=0).fit(kept())


@cache
def regions():
    return RegionGrowing(random_state=0).fit(kept())


@cache
def creases():
    return SharpFeatureDetector(random_state=0).fit(kept())


def save(fig, name, quality=84):
    """Write a picture: few colors for drawings, JPEG for clouds."""
    raw = io.BytesIO()
    fig.savefig(raw, format="png", dpi=DPI, facecolor="white")
    plt.close(fig)
    picture = Image.open(raw).convert("RGB")
    if name.endswith(".jpg"):
        write_jpg(picture, name, quality)
        return
    small = picture.quantize(96, dither=Image.Dither.NONE)
    small.save(FOLDER / name, optimize=True)
    report(name)


def write_jpg(picture, name, quality):
    """Write a JPEG that is smaller than 150 kB."""
    while True:
        picture.convert("RGB").save(FOLDER / name, quality=quality, optimize=True, progressive=True)
        if (FOLDER / name).stat().st_size < 150_000:
            break
        quality -= 6
    report(name)


def report(name):
    print(f"{name}: {(FOLDER / name).stat().st_size / 1000:.0f} kB", flush=True)
