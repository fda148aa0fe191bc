"""``mcmd segment``."""

from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from sklearn_mcmd.cli import _files, _messages, _options
from sklearn_mcmd.cli._config import Config
from sklearn_mcmd.cli._large import DryRun, Memory, Restart, large_catalog, print_plan
from sklearn_mcmd.cli._progress_bar import progress
from sklearn_mcmd.cli._region_files import check_regions_file, write_regions
from sklearn_mcmd.cli._reporting import ReportFolder, write_report_of
from sklearn_mcmd.cli._scheduler import Scheduler, engine
from sklearn_mcmd.io._files import replacing
from sklearn_mcmd.io._point_cloud import has_colors, with_results

__all__ = ["segment"]

LARGEST_SHOWN = 3


def segment(
    source: _options.InFiles,
    target: _options.OutFiles,
    max_angle: Annotated[
        float,
        _options.number_option(
            "Largest angle between normals of neighbors, in degrees, up to 90.",
            expected="a number above 0 and up to 90",
            fits=lambda angle: 0 < angle <= 90,
        ),
    ] = 15.0,
    max_distance: Annotated[
        float | None,
        _options.length_option(
            "Largest distance of a neighbor from a point's plane, in units of the file.",
            "by the scatter of each neighborhood",
        ),
    ] = None,
    max_gap: Annotated[
        float | None,
        _options.length_option(
            "Largest distance of a neighbor, in units of the file.",
            "by the spacing of each neighborhood",
        ),
    ] = None,
    min_region_size: Annotated[
        int, typer.Option(min=1, help="Regions with fewer points are dissolved.")
    ] = 10,
    find_narrow_faces: Annotated[
        bool,
        typer.Option(
            help="Whether to grow regions again from the points that no region reached. This finds "
            "faces a few points wide beside larger ones, such as kerbs."
        ),
    ] = True,
    divide_at_creases: Annotated[
        bool,
        typer.Option(
            help="Whether to divide regions that two planes with a crease explain better than one "
            "smooth surface, such as the faces of a flat roof in noise."
        ),
    ] = True,
    join_coplanar: Annotated[
        bool,
        typer.Option(
            help="Whether to join regions in one plane if the gap between them is at most half as "
            "long as the smaller one, such as the parts of a wall that a shadow cuts."
        ),
    ] = True,
    join_curved: Annotated[
        bool,
        typer.Option(
            help="Whether to join narrow regions of one cylinder, such as strips of a post or a "
            "trunk."
        ),
    ] = True,
    assign_unlabeled: Annotated[
        bool,
        typer.Option(
            help="Whether to give points that no region reached to the region whose plane is "
            "nearest, if its noise explains the distance."
        ),
    ] = True,
    colors: Annotated[
        bool | None,
        _options.colors_option(
            "Whether to write colors: one for each region, gray for points of none."
        ),
    ] = None,
    regions: Annotated[
        Path | None,
        typer.Option(
            help="Also write a table of the regions, .csv or .geojson: kind, plane or cylinder, "
            "outline, area, dip, standard errors. Of clouds in memory.",
            show_default=False,
        ),
    ] = None,
    n_neighbors: _options.NNeighbors = 50,
    growth_neighbors: Annotated[
        int,
        typer.Option(
            min=4,
            help="Points in a neighborhood for growth. Regions grow to the nearer half of them.",
        ),
    ] = 30,
    max_outlier_rate: _options.MaxOutlierRate = 0.5,
    random_state: _options.RandomState = 0,
    n_jobs: _options.NJobs = -1,
    memory: Memory = None,
    scheduler: Scheduler = None,
    dry_run: DryRun = False,
    restart: Restart = False,
    report: ReportFolder = None,
    columns: _options.Columns = None,
    unit: _options.HiddenUnit = "",
    no_clobber: _options.NoClobber = False,
    allow_coarse: _options.AllowCoarse = False,
    config: Config = None,
    quiet: _options.Quiet = False,
) -> None:
    """Divide a cloud into surfaces: road, kerb and footpath, walls, signs, poles.

    LAS and LAZ that need more than --memory, and folders of them, are divided into tiles, and with
    --scheduler all are. The results are the same. Temporary files lie beside OUT, in OUT.tiles. If
    a run ends early, they are kept, and the same command goes on from there, or begins anew with
    --restart. --dry-run tells tiles, memory and time. If IN is a folder or an index .vpc, a folder
    OUT gets one file for each; an OUT that ends in .las or .laz gets all.

    All points are kept. New attributes are region (int32; 0 is the largest, -1 is none) and red,
    green and blue (8 bits, one color for each region). Denoise a cloud with outliers first.
    """
    normals = {
        "n_neighbors": n_neighbors,
        "max_outlier_rate": max_outlier_rate,
        "random_state": random_state,
        "n_jobs": n_jobs,
    }
    params = {
        "n_neighbors": growth_neighbors,
        "max_angle": max_angle,
        "max_distance": max_distance,
        "max_gap": max_gap,
        "min_region_size": min_region_size,
        "find_narrow_faces": find_narrow_faces,
        "divide_at_creases": divide_at_creases,
        "join_coplanar": join_coplanar,
        "join_curved": join_curved,
        "assign_unlabeled": assign_unlabeled,
        "n_jobs": n_jobs,
    }
    with _messages.clear_exits(allow_coarse=allow_coarse), engine(scheduler):
        seconds = _messages.stopwatch()
        catalog = large_catalog(source, memory, 0, scheduler is not None, columns, work="regions")
        check_regions_file(regions, catalog, source, target)
        if dry_run:
            growing = _growing(normals, params)
            print_plan(source, target, catalog, growing, memory, work="regions")
            return
        outputs = [target] if regions is None else [target, regions]
        _files.refuse_existing(no_clobber, *outputs, report=report, catalog=catalog)
        if catalog is not None:
            growing = _growing(normals, params)
            return _by_tiles(
                source, target, catalog, growing, colors, memory, restart, report, quiet, seconds
            )
        with progress("segment", quiet):
            cloud = _files.read(source, target, "regions", columns=columns)
            if colors is None:
                colors = not has_colors(cloud)
            _files.rehearse(target, _segmented(cloud, np.zeros(len(cloud), np.int64), colors))
            if regions is not None:
                with _files.standing_in(regions):
                    pass
            with _files.working(source):
                fitted = _growing(normals, params).fit(_files.coordinates(cloud))
            with ExitStack() as stack:  # no file is replaced before both are on the disk
                if regions is not None:
                    temporary = stack.enter_context(replacing(regions))
                    with _files.naming(regions):
                        write_regions(temporary, fitted.regions_)
                _files.write(target, _segmented(cloud, fitted.labels_, colors))
            write_report_of(report, source, target, seconds, lambda: _contents(cloud, fitted))
        if not quiet:
            _messages.print_summary(
                *(source, target, len(cloud), seconds()),
                regions=f"{fitted.n_regions_:,}",
                inside=_messages.count_and_share(fitted.labels_ >= 0),
                largest=_in_words(fitted.region_sizes_[:LARGEST_SHOWN]),
            )


