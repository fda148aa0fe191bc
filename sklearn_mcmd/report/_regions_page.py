"""What a report says about regions."""

from typing import NamedTuple

import numpy as np

from sklearn_mcmd._errors import counted
from sklearn_mcmd.plotting import SegmentationDisplay, region_colors
from sklearn_mcmd.report._contents import note_if, percent, share
from sklearn_mcmd.report._histogram import histogram
from sklearn_mcmd.report._maps import maps
from sklearn_mcmd.report._rendering import paragraph, table

LISTED = 20  # regions of the table
LEFT_OVER = 0.3  # share of points in no region; a street with foliage has a fifth
SMALL = 100  # points; fewer make a small region
PIECES = 0.2  # share of points in small regions, of a cloud that falls to pieces


class Regions(NamedTuple):
    """What a table of regions shows, a row each, the largest first."""

    sizes: np.ndarray
    normals: np.ndarray
    centroids: np.ndarray
    errors: np.ndarray  # root mean square distances from their planes

    @classmethod
    def of_sample(cls, cloud, sizes):
        """The largest regions, with the planes of their points in a sample."""
        sizes = np.asarray(sizes[:LISTED], dtype=np.int64)
        normals, centroids = np.full((2, len(sizes), 3), np.nan)
        errors = np.full(len(sizes), np.nan)
        for region in range(len(sizes)):
            own = cloud.xyz[cloud.attributes["region"] == region]
            if len(own) > 3:
                centroids[region] = own.mean(axis=0)
                values, axes = np.linalg.eigh(np.cov((own - centroids[region]).T, bias=True))
                normals[region] = axes[:, 0] * (1.0 if axes[2, 0] >= 0 else -1.0)
                errors[region] = np.sqrt(max(values[0], 0.0))
        return cls(sizes, normals, centroids, errors)


def segment_contents(shown, regions, n_regions, inside):
    """The contents of a report of `mcmd segment`.

    What is shown has ``region``. `regions` are all, or the largest; `n_regions`, and the points
    `inside` of them, are of the whole.
    """
    sizes, n_all, labels = regions.sizes, shown.n_all, shown.cloud.attributes["region"]
    largest = int(sizes[0]) if len(sizes) else 0
    all_known = 1 < len(sizes) == n_regions
    words = paragraph("Each region has a color; points of no region are dark gray.", "soft")
    drawn = words + maps(SegmentationDisplay(shown.xyz, labels), shown.xyz, shown.near)
    sections = [("Regions", drawn), ("The largest regions", _region_table(regions, n_all))]

    if all_known:
        what = {"name": "points of a region", "least": float(sizes.min()), "what": "regions"}
        sections.append(("Sizes", histogram(sizes, **what)))
    return shown.contents(
        headline=f"{counted(n_regions, 'region', 'hold')} {share(inside, n_all)}.",
        cards=[
            (f"{n_all - inside:,}", f"points of no region, {percent(n_all - inside, n_all)}"),
            (f"{largest:,}", f"points of the largest, {percent(largest, n_all)}"),
        ],
        notes=_notes(inside, n_all, sizes if all_known else sizes[:0]),
        checks="many points without a region, many small regions",
        sections=sections,
        output=f"{n_all:,} points{shown.files}, with region (0 is the largest, -1 is none)",
    )


def _region_table(regions, n_all):
    """The largest regions with size, direction, noise and place."""
    from matplotlib.colors import to_hex

    sizes, normals = regions.sizes, regions.normals
    if len(sizes) == 0:
        return paragraph("There are no regions.")
    tilt = np.degrees(np.arccos(np.clip(np.abs(normals[:, 2]), 0.0, 1.0)))
    shown = range(min(LISTED, len(sizes)))
    rows = [
        (
            i,
            f"{sizes[i]:,}",
            percent(int(sizes[i]), n_all),
            " ".join(f"{value + 0.0:.3f}" for value in np.round(normals[i], 3)),
            f"{tilt[i]:.1f}°",
            f"{regions.errors[i]:.2g}",
            " ".join(f"{value:.7g}" for value in regions.centroids[i]),
        )
        for i in shown
    ]
    colors = [to_hex(color) for color in region_colors(np.array(shown))]
    header = ("region", "points", "share", "normal", "tilt", "rms", "middle")
    words = paragraph(
        "Tilt is the angle to the horizontal: 0° for a floor, 90° for a wall. Rms is the distance "
        "of the points from the region's plane, so a curved region has a large one.",
        "soft",
    )
    return table(header, rows, numbers=(1, 2, 4, 5), colors=colors) + words


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
