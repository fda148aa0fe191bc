"""``mcmd edges``."""

from typing import Annotated

import numpy as np
import typer

from sklearn_mcmd._choices import Criterion
from sklearn_mcmd.cli import _files, _messages, _options
from sklearn_mcmd.cli._config import Config
from sklearn_mcmd.cli._large import DryRun, Memory, Restart, large_catalog, print_plan
from sklearn_mcmd.cli._progress_bar import progress
from sklearn_mcmd.cli._reporting import ReportFolder, write_report_of
from sklearn_mcmd.cli._scheduler import Scheduler, engine
from sklearn_mcmd.io._point_cloud import has_colors, with_results

__all__ = ["edges"]


def edges(
    source: _options.InFiles,
    target: _options.OutFiles,
    n_neighbors: _options.NNeighbors = 40,
    criterion: Annotated[
        Criterion,
        typer.Option(
            help="crease: the distance to the line where two faces meet. eigenvalue, "
            "surface_variation, removed_fraction: how much the neighborhood differs from a plane."
        ),
    ] = "crease",
    threshold: Annotated[
        float | None,
        _options.number_option(
            "Limit of an edge: the largest distance to a crease, in spacings of the points, "
            "or the least value of another criterion.",
            "2; for the others median + 3 robust standard deviations",
        ),
    ] = None,
    min_angle: Annotated[
        float, typer.Option(min=1.0, max=89.0, help="Least angle of a crease, in degrees.")
    ] = 20.0,
    denoise: Annotated[
        bool, typer.Option(help="Whether outliers are removed before edges are searched.")
    ] = True,
    colors: Annotated[
        bool | None, _options.colors_option("Whether to write colors: edges red, surfaces gray.")
    ] = None,
    random_state: _options.RandomState = 0,
    n_jobs: _options.NJobs = -1,
    memory: Memory = None,
    scheduler: Scheduler = None,
    dry_run: DryRun = False,
    restart: Restart = False,
    report: ReportFolder = None,
    columns: _options.Columns = None,
    no_clobber: _options.NoClobber = False,
    allow_coarse: _options.AllowCoarse = False,
    config: Config = None,
    quiet: _options.Quiet = False,
) -> None:
    """Mark edges and corners: points next to a line where two faces meet.

    All points are kept. New attributes are edge (1 or 0, 8 bits) and edge_score (float32: the
    distance to the nearest crease in spacings, at most 20, or the criterion's value). If the input
    has no colors, or with --colors, also red, green and blue.

    LAS and LAZ that need more than --memory, and folders of them, are divided into tiles, and with
    --scheduler all are. The results are the same. Temporary files lie beside OUT, in OUT.tiles. If
    a run ends early, they are kept, and the same command goes on from there, or begins anew with
    --restart. --dry-run tells tiles, memory and time. If IN is a folder or an index .vpc, a folder
    OUT gets one file for each; an OUT that ends in .las or .laz gets all.
    """
    params = {
        "n_neighbors": n_neighbors,
        "criterion": criterion,
        "threshold": threshold,
        "min_angle": min_angle,
        "outlier_detector": None if denoise else "passthrough",
        "random_state": random_state,
        "n_jobs": n_jobs,
    }
    with _messages.clear_exits(allow_coarse=allow_coarse), engine(scheduler):
        seconds = _messages.stopwatch()
        catalog = large_catalog(source, memory, 0, scheduler is not None, columns, work="edges")
        if dry_run:
            print_plan(source, target, catalog, _detector(params), memory, work="edges")
            return
        _files.refuse_existing(no_clobber, target, report=report, catalog=catalog)
        if catalog is not None:
            return _by_tiles(
                source, target, catalog, params, colors, memory, restart, report, quiet, seconds
            )
        from sklearn_mcmd.plotting._still import edge_columns

        with progress("edges", quiet):
            cloud = _files.read(source, target, "edges", columns=columns)
            if colors is None:
                colors = not has_colors(cloud)
            nothing = _files.blank(cloud)
            _files.rehearse(target, with_results(cloud, edge_columns(nothing > 0, nothing, colors)))
            with _files.working(source):
                detector = _detector(params).fit(_files.coordinates(cloud))
            is_edge, score = _verdict(detector)
            _files.write(target, with_results(cloud, edge_columns(is_edge, score, colors)))
            write_report_of(report, source, target, seconds, lambda: _contents(cloud, detector))
        if not quiet:
            edges = _messages.count_and_share(is_edge)
            _messages.print_summary(source, target, len(cloud), seconds(), edges=edges)


def _by_tiles(source, target, catalog, params, colors, memory, restart, report, quiet, seconds):
    from sklearn_mcmd.tiling import process_files

    with progress("edges", quiet):
        told = process_files(
            catalog, target, _detector(params), colors=colors, memory=memory,
            n_jobs=params["n_jobs"], restart=restart,
        )  # fmt: skip
        write_report_of(
            report, source, target, seconds, lambda: _tile_contents(catalog, target, params, told)
        )
    if not quiet:
        _messages.print_summary(
            *(source, target, told.n_points, seconds()),
            tiles=f"{told.n_tiles:,}, of which {told.n_resumed:,} were done before",
            edges=_messages.number_and_share(told.n_edges, told.n_points),
        )


def _tile_contents(catalog, target, params, told):
    from sklearn_mcmd.edges._detector import crease_width
    from sklearn_mcmd.report._edges import edges_contents
    from sklearn_mcmd.report._shown import Shown
    from sklearn_mcmd.tiling._outputs import targets_of

    detector, names = _detector(params), ("edge", "edge_score")
    shown = Shown.of_tiles(catalog, targets_of(catalog, target), told, names)
    limit = crease_width(detector) if detector.criterion == "crease" else None
    return edges_contents(shown, detector.criterion, told.n_edges, limit, [])


def _detector(params):
    from sklearn_mcmd import SharpFeatureDetector

    return SharpFeatureDetector(**params)


def _verdict(detector):
    """Whether each point belongs to an edge, and its distance or the criterion's value."""
    scores = detector.scores_
    return scores < detector.offset_, scores if detector.criterion == "crease" else -scores


def _contents(cloud, detector):
    from sklearn_mcmd.report._edges import edges_contents
    from sklearn_mcmd.report._shown import Shown

    is_edge, score = _verdict(detector)
    scales = getattr(detector.normal_estimator_, "plane_scale_", None)
    results = {"edge": is_edge.astype(np.uint8), "edge_score": score.astype(np.float32)}
    shown = Shown.of_memory(cloud, detector.n_neighbors, scales, **results)
    limit = float(detector.offset_ if detector.criterion == "crease" else -detector.offset_)
    n_outliers = np.count_nonzero(~detector.inlier_mask_)
    cards = [(f"{n_outliers:,}", "outliers that were left out")]
    return edges_contents(shown, detector.criterion, np.count_nonzero(is_edge), limit, cards)
