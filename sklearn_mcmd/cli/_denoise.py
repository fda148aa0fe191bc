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


class Strictness(StrEnum):
    isolated = "isolated"
    groups = "groups"
    surfaces = "surfaces"
    paper = "paper"


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
            "distance to it. mcmd_md: by their distance within it as well; with --strictness paper "
            "it also decides which points are outliers."
        ),
    ] = OutlierMethod.mcmd_z,
    strictness: Annotated[
        Strictness,
        typer.Option(
            help="Which points are outliers. isolated: single points and pairs far from everything "
            "else. groups: also small groups that stand apart, such as ghosts, birds and dust; "
            "foliage, wires and small things that touch others are kept. surfaces: all points that "
            "lie on no surface; foliage, wires and thin posts are removed. paper: points off the "
            "plane of their own neighborhood, as in the paper; weak on whole clouds."
        ),
    ] = Strictness.groups,
    noise_scale: Annotated[
        float | None,
        typer.Option(
            parser=positive,
            metavar="NUMBER",
            help="The scanner's standard deviation, in units of the file. Distances to surfaces "
            "are divided by it.",
            show_default="the noise around each point",
        ),
    ] = None,
    cutoff: Annotated[
        float | None,
        typer.Option(
            parser=positive,
            metavar="NUMBER",
            help="Score above which a point is an outlier. 3: the point is three standard "
            "deviations of the noise off the surfaces, and three usual spacings, or sizes of its "
            "group, away from everything real. 10: ten of each, for clear errors only. 100: for "
            "gross errors only.",
            show_default="3; with --strictness paper 2.5, for mcmd_md 3.06",
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
            "simulation then finds the cutoff; do not give --cutoff. From 0.0001 to below 0.5.",
        ),
    ] = None,
    contamination: Annotated[
        float | None,
        typer.Option(
            parser=number_or(
                expected=f"a number above 0 and up to {LARGEST_RATE:g}",
                fits=lambda share: 0 < share <= LARGEST_RATE,
            ),
            metavar="SHARE",
            help="Share of all points that are outliers: those of the highest scores. Do not give "
            "--cutoff. Above 0, up to 0.5.",
        ),
    ] = None,
    outlier_rate: OutlierRate = 0.5,
    random_state: RandomState = 0,
    n_jobs: NJobs = -1,
    allow_coarse: AllowCoarse = False,
    quiet: Quiet = False,
) -> None:
    """Remove or mark the points that lie on no surface and stand apart from all else.

    The default is for any cloud: curved, with foliage and wires, of any spacing and noise. A
    score up to 3 means that the point is on a surface or near other points, 10 means a clear
    error, and 100 a gross error. To keep only surfaces, give --strictness surfaces. To lose a
    stated share of good points, give --false-positive-rate 0.01.
    """
    _at_most_one(
        {
            "--cutoff": cutoff,
            "--false-positive-rate": false_positive_rate,
            "--contamination": contamination,
        }
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
                strictness=None if strictness is Strictness.paper else str(strictness),
                noise_scale=noise_scale,
                cutoff=cutoff,
                false_positive_rate=false_positive_rate,
                contamination=contamination,
                outlier_rate=outlier_rate,
                random_state=random_state,
                n_jobs=n_jobs,
            )
            _warn_if_without_scale(score[is_outlier], len(cloud))
            write(target, *_denoised(cloud, is_outlier, score, mark))
        if not quiet:
            found = {"marked" if mark else "removed": count_and_share(is_outlier)}
            print_summary(source, target, len(cloud), seconds(), **found)


def _at_most_one(options):
    """Wrong usage where more than one of some options, by their names, has a value."""
    given = [f"{name} {value:g}" for name, value in options.items() if value is not None]
    if len(given) > 1:
        raise typer.BadParameter(
            f"{' and '.join(given)} exclude each other: leave all but one out."
        )


def _find_outliers(xyz, **params):
    """Whether each point is an outlier, and its score."""
    from sklearn_mcmd import MCMDOutlierDetector

    with progress_part(*WORKING):
        detector = MCMDOutlierDetector(**params).fit(xyz)
    return detector.scores_ < detector.offset_, -detector.scores_


def _warn_if_without_scale(scores, n_points):
    """Warn if many points are outliers only because an exact plane has no noise."""
    share = np.count_nonzero(scores > EXACT_PLANE_SCORE) / n_points
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
