"""Clouds larger than memory: options, and the plan that ``--dry-run`` shows."""

import time
import warnings
from errno import ENOENT
from typing import Annotated

import typer

from sklearn_mcmd.cli._messages import print_table
from sklearn_mcmd.io import PointFileError
from sklearn_mcmd.io._formats import INDEX, TILED, TILED_NAMES, no_columns
from sklearn_mcmd.io._las_parts import read_parts

__all__ = ["DryRun", "Memory", "Restart", "is_several", "large_catalog", "outputs_of", "print_plan"]

SAMPLE = 50_000  # points whose time is measured
MORE = 1.25  # time of tiles over that in memory, at most; see docs/tiling.rst


def _memory(text):
    from sklearn_mcmd.tiling._memory import parse_memory

    try:
        return parse_memory(text)
    except ValueError as err:
        raise typer.BadParameter(str(err).removeprefix("memory=")) from err


Memory = Annotated[
    float | None,
    typer.Option(
        parser=_memory,
        metavar="SIZE",
        help=f"What may be taken, such as 2GB, and 430MB or more. {TILED_NAMES} that need more are "
        "divided into tiles.",
        show_default="half of the machine's memory",
    ),
]
DryRun = Annotated[
    bool,
    typer.Option(
        "--dry-run",
        help=f"Show tiles, memory and time of {TILED_NAMES}, as estimated, and stop.",
        hidden=True,
    ),
]
Restart = Annotated[
    bool,
    typer.Option("--restart", help="Begin anew, whatever an earlier run has left.", hidden=True),
]


def is_several(source):
    """Whether a source stands for several files."""
    return source.is_dir() or source.suffix.lower() == INDEX


def large_catalog(source, memory, n_features, always=False, columns=None, *, work="normals"):
    """The catalog of a source that is to be divided into tiles, else None.

    Faults of a single file are left to the reading of it, unless it is `always` divided. `work` is
    what is asked for, as of `plan_run`.
    """
    if not source.exists():
        raise FileNotFoundError(ENOENT, "no such file or folder", str(source))
    always = always or is_several(source)
    if not always and source.suffix.lower() not in TILED:
        if memory is not None:
            warnings.warn(
                f"{source}: is read as a whole, whatever --memory is; only {TILED_NAMES} are "
                "divided into tiles",
                stacklevel=2,
            )
        return None
    if columns is not None:
        told = no_columns(columns)
        raise ValueError(f"{source}: {told}") from told
    from sklearn_mcmd.tiling import Catalog
    from sklearn_mcmd.tiling._memory import bytes_in_memory, usual_memory

    if always:
        return Catalog(source)
    try:
        catalog = Catalog(source)
    except PointFileError:
        return None
    limit = usual_memory() if memory is None else memory
    return catalog if bytes_in_memory(catalog, n_features, work=work) > limit else None


def outputs_of(catalog, target):
    """The files to write, one for each of a catalog, or one."""
    from sklearn_mcmd.tiling._outputs import targets_of

    return targets_of(catalog, target)


def print_plan(source, target, catalog, estimator, memory, *, n_features=0, work="normals"):
    """Print tiles, memory and time; the time is measured with the first points.

    `work` is what the estimator finds, as of `plan_run`.
    """
    from sklearn.base import clone

    from sklearn_mcmd.tiling import Catalog
    from sklearn_mcmd.tiling._memory import bytes_in_memory, most_neighbors, plan_run, usual_memory
    from sklearn_mcmd.tiling._run import warm_up

    if catalog is None and source.suffix.lower() not in TILED:
        raise PointFileError(f"{source}: --dry-run is for {TILED_NAMES}")
    tiles = catalog is not None
    catalog = catalog or Catalog(source)
    k = most_neighbors(catalog.n_points, estimator)
    xyz = next(iter(read_parts(catalog.paths[0], SAMPLE))).xyz[:SAMPLE]
    n_jobs, estimator = estimator.n_jobs, clone(estimator)
    estimator.set_params(**{name: 1 for name in estimator.get_params() if name.endswith("n_jobs")})
    warm_up(estimator)
    begin = time.perf_counter()
    clone(estimator).fit(xyz)
    seconds = (time.perf_counter() - begin) / len(xyz) * catalog.n_points
    rows = {"points": f"{catalog.n_points:,}", "files": f"{len(catalog):,}"}
    if tiles:
        limit = usual_memory() if memory is None else memory
        plan = plan_run(catalog.n_points, limit, n_jobs, n_features, work=work, n_neighbors=k)
        seconds *= MORE / (plan.n_workers * plan.n_threads)
        rows |= {
            "tiles": f"about {plan.n_tiles:,} of at most {plan.tile_size:,} points",
            "processes": f"{plan.n_workers}"
            + (f" with {plan.n_threads} threads" if plan.n_threads > 1 else ""),
            "memory": f"about {plan.memory / 1e9:.2g} GB",
            "disk": f"about {plan.disk / 1e9:.2g} GB for temporary files beside {target}",
        }
    else:
        needed = bytes_in_memory(catalog, n_features, work=work)
        rows["memory"] = f"about {needed / 1e9:.2g} GB, without tiles"
    print_table(f"{source} -> {target}", **rows, time=f"about {_in_words(seconds)}")


def _in_words(seconds):
    if seconds < 120:
        return f"{seconds:.0f} seconds"
    return f"{seconds / 60:.0f} minutes" if seconds < 7200 else f"{seconds / 3600:.1f} hours"
