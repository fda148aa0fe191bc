"""What reports say about edges, normals and regions."""

import numpy as np

from sklearn_mcmd._errors import counted
from sklearn_mcmd.plotting import NormalsDisplay, SegmentationDisplay, region_colors
from sklearn_mcmd.report._contents import Contents, Table, note_if, percent, share
from sklearn_mcmd.report._maps import display_maps, fullest_cells, marked_maps

MANY = 0.4  # share of edge points, of areas and not of lines; machined parts have a third
# Degrees of standard error; the true normal is within 17 of it, and growing separates faces at 15.
UNRELIABLE = 10.0
SOME = 0.05  # share of unreliable normals that is worth a warning; edges and rims have less
HALF = 0.4  # removed share of a neighborhood that holds two things of about one size
LISTED = 20  # regions of the table
LEFT_OVER = 0.3  # share of points in no region; a street with foliage has a fifth
SMALL = 100  # points; fewer make a small region
PIECES = 0.2  # share of points in small regions, of a cloud that falls to pieces


def edges_contents(shown, criterion, n, limit, more_rows):
    """The contents of a report of `mcmd edges`, of whose points `n` are of edges.

    What is shown has ``edge`` and ``edge_score``. The limit is of scores; None is the least value
    of an edge. `more_rows` follow in the table of results.
    """
    n_all, xyz, near = shown.n_all, shown.xyz, shown.near
    is_edge = shown.cloud.attributes["edge"] > 0
    if limit is None:
        values = shown.cloud.attributes["edge_score"].astype(np.float64)
        limit = values[is_edge].min(initial=values.max())
    what = "distance from a crease, in spacings" if criterion == "crease" else criterion
    return Contents(
        shown,
        headline=f"{share(n, n_all, 'lie')} on edges.",
        results=[
            ("edge points", share(n, n_all)),
            (f"limit of {what}", f"{limit:.3g}"),
            *more_rows,
        ],
        maps=marked_maps(xyz, is_edge, near, "edge point"),
        tables=fullest_cells(xyz, is_edge, near, "edge points"),
        notes=_notes_on_edges(n, n_all),
        checks="edges that are areas, no edges",
        output=f"{n_all:,} points{shown.files}, with edge and edge_score",
    )


def _notes_on_edges(n, n_all):
    """Warnings of no edges, or of edges that are areas."""
    return note_if(
        n == 0,
        "No edges.",
        "No point lies on an edge: there are none, they are blunter than --min-angle, or the "
        "neighborhoods do not see two faces.",
        "Give a smaller --min-angle or more --n-neighbors.",
    ) + note_if(
        n > MANY * n_all,
        "Edges that are areas.",
        f"{share(n, n_all, 'lie')} on edges. Lines take few points: these are things as narrow as "
        "a neighborhood, foliage, or noise.",
        "Denoise the cloud first, or give a smaller --threshold or a larger --min-angle.",
    )


def normals_contents(shown, names, removed):
    """The contents of a report of `mcmd normals`.

    What is shown has the columns that were written, by their names, and ``normal_error``, if it is
    known. `removed` is the mean share of a neighborhood that was removed.
    """
    columns, n_all, xyz, near = shown.cloud.attributes, shown.n_all, shown.xyz, shown.near
    normals = np.column_stack([columns[f"normal_{axis}"] for axis in "xyz"]).astype(np.float64)
    errors, results, tables = columns.get("normal_error"), [], []
    headline = f"{n_all:,} points have normals."
    if errors is not None:
        finite, unreliable = errors[np.isfinite(errors)], ~(errors <= UNRELIABLE)
        median, most = np.quantile(finite, [0.5, 0.95]) if finite.size else (np.nan, np.nan)
        headline += f" Half of these are exact to {median:.2g} degrees, 95 % to {most:.2g} "
        headline += "(standard errors)."
        n = int(np.count_nonzero(unreliable))
        name = f"unreliable normals, whose standard error is above {UNRELIABLE:g}°"
        results = [
            ("standard error", f"{median:.2g}° (median), 95 % to {most:.2g}°"),
            (name, share(n, len(errors), noun="normal")),
        ]
        tables = fullest_cells(xyz, unreliable, near, "unreliable normals")
    results += [
        ("surface variation (median)", f"{np.median(columns['surface_variation']):.2g}"),
        ("removed of a neighborhood (mean)", percent(removed, 1.0)),
    ]
    return Contents(
        shown,
        headline=headline,
        results=results,
        maps=display_maps("Normals as colors", NormalsDisplay(xyz[near], normals[near])),
        tables=tables,
        notes=_notes_on_normals(errors, columns["removed_fraction"]),
        checks="unreliable normals, neighborhoods of two things",
        output=f"{n_all:,} points{shown.files}, with {', '.join(names)}",
    )


def _notes_on_normals(errors, removed):
    """Notes on standard errors, None if they are not known, and on removed shares."""
    n_all, n_half = len(removed), int(np.count_nonzero(removed > HALF))
    n = 0 if errors is None else int(np.count_nonzero(~(errors <= UNRELIABLE)))
    return note_if(
        n > SOME * n_all,
        "Unreliable normals.",
        f"{share(n, n_all, 'have', 'normal')} a standard error above {UNRELIABLE:g} degrees: their "
        "neighborhoods are sparse, narrow or noisy.",
        "Give more --n-neighbors, or --n-neighbors auto, and look at the table of places.",
    ) + note_if(
        n_half > SOME * n_all,
        "Neighborhoods of several things.",
        f"For {share(n_half, n_all)} more than {100 * HALF:g} % of the neighborhood was removed: "
        "it reaches over an edge, into foliage, or holds many outliers.",
        "Denoise the cloud first, or give a smaller --n-neighbors.",
    )


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
        notes=_notes_on_regions(inside, n_all, sizes if 1 < len(sizes) == n_regions else sizes[:0]),
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


def _notes_on_regions(inside, n_all, sizes):
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
