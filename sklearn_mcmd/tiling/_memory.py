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

__all__ = [
    "JUDGED_POINT",
    "JUDGED_STORED",
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
# Measured, see docs/tiling.rst: bytes of a process with its compiled code, for each point of a tile
# while its normals are computed, for each point of a cloud in memory besides what its record has,
# and for each value of a feature.
PROCESS, TILE_POINT, CLOUD_POINT, FEATURE = 330e6, 650, 450, 24
# Costs are those of so many neighbors. Each that is more takes 4 bytes of disk and 8 of a tile.
NEIGHBORS = 50
# Bytes of temporary files for each point: of normals, and of what the detector finds; and what the
# detector takes for each point of a tile. The same of edges, and of normals with "auto".
TILE_STORED, JUDGED_STORED, JUDGED_POINT = 430, 400, 450
EDGES_STORED, EDGES_POINT, EDGES_CLOUD = 480, 750, 1100
AUTO_STORED, AUTO_POINT, AUTO_CLOUD = 800, 1300, 750
# With heights over the ground: temporary files, and each point that lies below the ground.
HEIGHTS_STORED, BELOW_POINT = 460, 750
# With rays, and with a position for each point: temporary files, and what one process takes for
# each point that follows rays, keeps times, or adjusts flight lines.
RAYS_STORED, ORIGINS_STORED, RAYS_CLOUD, TIMES_CLOUD, ANGLES_CLOUD = 250, 24, 200, 20, 250
# Of outliers, once planes are known, each point of the cloud; and of numbers of neighbors.
JUDGED_CLOUD, SIZED_CLOUD = 35, 80
# Of regions: temporary files; what the growing and joining of regions takes, for each point of the
# cloud, and of so many points at once; and what a cloud takes in memory besides its records.
GROWN_STORED, GROWN_POINT, JOINED_POINT, JOINED_AT_ONCE, GROWN_CLOUD = 470, 60, 150, 1_000_000, 720
# Of these, of each point, and of one that growth left over.
GROWN_LEAST, REST_POINT = 26, 200
# Of normals along a tree: a tile; temporary files; what the tree takes, for each point of the
# cloud; and the cloud in memory.
TREE_TILE, TREE_STORED, TREE_POINT, TREE_CLOUD = 650, 480, 200, 850
# By the work: bytes for each point of a tile, of temporary files, and of a cloud in memory.
COSTS = {
    "normals": (TILE_POINT, TILE_STORED, CLOUD_POINT),
    "outliers": (JUDGED_POINT, JUDGED_STORED, CLOUD_POINT),
    "heights": (JUDGED_POINT, HEIGHTS_STORED, CLOUD_POINT),
    "edges": (EDGES_POINT, EDGES_STORED, EDGES_CLOUD),
    "tree": (TREE_TILE, TREE_STORED, TREE_CLOUD),
    "regions": (TILE_POINT, GROWN_STORED, GROWN_CLOUD),
}
# What more it takes with sizes, rays, or a position of the sensor for each point: a tile, at least;
# temporary files; and a cloud in memory, beyond that of normals.
MORE = {
    "auto": (AUTO_POINT, AUTO_STORED - TILE_STORED, AUTO_CLOUD - CLOUD_POINT),
    "rays": (0, RAYS_STORED, RAYS_STORED),
    "trajectory": (0, ORIGINS_STORED, 2 * ORIGINS_STORED),
    "angles": (0, ORIGINS_STORED, ANGLES_CLOUD),
}
# What one process takes that works on all points at once, for each, and what it does.
WHOLE = {
    "regions": (GROWN_POINT, "joins the regions of"),
    "tree": (TREE_POINT, "holds the tree of"),
    **dict.fromkeys(("outliers", "heights", "edges"), (JUDGED_CLOUD, "judges")),
    "auto": (SIZED_CLOUD, "finds the numbers of neighbors of"),
    "rays": (RAYS_CLOUD, "follows the rays to"),
    "trajectory": (TIMES_CLOUD, "keeps the times of"),
    "angles": (ANGLES_CLOUD, "adjusts the flight lines of"),
}
# Points read or written at once, and bytes for each while that is done.
PART, PART_POINT = 250_000, 400
LEAST_TILE = 20_000  # most points of smaller tiles have neighbors in others
# Where there is memory for more, each process gets EACH tiles or more, of GOOD_TILE points or more.
# Where there is less, fewer processes with more threads each have tiles as large.
EACH, GOOD_TILE = 2, 1_000_000
FILL = 0.7  # how full cells are that are halved when they are full


class Plan(NamedTuple):
    """How a catalog is to be divided.

    n_workers : int
        Tiles that are computed at once.
    n_threads : int
        Of each worker.
    tile_size : int
        Largest number of points in a tile.
    n_tiles : int
        About as many.
    memory, disk : float
        Bytes, about; disk is for temporary files.
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


def most_neighbors(*estimators):
    """The largest number of neighbors of some estimators."""
    numbers = [e.n_neighbors for e in estimators if e is not None]
    return max((k for k in numbers if isinstance(k, Integral)), default=NEIGHBORS)


def sized(work, estimator):
    """The name of some work with an estimator of normals."""
    return f"{work}, auto" if estimator.n_neighbors == "auto" else work


def sensed(work, detector, sensor=None):
    """The name of some work with a detector, or None, and a `SensorPath`."""
    moving = sensor is not None
    if moving or (detector is not None and detector.sensor_origin is not None):
        work = f"{work}, rays"
    return f"{work}, {sensor.kind}" if moving and sensor.kind in MORE else work


def costs_of(work):
    """Bytes for each point of a tile, of temporary files, and of a cloud in memory, of some work.

    It is a key of `COSTS`, and after commas keys of `MORE`.
    """
    base, *more = work.split(", ")
    point, stored, cloud = COSTS[base]
    for name in more:
        least, files, memory = MORE[name]
        point, stored, cloud = max(point, least), stored + files, max(cloud, CLOUD_POINT + memory)
    return point, stored, cloud


def whole_costs_of(work):
    """Bytes for each point of a cloud that one process takes, and what it does; (0, "") if none."""
    return max((WHOLE[name] for name in work.split(", ") if name in WHOLE), default=(0, ""))


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
    cloud_point = costs_of(work)[2]
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

    `work` is as of `costs_of`, and `n_neighbors` the most that are asked for.

    Raises
    ------
    ValueError
        If one worker with the smallest tile would take more.
    """
    point, stored, _ = costs_of(work)
    whole_point, does = whole_costs_of(work)
    more = 4 * max(0, n_neighbors - NEIGHBORS)
    stored, bytes_a_point = stored + more, point + FEATURE * n_features + 2 * more
    own = PROCESS + PART * PART_POINT  # of the process that reads and writes
    least, why = PROCESS + LEAST_TILE * bytes_a_point, ""
    if does:
        joins = work.startswith("regions")
        at_once = JOINED_POINT * min(n_points, JOINED_AT_ONCE) if joins else 0
        own = max(own, PROCESS + whole_point * n_points + at_once)
        if own > least:
            why = f", because one process {does} all {n_points:,} points"
    if memory < own or memory < least:
        given = f"{memory / 1e6:.0f}MB" if memory >= 1e6 else f"{memory:g} bytes"
        raise ParameterError(
            f"$memory={given} is too little: at least {max(own, least) / 1e6:.0f}MB is needed{why}."
        )
    n_jobs = n_workers = _n_jobs(n_jobs)
    if does:  # other processes stay, while one works on the whole
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
    if does and n_workers > 1:
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
