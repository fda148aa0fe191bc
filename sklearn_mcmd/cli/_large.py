"""Clouds larger than memory: whether one is, and the plan that ``--dry-run`` shows."""

import time
import warnings
from errno import ENOENT

from sklearn_mcmd.cli._files import is_several
from sklearn_mcmd.cli._messages import print_table
from sklearn_mcmd.io import PointFileError
from sklearn_mcmd.io._formats import TILED, TILED_NAMES, no_columns
from sklearn_mcmd.io._las_parts import read_parts

SAMPLE = 50_000  # points whose time is measured
MORE = 1.25  # time of tiles over that in memory, at most; see docs/tiling.rst


def catalog_of(source, columns=None):
    """The catalog of LAS and LAZ files, which know their columns."""
    from sklearn_mcmd.tiling import Catalog

    if columns is not None:
        told = no_columns(columns)
        raise ValueError(f"{source}: {told}") from told
    return Catalog(source)


def large_catalog(verb):
    """The catalog of what a verb reads, if it is to be divided into tiles, else None.

    Faults of a single file are left to the reading of it, unless a scheduler divides it.
    """
    source = verb.source
    if not source.exists():
        raise FileNotFoundError(ENOENT, "no such file or folder", str(source))
    if verb.scheduler is not None or is_several(source):
        return catalog_of(source, verb.columns)
    if source.suffix.lower() not in TILED:
        if verb.memory is not None:
            warnings.warn(
                f"{source}: is read as a whole, whatever --memory is; only {TILED_NAMES} are "
                "divided into tiles",
                stacklevel=2,
            )
        return None
    from sklearn_mcmd.tiling._memory import bytes_in_memory, usual_memory

    try:
        catalog = catalog_of(source, verb.columns)
    except PointFileError:
        return None
    limit = usual_memory() if verb.memory is None else verb.memory
    return catalog if bytes_in_memory(catalog, verb.n_features, work=verb.work) > limit else None


def print_plan(verb, catalog):
    """Print tiles, memory and time; the time is measured with the first points."""
    from sklearn.base import clone

    from sklearn_mcmd.tiling._memory import bytes_in_memory, most_neighbors, plan_run, usual_memory
    from sklearn_mcmd.tiling._run import warm_up

    if catalog is None and verb.source.suffix.lower() not in TILED:
        raise PointFileError(f"{verb.source}: --dry-run is for {TILED_NAMES}")
    tiles, catalog = catalog is not None, catalog or catalog_of(verb.source)
    size = {"work": verb.work}
    estimator = verb.dry_estimator()
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
        limit = usual_memory() if verb.memory is None else verb.memory
        plan = plan_run(catalog.n_points, limit, n_jobs, verb.n_features, n_neighbors=k, **size)
        seconds *= MORE / (plan.n_workers * plan.n_threads)
        threads = f" with {plan.n_threads} threads" if plan.n_threads > 1 else ""
        rows |= {
            "tiles": f"about {plan.n_tiles:,} of at most {plan.tile_size:,} points",
            "processes": f"{plan.n_workers}{threads}",
            "memory": f"about {plan.memory / 1e9:.2g} GB",
            "disk": f"about {plan.disk / 1e9:.2g} GB for temporary files beside {verb.target}",
        }
    else:
        needed = bytes_in_memory(catalog, verb.n_features, **size)
        rows["memory"] = f"about {needed / 1e9:.2g} GB, without tiles"
    print_table(f"{verb.source} -> {verb.target}", **rows, time=f"about {_in_words(seconds)}")


def _in_words(seconds):
    if seconds < 120:
        return f"{seconds:.0f} seconds"
    return f"{seconds / 60:.0f} minutes" if seconds < 7200 else f"{seconds / 3600:.1f} hours"
