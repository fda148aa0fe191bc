"""What a report says about regions."""

import numpy as np

from sklearn_mcmd._errors import counted
from sklearn_mcmd.plotting import SegmentationDisplay, region_colors
from sklearn_mcmd.report._contents import Contents, Table, note_if, percent, share
from sklearn_mcmd.report._maps import display_maps

LISTED = 20  # regions of the table
LEFT_OVER = 0.3  # share of points in no region; a street with foliage has a fifth
SMALL = 100  # points; fewer make a small region
PIECES = 0.2  # share of points in small regions, of a cloud that falls to pieces


def segment_contents(shown, sizes, n_regions, inside):
    """The contents of a report of `mcmd segment`.

    What is shown has ``region``. `sizes` are of all regions, or of the largest; they, `n_regions`,
    and the points `inside` of them are of the whole.
    """
    sizes, n_all = np.asarray(sizes, dtype=np.int64), shown.n_all
    xyz, labels = shown.xyz[shown.near], shown.cloud.attributes["region"][shown.near]
    what = "Regions as colors, points of none dark gray"
    return Contents(
        shown,
        headline=f"{counted(n_regions, 'region', 'hold')} {share(inside, n_all)}.",
        results=[
            ("regions", f"{n_regions:,}"),
            ("points of no region", share(n_all - inside, n_all)),
            ("points of the largest region", share(int(sizes[0]) if len(sizes) else 0, n_all)),
        ],
        maps=display_maps(what, SegmentationDisplay(xyz, labels)),
        tables=_largest(shown.cloud, sizes[:LISTED], n_all),
        notes=_notes(inside, n_all, sizes if 1 < len(sizes) == n_regions else sizes[:0]),
        checks="many points without a region, many small regions",
        output=f"{n_all:,} points{shown.files}, with region (0 is the largest, -1 is none)",
    )


def _largest(cloud, sizes, n_all):
    """A table of the largest regions with size, and direction, noise and place of their points."""
    from matplotlib.colors import to_hex

    rows = []
    for region, size in enumerate(sizes.tolist()):
        xyz, normal = cloud.xyz[cloud.attributes["region"] == region], np.full(3, np.nan)
        middle, error = normal, np.nan
        if len(xyz) > 3:
            middle = xyz.mean(axis=0)
            values, axes = np.linalg.eigh(np.cov((xyz - middle).T, bias=True))
            normal = axes[:, 0] * (1.0 if axes[2, 0] >= 0 else -1.0)
            error = np.sqrt(max(values[0], 0.0))
        tilt = np.degrees(np.arccos(np.clip(normal[2], 0.0, 1.0)))
        rows.append(
            (
                region,
                f"{size:,}",
                percent(size, n_all),
                " ".join(f"{value + 0.0:.3f}" for value in np.round(normal, 3)),
                f"{tilt:.1f}°",
                f"{error:.2g}",
                " ".join(f"{value:.9g}" for value in middle),
            )
        )
    header = ("region", "points", "share", "normal", "tilt", "rms", "middle")
    colors = [to_hex(color) for color in region_colors(np.arange(len(rows)))]
    words = (
        "Tilt is the angle to the horizontal: 0° for a floor, 90° for a wall. Rms is the distance "
        "of the points from the region's plane, so a curved region has a large one."
    )
    table = Table("The largest regions", rows, header, (1, 2, 4, 5), words, colors)
    return [table] if rows else []


def _notes(inside, n_all, sizes):
    """Warnings of many points without a region, or in small ones, if the sizes of all are known."""
    in_small = int(sizes[sizes < SMALL].sum())
    return note_if(
        n_all - inside > LEFT_OVER * n_all,
        "Many points without a region.",
        f"{share(n_all - inside, n_all, 'belong')} to no region: foliage, outliers, surfaces that "
        "are too noisy or too curved for the limits.",
        "Denoise the cloud first. If surfaces are missing, give a larger --max-angle or more "
        "--n-neighbors.",
    ) + note_if(
        in_small > PIECES * n_all,
        "Many small regions.",
        f"{share(in_small, n_all, 'are')} in regions of less than {SMALL} points: surfaces fall to "
        "pieces, or the cloud is full of small things.",
        "Give more --n-neighbors for smoother normals, or a larger --min-region-size.",
    )