def _by_tiles(source, target, catalog, growing, colors, memory, restart, report, quiet, seconds):
    from sklearn_mcmd.tiling import process_files

    with progress("segment", quiet):
        told = process_files(
            catalog, target, growing, colors=colors, memory=memory, n_jobs=growing.n_jobs,
            restart=restart,
        )  # fmt: skip
        write_report_of(
            report, source, target, seconds, lambda: _tile_contents(catalog, target, told)
        )
    if not quiet:
        _messages.print_summary(
            *(source, target, told.n_points, seconds()),
            tiles=f"{told.n_tiles:,}, of which {told.n_resumed:,} were done before",
            regions=f"{told.n_regions:,}",
            inside=_messages.number_and_share(told.n_inside, told.n_points),
            largest=_in_words(told.largest[:LARGEST_SHOWN]),
        )


def _tile_contents(catalog, target, told):
    from sklearn_mcmd.report._segment import Regions, segment_contents
    from sklearn_mcmd.report._shown import Shown
    from sklearn_mcmd.tiling._outputs import targets_of

    shown = Shown.of_tiles(catalog, targets_of(catalog, target), told, ("region",))
    regions = Regions.of_sample(shown.cloud, told.largest)
    return segment_contents(shown, regions, told.n_regions, told.n_inside)


def _in_words(sizes):
    return ", ".join(f"{size:,}" for size in sizes) or "none"


def _growing(normals, params):
    from sklearn_mcmd import RegionGrowing, RobustNormalEstimator

    return RegionGrowing(normal_estimator=RobustNormalEstimator(**normals), **params)


def _contents(cloud, fitted):
    from sklearn_mcmd.report._segment import Regions, segment_contents
    from sklearn_mcmd.report._shown import Shown

    planes, labels = fitted.normal_estimator_, fitted.labels_
    n_neighbors = int(np.median(planes.n_neighbors_))
    shown = Shown.of_memory(cloud, n_neighbors, planes.plane_scale_, region=labels.astype(np.int32))
    regions = Regions(
        fitted.region_sizes_, fitted.region_normals_, fitted.region_centroids_,
        fitted.region_errors_,
    )  # fmt: skip
    return segment_contents(shown, regions, fitted.n_regions_, np.count_nonzero(labels >= 0))


def _segmented(cloud, labels, colors):
    """The cloud to write."""
    from sklearn_mcmd.plotting._still import region_columns

    return with_results(cloud, region_columns(labels, colors))
