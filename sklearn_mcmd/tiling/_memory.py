"""How much memory a run may take, and how many points a tile then may have."""

import os
import re
from contextlib import suppress
from numbers import Integral
from pathlib import Path
from typing import NamedTuple

import numpy as np
from joblib import effective_n_jobs
from joblib.parallel import get_active_backend

from sklearn_mcmd._errors import ParameterError
from sklearn_mcmd._validation import check_work

__all__ = [
    "Plan",
    "bytes_in_memory",
    "bytes_of_groups",
    "bytes_to_join",
    "check_tile_size",
    "most_neighbors",
    "parse_memory",
    "plan_run",
    "sensed",
    "sized",
    "usual_memory",
]

# Share of the machine's memory that a run may take by itself, and what it takes where the machine
# does not tell.
SHARE, UNKNOWN = 0.5, 4e9


class Costs(NamedTuple):
    """Bytes that a work takes, measured, see docs/tiling.rst: for each point."""

    tile: int  # of a tile
    stored: int  # of temporary files
    cloud: int  # of a cloud in memory besides what its record has
    whole: int = 0  # of all points, in one process that works on all at once
    does: str = ""  # what that process does


COSTS = {
    "normals": Costs(650, 430, 450),
    "outliers": Costs(450, 400, 450, 35, "judges"),
    "heights": Costs(450, 460, 450, 35, "judges"),
    "edges": Costs(750, 480, 1100, 35, "judges"),
    "tree": Costs(650, 480, 850, 200, "holds the tree of"),
    "regions": Costs(650, 550, 720, 100, "joins the regions of"),
}
# What more a work takes: a tile and a cloud in memory, at least; what is stored; and one process.
# Numbers of neighbors are found, rays are followed, and there is a position for each point.
MORE = {
    "auto": Costs(1300, 370, 750, 80, "finds the numbers of neighbors of"),
    "rays": Costs(0, 155, 650, 200, "follows the rays to"),
    "positions": Costs(0, 50, 500, 24, "holds positions for"),
    "trajectory": Costs(0, 50, 500, 30, "keeps the times of"),
    "angles": Costs(0, 50, 750, 300, "adjusts the flight lines of"),
}
# Bytes of a process with its compiled code, and for each value of a feature.
PROCESS, FEATURE = 330e6, 24
# Costs are those of so many neighbors. Each that is more takes 4 bytes of disk and 8 of a tile.
NEIGHBORS = 50
# Each point that lies below the ground; of regions, so many points at once, each point, and one
# that growth left over.
BELOW_POINT, JOINED_POINT, JOINED_AT_ONCE, GROWN_LEAST, REST_POINT = 750, 150, 1_000_000, 26, 200
# Points read or written at once, and bytes for each while that is done.
PART, PART_POINT = 250_000, 400
LEAST_TILE = 20_000  # most points of smaller tiles have neighbors in others
# Where there is memory for more, each process gets EACH tiles or more, of GOOD_TILE points or more.
# Where there is less, fewer processes with more threads each have tiles as large.
EACH, GOOD_TILE = 2, 1_000_000
FILL = 0.7  # how full cells are that are halved when they are full


class Plan(NamedTuple):
    """How a catalog is to be divided: how many tiles are computed at once, with so many threads
    each, how large they are, about how many, and about how many bytes of memory and disk they take.
    """

    n_workers: int
    n_threads: int
    tile_size: int
    n_tiles: int
    memory: float
    disk: float


def parse_memory(memory):
    """Bytes of a text such as "2GB" or "500 MB", or of a number."""
    if not isinstance(memory, str):
        if not 0 < memory < np.inf:  # nor NaN
            raise ValueError(f"memory={memory!r} must be positive and finite, or a size like 2GB.")
        return float(memory)
    found = re.fullmatch(r"\s*([0-9]+\.?[0-9]*)\s*([KMGT]?)(i?)B?\s*", memory, re.IGNORECASE)
    if not found or float(found[1]) == 0:
        raise ValueError(f"memory={memory!r} is no size: write it like 2GB or 500MB.")
    number, unit, binary = found.groups()
    power = " KMGT".index(unit.upper() or " ")
    return float(number) * (1024 if binary else 1000) ** power


def most_neighbors(n_points, *estimators):
    """The largest number of neighbors of some estimators of so many points."""
    numbers = []
    for estimator in filter(None, estimators):
        check_work(estimator, n_points)
        numbers.append(estimator.n_neighbors)
    return max((k for k in numbers if isinstance(k, Integral)), default=NEIGHBORS)


def sized(work, estimator):
    """The name of some work with an estimator of normals."""
    return f"{work}, auto" if estimator.n_neighbors == "auto" else work


def sensed(work, detector, sensor=None):
    """The name of some work with a detector, or None, and a `SensorPath`."""
    if detector is not None and not (sensor is None and detector.sensor_origin is None):
        work = f"{work}, rays"
    return work if sensor is None else f"{work}, {sensor.kind}"


def costs_of(work):
    """The `Costs` of a work: a key of `COSTS` and, after commas, keys of `MORE`."""
    base, *more = work.split(", ")
    costs = COSTS[base]
    for other in (MORE[name] for name in more):
        tile, stored, cloud = max(costs.tile, other.tile), costs.stored + other.stored, costs.cloud
        costs = Costs(tile, stored, max(cloud, other.cloud), *max(costs[3:], other[3:]))
    return costs


