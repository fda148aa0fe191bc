"""What a report says about regions."""

from typing import NamedTuple

import numpy as np

from sklearn_mcmd.io._point_cloud import with_results
from sklearn_mcmd.report._contents import Contents, Note, Section, percent, share
from sklearn_mcmd.report._facts import Facts
from sklearn_mcmd.report._histogram import histogram
from sklearn_mcmd.report._html import paragraph, table
from sklearn_mcmd.report._maps import maps
from sklearn_mcmd.report._notes import CHECKS, cloud_notes

__all__ = [
    "LISTED",
    "Regions",
    "left_over_notes",
    "region_maps",
    "region_table",
    "segment_contents",
]

LISTED = 20  # regions of the table
# Share of points in no region that is worth a warning: a street with foliage has a fifth.
LEFT_OVER = 0.3
# Regions below this size are small, and this share of the points in them is worth a warning: the
# cloud then falls to pieces.
SMALL, PIECES = 100, 0.2


class Regions(NamedTuple):
    """What a table of regions shows.

    sizes : sequence of int
    normals, centroids : ndarray of shape (n_regions, 3)
    errors : ndarray of shape (n_regions,)
        Root mean square distances from their planes.
    """

    sizes: np.ndarray
    normals: np.ndarray
    centroids: np.ndarray
    errors: np.ndarray


def segment_contents(cloud, growing):
    """The contents of a report of `mcmd segment`.

    Parameters
    ----------
    cloud : PointCloud
        As it was read.
    growing : RegionGrowing
        Fitted to it.
    """
    labels, sizes, n_all = growing.labels_, growing.region_sizes_, len(cloud)
    estimator = growing.normal_estimator_
    facts = Facts.of(cloud.xyz, int(np.median(estimator.n_neighbors_)), estimator.plane_scale_)
    inside = int(np.count_nonzero(labels >= 0))
    largest = int(sizes[0]) if len(sizes) else 0
    regions = Regions(
        sizes, growing.region_normals_, growing.region_centroids_, growing.region_errors_
    )
    sections = [
        Section("Regions", region_maps(cloud.xyz, labels, facts.near)),
        Section("The largest regions", region_table(regions, n_all)),
    ]
    if len(sizes) > 1:
        sections.append(
            Section(
                "Sizes",
                histogram(
                    sizes, name="points of a region", least=float(sizes.min()), what="regions"
                )
                + _size_words(sizes, n_all),
            )
        )
    return Contents(
        headline=f"{len(sizes):,} regions hold {share(inside, n_all)}.",
        cards=[
            (f"{len(sizes):,}", "regions"),
            (f"{inside:,}", f"points inside, {percent(inside, n_all)}"),
            (f"{n_all - inside:,}", f"points of no region, {percent(n_all - inside, n_all)}"),
            (f"{largest:,}", f"points of the largest, {percent(largest, n_all)}"),
        ],
        notes=_notes(inside, n_all, sizes) + cloud_notes(facts),
        checks=f"many points without a region, many small regions, {CHECKS}",
        sections=sections,
        cloud_rows=facts.rows(cloud),
        output=f"{n_all:,} points, with region (0 is the largest, -1 is none)",
        shown=with_results(cloud, {"region": labels.astype(np.int32)}),
    )


def region_maps(xyz, labels, near):
    """Maps of a color for each region."""
    from sklearn_mcmd.plotting import SegmentationDisplay

    def draw(rows, view, ax, max_points):
        SegmentationDisplay(xyz[rows], labels[rows]).plot(view=view, ax=ax, max_points=max_points)

    words = paragraph("Each region has a color; points of no region are dark gray.", "soft")
    return words + maps(draw, xyz, near)


def region_table(regions, n_all):
    """The largest regions with size, direction, noise and place."""
    from matplotlib.colors import to_hex

    from sklearn_mcmd.plotting import region_colors

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


def _size_words(sizes, n_all):
    small = sizes < SMALL
    return paragraph(
        f"{share(int(small.sum()), len(sizes), 'regions')} have fewer than {SMALL} points. They "
        f"hold {percent(int(sizes[small].sum()), n_all)} of all points."
    )


def left_over_notes(inside, n_all):
    """A warning of many points without a region, if they are many."""
    if n_all - inside <= LEFT_OVER * n_all:
        return []
    return [
        Note(
            "Many points without a region.",
            f"{share(n_all - inside, n_all)} belong to no region: foliage, outliers, or "
            "surfaces that are too noisy or too curved for the limits.",
            "Denoise the cloud first. If surfaces are missing, give a larger --max-angle or "
            "more --n-neighbors.",
        )
    ]


def _notes(inside, n_all, sizes):
    notes = left_over_notes(inside, n_all)
    in_small = int(sizes[sizes < SMALL].sum())
    if in_small > PIECES * n_all:
        notes.append(
            Note(
                "Many small regions.",
                f"{share(in_small, n_all)} are in regions of fewer than {SMALL} points: surfaces "
                "fall to pieces, or the cloud is full of small things.",
                "Give more --n-neighbors for smoother normals, or a larger --min-region-size.",
            )
        )
    return notes
