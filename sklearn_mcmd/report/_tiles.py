"""What a report says about runs by tiles: from the outputs, by a sample that it states."""

from functools import partial

import numpy as np

from sklearn_mcmd.io import PointCloud
from sklearn_mcmd.io._classes import HIGH_NOISE, LOW_NOISE
from sklearn_mcmd.io._las_parts import read_parts
from sklearn_mcmd.report._contents import Contents, Section, percent, share
from sklearn_mcmd.report._denoise import (
    LEAST_SCORE,
    grade_table,
    judged_notes,
)
from sklearn_mcmd.report._edges import edge_notes, score_words
from sklearn_mcmd.report._facts import bounds_rows, usual_rows
from sklearn_mcmd.report._histogram import histogram
from sklearn_mcmd.report._html import paragraph
from sklearn_mcmd.report._maps import found_maps
from sklearn_mcmd.report._normals import normals_maps, normals_notes, removed_words, tilt_table
from sklearn_mcmd.report._notes import together_notes
from sklearn_mcmd.report._places import Places, place_sections
from sklearn_mcmd.report._segment import (
    LISTED,
    Regions,
    left_over_notes,
    region_maps,
    region_table,
)

__all__ = ["denoised_tiles", "edges_of_tiles", "normals_of_tiles", "regions_of_tiles"]

SAMPLE = 500_000  # points; maps show a quarter of them, and shares are known to 0.1 %
PART = 1_000_000  # points that are read at a time
NOISE = (LOW_NOISE, HIGH_NOISE)  # the classes of outliers in LAS
CHECKS = "many outliers, many that lie together; the cloud itself is not measured by tiles"


