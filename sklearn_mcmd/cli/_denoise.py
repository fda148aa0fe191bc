"""``mcmd denoise``."""

import warnings
from enum import StrEnum
from typing import Annotated

import numpy as np
import typer

from sklearn_mcmd.cli._files import coordinates, read, rehearse, with_results, write
from sklearn_mcmd.cli._options import (
    InFile,
    NJobs,
    NNeighbors,
    NoiseScale,
    OutFile,
    OutlierRate,
    Quiet,
    RandomState,
    positive,
)
from sklearn_mcmd.cli._speech import clear_exits, print_table, progress_bar, stopwatch

__all__ = ["denoise"]

# Standard deviations that no measured noise leads to, only the rounding of floats.
EXACT_PLANE_SCORE = 1e6


class Mode(StrEnum):
    drop = "drop"
    mark = "mark"


class OutlierMethod(StrEnum):
    mcmd_z = "mcmd_z"
    mcmd_md = "mcmd_md"


def denoise(
    source: InFile,
    target: OutFile,
    mode: Annotated[
        Mode,
        typer.Option(
            help="drop: leave outliers out. mark: keep all points, outliers as class 7 (noise) in "
            "LAS and LAZ, as attribute 'outlier' elsewhere, beside an 'outlier_score'."
        ),
    ] = Mode.drop,
    n_neighbors: NNeighbors = 50,
    method: Annotated[
        OutlierMethod,
        typer.Option(
            help="How a plane leaves out its outliers. mcmd_z: by the distance to it. mcmd_md: by "
            "the distance within it as well; with --noise-scale own that is the verdict, too."
        ),
    ] = OutlierMethod.mcmd_z,
    noise_scale: NoiseScale = "local",
    max_iter: Annotated[
        int,
        typer.Option(
            min=1,
            help="Most passes over the cloud: each judges all points by the planes of those that "
            "the last one kept. 1 is fast and misses outliers that hide each other; more than 3 "
            "change little.",
        ),
    ] = 3,
    borrow: Annotated[
        bool,
        typer.Option(
            "--borrow/--no-borrow",
            help="Whether the plane of a neighbor may explain a point, as needed next to edges.",
        ),
    ] = True,
    keep_groups: Annotated[
        bool | None,
        typer.Option(
            "--keep-groups/--drop-groups",
            help="Points that no plane explains, but that lie together as densely as surfaces do: "
            "foliage, wires and other small things, and the mixed pixels of a dense edge.",
            show_default="keep with --noise-scale local",
        ),
    ] = None,
    cutoff: Annotated[
        float | None,
        typer.Option(
            callback=positive,
            help="Distance beyond which a point is an outlier, in standard deviations of the "
            "noise.",
            show_default="3; with --noise-scale own 2.5, for mcmd_md 3.06",
        ),
    ] = None,
    outlier_rate: OutlierRate = 0.5,
    random_state: RandomState = 0,
    n_jobs: NJobs = -1,
    quiet: Quiet = False,
):
    """Remove or mark the points that no surface around them explains.

    The default is for any cloud: curved, with foliage, of any spacing and noise. One pass by the
    planes' own noise, as in the paper: --noise-scale own --no-borrow --max-iter 1.
    """
    with clear_exits():
        seconds = stopwatch()
        cloud = read(source, target)
        mark = mode is Mode.mark
        blank = np.zeros(len(cloud))
        rehearse(target, *_denoised(cloud, blank > 0, blank, mark))
        is_outlier, score = _find_outliers(
            coordinates(cloud),
            quiet,
            n_neighbors=n_neighbors,
            method=str(method),
            noise_scale=noise_scale,
            max_iter=max_iter,
            borrow=borrow,
            keep_groups="auto" if keep_groups is None else keep_groups,
            cutoff=cutoff,
            outlier_rate=outlier_rate,
            random_state=random_state,
            n_jobs=n_jobs,
        )
        _warn_if_without_scale(score)
        write(target, *_denoised(cloud, is_outlier, score, mark))
        if not quiet:
            n_outliers = int(np.count_nonzero(is_outlier))
            verb = "marked" if mark else "removed"
            print_table(
                f"{source} -> {target}",
                points=f"{len(cloud):,}",
                **{verb: f"{n_outliers:,} ({100 * n_outliers / len(cloud):.2f} %)"},
                seconds=f"{seconds():.1f}",
            )


def _find_outliers(xyz, quiet, **params):
    """Whether each point is an outlier, and its robust distance to its plane."""
    from sklearn_mcmd import MCMDOutlierDetector

    with progress_bar("Outliers", quiet):
        detector = MCMDOutlierDetector(**params).fit(xyz)
    return detector.scores_ < detector.offset_, -detector.scores_


def _warn_if_without_scale(score):
    """Say so where exact planes, which have no noise to measure by, made many outliers."""
    share = np.count_nonzero(score > EXACT_PLANE_SCORE) / len(score)
    if share >= 0.01:
        warnings.warn(
            f"{100 * share:.1f} % of the points are outliers only because most of their neighbors "
            "lie exactly in one plane, as where coordinates are rounded more coarsely than the "
            "noise; check these before they are dropped (--mode mark)",
            stacklevel=2,
        )


def _denoised(cloud, is_outlier, score, mark):
    """The cloud to write, and the points to mark in it."""
    if not mark:
        return cloud.subset(~is_outlier), None
    return with_results(cloud, {"outlier_score": score.astype(np.float32)}), is_outlier
