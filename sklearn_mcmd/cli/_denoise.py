"""``mcmd denoise``."""

import warnings
from enum import StrEnum
from typing import Annotated

import numpy as np
import typer

from sklearn_mcmd.cli._files import WORKING, blank, coordinates, read, rehearse, with_results, write
from sklearn_mcmd.cli._options import (
    AllowCoarse,
    InFile,
    NJobs,
    NNeighbors,
    OutFile,
    OutlierRate,
    Quiet,
    RandomState,
    number_or,
    positive,
)
from sklearn_mcmd.cli._speech import (
    clear_exits,
    count_and_share,
    print_summary,
    stopwatch,
)
from sklearn_mcmd.cli._waiting import progress
from sklearn_mcmd.planes._progress import progress_part

__all__ = ["denoise"]

# Score, in standard deviations, that measured noise never reaches, only the rounding of floats.
EXACT_PLANE_SCORE = 1e6
# Rates of false positives: the least that the simulation resolves in 3D, and the detector's limit.
LEAST_RATE, LARGEST_RATE = 1e-4, 0.5


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
            help="drop: remove outliers. mark: keep all points, add an 'outlier_score' and mark "
            "outliers, as class 7 (noise) in LAS and LAZ, elsewhere by an attribute 'outlier'."
        ),
    ] = Mode.drop,
    n_neighbors: NNeighbors = 50,
    method: Annotated[
        OutlierMethod,
        typer.Option(
            help="How outliers of a plane are removed before it is fitted. mcmd_z: by their "
            "distance to it. mcmd_md: by their distance within it as well; with --noise-scale own "
            "it also decides which points are outliers."
        ),
    ] = OutlierMethod.mcmd_z,
    noise_scale: Annotated[
        str,
        typer.Option(
            parser=number_or("local", "own", "pooled"),
            metavar="local|own|pooled|NUMBER",
            help="The noise that distances to planes are divided by. local: the noise around the "
            "point, for any cloud. own: the noise of the point's own neighborhood, as in the "
            "paper. pooled: one noise for all points, found from the cloud. NUMBER: one noise for "
            "all points, in units of the file. The last two find most outliers, but also remove "
            "curved and rough surfaces and foliage.",
        ),
    ] = "local",
    max_iter: Annotated[
        int,
        typer.Option(
            min=1,
            help="Largest number of passes over the cloud. Each pass judges all points by the "
            "planes of the points that the last pass kept. 1 is fast and misses outliers that hide "
            "each other. More than 3 change little.",
        ),
    ] = 3,
    borrow: Annotated[
        bool,
        typer.Option(
            "--borrow/--no-borrow",
            help="Whether the plane of a neighbor may explain a point. Next to edges it must.",
        ),
    ] = True,
    keep_groups: Annotated[
        bool | None,
        typer.Option(
            "--keep-groups/--drop-groups",
            help="Whether to keep points that no plane explains if they are as dense as a surface: "
            "foliage, wires and other small things, but also mixed pixels of a dense edge.",
            show_default="keep with --noise-scale local",
        ),
    ] = None,
    cutoff: Annotated[
        float | None,
        typer.Option(
            parser=positive,
            metavar="NUMBER",
            help="Distance from which on a point is an outlier, in standard deviations of the "
            "noise.",
            show_default="3; with --noise-scale own 2.5, for mcmd_md 3.06",
        ),
    ] = None,
    false_positive_rate: Annotated[
        float | None,
        typer.Option(
            parser=number_or(
                expected=f"a number from {LEAST_RATE:g} to below {LARGEST_RATE:g}",
                fits=lambda rate: LEAST_RATE <= rate < LARGEST_RATE,
            ),
            metavar="RATE",
            help="Share of the points of a clean plane that may be lost, such as 0.01. A "
            "simulation then finds the cutoff; do not give --cutoff. From 0.0001 to below 0.5; "
            "above about 0.1 only with --drop-groups.",
        ),
    ] = None,
    outlier_rate: OutlierRate = 0.5,
    random_state: RandomState = 0,
    n_jobs: NJobs = -1,
    allow_coarse: AllowCoarse = False,
    quiet: Quiet = False,
):
    """Remove or mark the points that no surface around them explains.

    The default is for any cloud: curved, with foliage, of any spacing and noise. The paper's form
    is --noise-scale own --no-borrow --max-iter 1. To lose a stated share of good points, give
    --false-positive-rate 0.01.
    """
    if cutoff is not None and false_positive_rate is not None:
        raise typer.BadParameter(
            f"{false_positive_rate:g} and --cutoff {cutoff:g} exclude each other: leave one out.",
            param_hint="--false-positive-rate",
        )
    with clear_exits(allow_coarse=allow_coarse):
        seconds = stopwatch()
        with progress("denoise", quiet):
            mark = mode is Mode.mark
            cloud = read(source, target, "marks of outliers" if mark else None)
            nothing = blank(cloud)
            rehearse(target, *_denoised(cloud, nothing > 0, nothing, mark))
            is_outlier, score = _find_outliers(
                coordinates(cloud),
                n_neighbors=n_neighbors,
                method=str(method),
                noise_scale=noise_scale,
                max_iter=max_iter,
                borrow=borrow,
                keep_groups="auto" if keep_groups is None else keep_groups,
                cutoff=cutoff,
                false_positive_rate=false_positive_rate,
                outlier_rate=outlier_rate,
                random_state=random_state,
                n_jobs=n_jobs,
            )
            _warn_if_without_scale(score)
            write(target, *_denoised(cloud, is_outlier, score, mark))
        if not quiet:
            found = {"marked" if mark else "removed": count_and_share(is_outlier)}
            print_summary(source, target, len(cloud), seconds(), **found)


def _find_outliers(xyz, **params):
    """Whether each point is an outlier, and its robust distance to its plane."""
    from sklearn_mcmd import MCMDOutlierDetector

    with progress_part(*WORKING):
        detector = MCMDOutlierDetector(**params).fit(xyz)
    return detector.scores_ < detector.offset_, -detector.scores_


def _warn_if_without_scale(score):
    """Warn if many points are outliers only because an exact plane has no noise."""
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