def denoised_tiles(catalog, outputs, estimator, run, *, marked):
    """The contents of a report of `mcmd denoise` by tiles.

    Parameters
    ----------
    catalog : Catalog
        Of the inputs.
    outputs : list of Path
    estimator : MCMDOutlierDetector
        With the parameters of the run.
    run : RunReport
    marked : bool
        Whether outliers are marked, or dropped.
    """
    step = -(-run.n_points // SAMPLE)
    n, n_all, n_others = run.n_outliers, run.n_used, run.n_points - run.n_used
    sections, score, found = [], None, None
    if marked:
        cloud = _sample(outputs, step, ("outlier_score", "classification"))
        score = cloud.attributes["outlier_score"].astype(np.float64)
        judged = np.isfinite(score)
        cloud, score = cloud.subset(judged), score[judged]
        found = np.isin(cloud.attributes["classification"], NOISE)
    else:
        cloud, found = _with_removed(catalog.paths, outputs, step)
    xyz, near = cloud.xyz, usual_rows(cloud.xyz)
    notes = together_notes(run.together) + judged_notes(n, n_all)
    if found is None:
        sections.append(
            Section(
                "Where the outliers are",
                paragraph("The outputs replaced the inputs, or have other coordinates. --mode mark "
                          "keeps outliers, and then they have maps."),
            )
        )  # fmt: skip
    else:
        places = Places.of(xyz, found, near)
        words = _stated(len(xyz), n_all, step)
        drawn = words + found_maps(xyz, found, near, "outliers")
        sections.append(Section("Where the outliers are", drawn))
        if score is not None:
            cutoff = _cutoff(estimator, score, found)
            sections.append(
                Section(
                    "How clear they are",
                    words
                    + histogram(score, cutoff=cutoff, name="score", least=LEAST_SCORE)
                    + grade_table(score, cutoff),
                )
            )
        sections.append(
            Section("Places", words + place_sections(places, xyz, found, near, "outliers"))
        )
        cloud = cloud.with_attributes(outlier=found.astype(np.uint8))
    done = "are marked" if marked else "were removed"
    return Contents(
        headline=f"{share(n, n_all)} are outliers; they {done}.",
        cards=[
            (f"{n_all:,}", "points that were used" if n_others else "points in the input"),
            *([(f"{n_others:,}", "others, neither judged nor used")] if n_others else []),
            (f"{n:,}", f"outliers, {percent(n, n_all)}"),
            (f"{run.n_tiles:,}", "tiles"),
            (f"{len(catalog):,}", "input files"),
        ],
        notes=notes,
        checks=CHECKS,
        sections=sections,
        cloud_rows=_cloud_rows(catalog),
        output=f"{run.n_points - (0 if marked else n):,} points in {len(outputs):,} files",
        shown=cloud,
    )


def normals_of_tiles(catalog, outputs, names, run):
    """The contents of a report of `mcmd normals` by tiles.

    Parameters
    ----------
    catalog, outputs, run
        As above.
    names : sequence of str
        Of the columns that were written.
    """
    step = -(-run.n_points // SAMPLE)
    cloud = _sample(outputs, step, names)
    given, n_all = cloud.attributes, run.n_points
    normals = np.column_stack([given[f"normal_{axis}"] for axis in "xyz"]).astype(np.float64)
    words = _stated(len(cloud), n_all, step)
    near = usual_rows(cloud.xyz)
    sections = [Section("Normals", words + normals_maps(cloud.xyz, normals, near))]
    if "normal_error" in given:
        sections.append(
            Section(
                "How exact they are",
                histogram(given["normal_error"], name="standard error in degrees", least=0.01),
            )
        )
    sections += [
        Section("Flatness", histogram(given["surface_variation"], name="surface variation")),
        Section(
            "Directions and neighborhoods",
            tilt_table(normals) + removed_words(given["removed_fraction"]),
        ),
    ]
    variation = float(np.median(given["surface_variation"]))
    return Contents(
        headline=f"{n_all:,} points have normals. The median of the surface variation is "
        f"{variation:.2g}.",
        cards=[
            (f"{n_all:,}", "points"),
            (f"{variation:.2g}", "surface variation (median)"),
            (percent(run.removed_fraction, 1.0), "of a neighborhood removed, on average"),
            (f"{run.n_tiles:,}", "tiles"),
        ],
        notes=normals_notes(given.get("normal_error"), given["removed_fraction"]),
        checks="neighborhoods of several things; the cloud itself is not measured by tiles",
        sections=sections,
        cloud_rows=_cloud_rows(catalog),
        output=f"{n_all:,} points in {len(outputs):,} files, with {', '.join(names)}",
        shown=cloud,
    )


def regions_of_tiles(catalog, outputs, run):
    """The contents of a report of `mcmd segment` by tiles.

    Parameters
    ----------
    catalog, outputs, run
        As above.
    """
    step = -(-run.n_points // SAMPLE)
    cloud, n_all, inside = _sample(outputs, step, ("region",)), run.n_points, run.n_inside
    labels, words = cloud.attributes["region"], _stated(len(cloud), n_all, step)
    largest = run.largest[0] if run.largest else 0
    listed = words.replace(
        "From a sample", "Sizes are exact; normals, rms and middle are from a sample"
    )
    return Contents(
        headline=f"{run.n_regions:,} regions hold {share(inside, n_all)}.",
        cards=[
            (f"{run.n_regions:,}", "regions"),
            (f"{inside:,}", f"points inside, {percent(inside, n_all)}"),
            (f"{largest:,}", f"points of the largest, {percent(largest, n_all)}"),
            (f"{run.n_tiles:,}", "tiles"),
        ],
        notes=left_over_notes(inside, n_all),
        checks="many points without a region; the cloud itself is not measured by tiles",
        sections=[
            Section("Regions", words + region_maps(cloud.xyz, labels, usual_rows(cloud.xyz))),
            Section(
                "The largest regions",
                listed + region_table(_regions(cloud.xyz, labels, run.largest[:LISTED]), n_all),
            ),
        ],
        cloud_rows=_cloud_rows(catalog),
        output=f"{n_all:,} points in {len(outputs):,} files, with region (0 is the largest, -1 is "
        "none)",
        shown=cloud,
    )


def edges_of_tiles(catalog, outputs, detector, run):
    """The contents of a report of `mcmd edges` by tiles.

    Parameters
    ----------
    catalog, outputs, run
        As above.
    detector : SharpFeatureDetector
        With the parameters of the run.
    """
    step, is_crease = -(-run.n_points // SAMPLE), detector.criterion == "crease"
    cloud = _sample(outputs, step, ("edge", "edge_score"))
    n, n_all = run.n_edges, run.n_points
    xyz, found = cloud.xyz, cloud.attributes["edge"] > 0
    values, near = cloud.attributes["edge_score"].astype(np.float64), usual_rows(xyz)
    places, words = Places.of(xyz, found, near), _stated(len(cloud), n_all, step)
    name = "distance to the nearest crease, in spacings" if is_crease else detector.criterion
    draw = partial(histogram, name=name, above=not is_crease, cutoff_name="limit")
    # The limit of other criteria is that of the cloud: the least value of an edge is near to it.
    limit = detector._crease_width() if is_crease else values[found].min(initial=values.max())
    return Contents(
        headline=f"{share(n, n_all)} lie on edges.",
        cards=[
            (f"{n_all:,}", "points"),
            (f"{n:,}", f"edge points, {percent(n, n_all)}"),
            (f"{run.n_tiles:,}", "tiles"),
            (f"{len(catalog):,}", "input files"),
        ],
        notes=edge_notes(n, n_all),
        checks="edges that are areas, no edges; the cloud itself is not measured by tiles",
        sections=[
            Section("Where the edges are", words + found_maps(xyz, found, near, "edge points")),
            Section(
                "Scores",
                words + draw(values, cutoff=limit) + score_words(is_crease),
            ),
            Section("Places", words + place_sections(places, xyz, found, near, "edge points")),
        ],
        cloud_rows=_cloud_rows(catalog),
        output=f"{n_all:,} points in {len(outputs):,} files, with edge and edge_score",
        shown=cloud,
    )


def _regions(xyz, labels, sizes):
    """The largest regions, with the planes of their points in a sample."""
    normals, centroids = np.full((len(sizes), 3), np.nan), np.full((len(sizes), 3), np.nan)
    errors = np.full(len(sizes), np.nan)
    for region in range(len(sizes)):
        own = xyz[labels == region]
        if len(own) > 3:
            centroids[region] = own.mean(axis=0)
            values, axes = np.linalg.eigh(np.cov((own - centroids[region]).T, bias=True))
            normals[region] = axes[:, 0] * (1.0 if axes[2, 0] >= 0 else -1.0)
            errors[region] = np.sqrt(max(values[0], 0.0))
    return Regions(sizes, normals, centroids, errors)


def _stated(n, n_all, step):
    if step == 1:
        return ""
    return paragraph(f"From a sample: one point of {step:,}, {share(n, n_all)}.", "soft")


def _cloud_rows(catalog):
    rows = [("points", f"{catalog.n_points:,}"), ("files", f"{len(catalog):,}")]
    rows += bounds_rows(catalog.low, catalog.high)
    return [*rows, ("CRS", catalog.crs or "not stated")]


def _parts(paths):
    for path in paths:
        yield from read_parts(path, PART)


def _sample(paths, step, names):
    """Every so many-th point of files, with these attributes."""
    xyz, columns, first = [], {name: [] for name in names}, 0
    for part in _parts(paths):
        rows = slice((-first) % step, None, step)
        xyz.append(part.xyz[rows])
        for name in names:
            columns[name].append(part.attributes[name][rows])
        first += len(part)
    return PointCloud(
        np.concatenate(xyz), {name: np.concatenate(parts) for name, parts in columns.items()}
    )


def _with_removed(inputs, outputs, step):
    """A sample of inputs, and which of its points are not in the outputs; None if that is unknown.

    Outputs have the order of the inputs, and copies of a point have its score. So a point was
    removed if its coordinates are not among the next points of the output.
    """
    real = {path.resolve() for path in outputs}
    if any(path.resolve() in real for path in inputs):
        return _sample(outputs, step, ()), None
    xyz, found, first, n_kept, n_out = [], [], 0, 0, 0
    rest, waiting = _parts(outputs), np.empty(0, np.uint64)
    for part in _parts(inputs):
        while len(waiting) < len(part) and (after := next(rest, None)) is not None:
            waiting = np.concatenate([waiting, _keys(after.xyz)])
            n_out += len(after)
        kept = np.isin(_keys(part.xyz), waiting[: len(part)])
        n_part = int(np.count_nonzero(kept))
        waiting, n_kept = waiting[n_part:], n_kept + n_part
        rows = slice((-first) % step, None, step)
        xyz.append(part.xyz[rows])
        found.append(~kept[rows])
        first += len(part)
    cloud = PointCloud(np.concatenate(xyz))
    return cloud, np.concatenate(found) if n_kept == n_out and len(waiting) == 0 else None


def _keys(xyz):
    """A number for each place; two places have the same one in 2 ** 64 by chance."""
    bits = np.ascontiguousarray(xyz + 0.0).view(np.uint64)
    factors = np.array(
        [0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], dtype=np.uint64
    )
    mixed = bits ^ (bits >> np.uint64(29))
    return (mixed * factors).sum(axis=1, dtype=np.uint64)


def _cutoff(estimator, score, found):
    """The cutoff of a run; where the run found it itself, the largest score below it."""
    from sklearn_mcmd.outliers._detector import CUTOFF

    if estimator.cutoff is not None:
        return float(estimator.cutoff)
    simulated = estimator.contamination is not None or estimator.false_positive_rate is not None
    if simulated or estimator.strictness is None:
        return float(score[~found].max(initial=0.0))
    return CUTOFF