def check_tile_size(tile_size):
    """Raise if a cloud cannot be divided like this."""
    if tile_size is not None and not (
        isinstance(tile_size, Integral) and not isinstance(tile_size, bool) and tile_size >= 1
    ):
        raise ValueError(f"tile_size={tile_size!r} must be an int of 1 or more, or None.")


def usual_memory():
    """Bytes that a run takes if it is not told: half of the machine's, or of all workers' of dask.

    The worker with the least memory for a task sets the memory of all.
    """
    client = getattr(get_active_backend()[0], "client", None)
    if client is None:
        machine = _memory_of_machine()
        return SHARE * machine if machine else UNKNOWN
    tasks, memory = zip(*client.run(_memory_of_worker).values(), strict=True)
    return SHARE * sum(tasks) * min(memory)


def _memory_of_worker(dask_worker):
    """How many tasks a worker of dask takes at once, and bytes for each."""
    n = dask_worker.state.nthreads
    limit = dask_worker.memory_manager.memory_limit or _memory_of_machine() or UNKNOWN
    return n, limit / n


def _memory_of_machine():
    """Bytes of the machine, or of its container; None if it does not tell."""
    limits = []
    with suppress(AttributeError, OSError, ValueError):  # Windows has no sysconf
        limits.append(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    for path in ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes"):
        with suppress(OSError, ValueError):  # the first may hold a word
            limits.append(int(Path(path).read_text()))
    return min(limits, default=None)


def bytes_in_memory(catalog, n_features=0, *, work="normals"):
    """What a whole catalog takes in memory, about; `work` is as of `costs_of`."""
    cloud_point = costs_of(work).cloud
    points = sum(
        n * (size + cloud_point + FEATURE * n_features)
        for n, size in zip(catalog.counts, catalog.record_sizes, strict=True)
    )
    return PROCESS + points


def bytes_to_join(n_points, n_rest):
    """What the joining of regions takes, about, if growth left over so many of the points."""
    at_once = JOINED_POINT * min(n_points, JOINED_AT_ONCE)
    return PROCESS + at_once + GROWN_LEAST * n_points + REST_POINT * n_rest


def bytes_of_groups(n_points):
    """What groups of so many points below the ground take, about."""
    return PROCESS + BELOW_POINT * n_points


def plan_run(
    n_points, memory, n_jobs=None, n_features=0, tile_size=None, *, work="normals",
    n_neighbors=NEIGHBORS,
):  # fmt: skip
    """Divide points so that all workers together stay within the memory.

    `work` is as of `costs_of`, and `n_neighbors` the most that are asked for. Raise if one worker
    with the smallest tile would take more.
    """
    costs, more = costs_of(work), 4 * max(0, n_neighbors - NEIGHBORS)
    stored, bytes_a_point = costs.stored + more, costs.tile + FEATURE * n_features + 2 * more
    own = PROCESS + PART * PART_POINT  # of the process that reads and writes
    least = PROCESS + LEAST_TILE * bytes_a_point
    why = f" with $n_neighbors={n_neighbors}" if more else ""
    if costs.whole:
        joins = work.startswith("regions")
        at_once = JOINED_POINT * min(n_points, JOINED_AT_ONCE) if joins else 0
        whole = PROCESS + costs.whole * n_points + at_once
        if whole > max(own, least):
            why = f", because one process {costs.does} all {n_points:,} points"
        own = max(own, whole)
    if memory < own or memory < least:
        given = f"{memory / 1e6:.0f}MB" if memory >= 1e6 else f"{memory:g} bytes"
        raise ParameterError(
            f"$memory={given} is too little: at least {max(own, least) / 1e6:.0f}MB is needed{why}."
        )
    n_jobs = n_workers = _n_jobs(n_jobs)
    if costs.whole:  # other processes stay, while one works on the whole
        n_workers = max(1, min(n_workers, int((memory - own) // max(PROCESS, 1))))
    if n_workers > 1:  # processes of their own
        n_workers = max(1, min(n_workers, int((memory - PROCESS) // least)))

    def capacity(n_workers):
        for_tiles = memory - PROCESS * (n_workers + (n_workers > 1))
        return int(for_tiles / n_workers / bytes_a_point)

    shares = not _is_elsewhere()
    if tile_size is None and shares:
        while n_workers > 1 and capacity(n_workers) < min(GOOD_TILE, n_points / n_workers):
            n_workers -= 1
    most = capacity(n_workers)
    if tile_size is None:
        enough = n_points if n_workers == 1 else max(GOOD_TILE, int(n_points / n_workers / EACH))
        tile_size = min(most, enough, n_points)
    n_tiles = max(1, round(n_points / (FILL * tile_size))) if tile_size < n_points else 1
    n_workers = min(n_workers, n_tiles)
    n_threads = max(1, n_jobs // n_workers) if shares else 1
    used = PROCESS * (n_workers + (n_workers > 1)) + n_workers * tile_size * bytes_a_point
    disk = n_points * (stored + 4 * n_features)
    if costs.whole and n_workers > 1:
        own += PROCESS * n_workers
    return Plan(n_workers, n_threads, tile_size, n_tiles, max(own, used), disk)


def _n_jobs(n_jobs):
    """How many threads of execution the caller asks for."""
    n_workers = effective_n_jobs(n_jobs)
    if n_jobs is not None and n_jobs > 0:  # dask counts all of its workers
        n_workers = min(n_workers, n_jobs)
    return n_workers


def _is_elsewhere():
    """Whether an engine computes tiles that has its own processes, on this machine or others."""
    return hasattr(get_active_backend()[0], "client")
