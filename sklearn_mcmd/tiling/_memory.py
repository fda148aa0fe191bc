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
from sklearn_mcmd.tiling._stored_neighbors import bytes_of_neighbors

SHARE = 0.5  # share of the machine's memory that a run may take if nothing is said
UNKNOWN = 4e9  # bytes of a machine that does not say how many it has


class Costs(NamedTuple):
    """Bytes for each point that a work takes, measured; see docs/tiling.rst."""

    tile: int = 0  # of a tile
    stored: int = 0  # of temporary files, besides neighbors
    cloud: int = 0  # of a cloud in memory besides what its record has
    whole: int = 0  # of all points, in one process that works on all at once
    does: str = ""  # what that process does


COSTS = {
    "normals": Costs(tile=650, stored=175, cloud=450),
    "outliers": Costs(tile=450, stored=150, cloud=450, whole=4, does="joins the groups of"),
    "heights": Costs(tile=450, stored=178, cloud=450, whole=4, does="joins the groups of"),
    "edges": Costs(tile=750, stored=172, cloud=1100, whole=4, does="joins the groups of"),
    "tree": Costs(tile=650, stored=205, cloud=850, whole=200, does="holds the tree of"),
    "regions": Costs(tile=650, stored=177, cloud=720, whole=8, does="joins the regions of"),
    # Beside these: numbers of neighbors are found, rays are followed, each point has a position.
    "auto": Costs(tile=1300, stored=300, cloud=750),
    "rays": Costs(stored=130, cloud=650),
    "light": Costs(stored=16, cloud=480),
    "table": Costs(cloud=720, whole=130, does="describes the regions of"),
    "positions": Costs(stored=50, cloud=500, whole=24, does="holds positions for"),
    "trajectory": Costs(stored=50, cloud=500, whole=30, does="keeps the times of"),
    "angles": Costs(stored=50, cloud=750, whole=300, does="adjusts the flight lines of"),
}
PROCESS = 330e6  # bytes of a process with its compiled code
FEATURE = 24  # bytes of a feature of a point
NEIGHBORS = 50  # whose costs of a tile these are; each more takes 8 bytes for a point
PART_OR_LINK = 160  # bytes of each that one process joins across cells
CELL_OF_REGION, BORDER_OF_CELLS = 200, 80  # bytes of what divides regions, in one process
LEVEL = 60  # bytes of a value that some coordinate or intensity has
SMALL_POINT = 400  # bytes of a point of small groups, which one process judges
BELOW_POINT = 750  # bytes of a point below the ground, whose groups are found
JOINED_POINT = 150  # bytes of a point while regions are joined
JOINED_AT_ONCE = 1_000_000  # points of regions that are joined at once
REST_POINT = 200  # bytes of a point that growth left over
PART = 250_000  # points read or written at once
PART_POINT = 400  # bytes of a point while it is read or written
LEAST_TILE = 20_000  # most points of smaller tiles have neighbors in others
EACH = 2  # tiles that each process gets at least, where there is memory for more
GOOD_TILE = 1_000_000  # points of a tile that is worth a process of its own
FILL = 0.7  # how full cells are that are halved when they are full


class Plan(NamedTuple):
    """How a catalog is to be divided."""

    n_workers: int  # tiles that are computed at once
    n_threads: int  # of each of these
    tile_size: int  # points of a tile, at most
    n_tiles: int  # about
    memory: float  # bytes, about
    disk: float  # bytes, about


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
    estimators = [estimator for estimator in estimators if estimator is not None]
    for estimator in estimators:
        check_work(estimator, n_points)
    sizes = (estimator.n_neighbors for estimator in estimators)
    return max((k for k in sizes if isinstance(k, Integral)), default=NEIGHBORS)


def work_of(base, normals=None, detector=None, sensor=None, light=False, table=False):
    """The name of some work, as of `costs_of`, with estimators, a `SensorPath`, intensity, and a
    table of regions."""
    more = ["auto"] * (normals is not None and normals.n_neighbors == "auto")
    if detector is not None:
        more += ["rays"] * (sensor is not None or detector.sensor_origin is not None)
    more += ["light"] * light + ["table"] * table
    return ", ".join([base, *more, *([] if sensor is None else [sensor.kind])])


def costs_of(work):
    """The `Costs` of a work: keys of `COSTS` with commas between. The disk is that of all."""
    parts = [COSTS[name] for name in work.split(", ")]
    tile, stored, cloud, whole, _ = zip(*parts, strict=True)
    does = max(parts, key=lambda part: part.whole).does
    return Costs(tile=max(tile), stored=sum(stored), cloud=max(cloud), whole=max(whole), does=does)


def gives_threads():
    """Whether tiles get threads; not of an engine with its own processes, maybe elsewhere."""
    return not hasattr(get_active_backend()[0], "client")


def check_tile_size(tile_size):
    """Raise if a cloud cannot be divided like this."""
    is_int = isinstance(tile_size, Integral) and not isinstance(tile_size, bool)
    if tile_size is not None and not (is_int and tile_size >= 1):
        raise ValueError(f"tile_size={tile_size!r} must be an int of 1 or more, or None.")


def usual_memory():
    """Half of the machine's bytes, or of dask's workers' by the one with the least for a task."""
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
    more = costs_of(work).cloud + FEATURE * n_features
    sizes = zip(catalog.counts, catalog.record_sizes, strict=True)
    return PROCESS + sum(n * (size + more) for n, size in sizes)


def bytes_to_join(n_points, n_rest):
    """What the joining of regions takes, about, if growth left over so many of the points."""
    at_once = JOINED_POINT * min(n_points, JOINED_AT_ONCE)
    return PROCESS + at_once + REST_POINT * n_rest


def check_parts(n_parts, n_links, memory):
    """Raise if what one process joins takes more than the memory, as all below."""
    what = f"{n_parts:,} parts of surfaces, groups or regions have {n_links:,} links, which"
    _check(what, PART_OR_LINK * (n_parts + n_links), memory)


def check_cells_of_regions(n_cells, n_borders, memory):
    """Raise if the small cells of regions, and their borders, take too much."""
    what = f"{n_cells:,} small parts of regions have {n_borders:,} borders, which"
    _check(what, CELL_OF_REGION * n_cells + BORDER_OF_CELLS * n_borders, memory)


def check_small_groups(n_points, memory):
    """Raise if points of small groups off all surfaces take too much."""
    what = f"{n_points:,} points lie in small groups off all surfaces, which"
    _check(what, SMALL_POINT * n_points, memory)


def check_levels(n, memory):
    """Raise if so many different values of intensity take too much."""
    _check(f"intensity has more than {n:,} different values, which", LEVEL * n, memory)


def check_groups_below(n_points, memory):
    """Raise if groups of so many points below the ground take too much."""
    remedy = "check the ground (class 2), or leave groups below it out (low_groups)"
    what = f"{n_points:,} points lie below the ground, whose groups"
    _check(what, BELOW_POINT * n_points, memory, f", {remedy}")


def _check(what, needed, memory, remedy=""):
    needed += PROCESS
    if needed > memory:
        raise ParameterError(
            f"{what} take about {needed / 1e6:.0f}MB, more than $memory={memory / 1e6:.0f}MB; "
            f"give more memory{remedy}"
        )


def plan_run(
    n_points, memory, n_jobs=None, n_features=0, tile_size=None, *, work="normals", n_neighbors=None
):
    """Divide points so that all workers stay within the memory; `work` is as of `costs_of`."""
    costs, more = costs_of(work), max(0, (n_neighbors or NEIGHBORS) - NEIGHBORS)
    bytes_a_point = costs.tile + FEATURE * n_features + 8 * more
    stored = costs.stored + 4 * n_features + bytes_of_neighbors(n_neighbors or NEIGHBORS)
    own, least = _least(n_points, work, bytes_a_point, n_neighbors if more else None, memory)
    asked, n_jobs = n_jobs, effective_n_jobs(n_jobs)
    if asked is not None and asked > 0:  # dask counts all of its workers
        n_jobs = min(n_jobs, asked)
    n_workers = n_jobs
    if costs.whole:  # other processes stay, while one works on the whole
        n_workers = max(1, min(n_workers, int((memory - own) // max(PROCESS, 1))))
    if n_workers > 1:  # processes of their own
        n_workers = max(1, min(n_workers, int((memory - PROCESS) // least)))

    def capacity(n_workers):
        for_tiles = memory - PROCESS * (n_workers + (n_workers > 1))
        return int(for_tiles / n_workers / bytes_a_point)

    shares = gives_threads()
    # Fewer processes with more threads each have tiles that are large enough.
    if tile_size is None and shares:
        while n_workers > 1 and capacity(n_workers) < min(GOOD_TILE, n_points / n_workers):
            n_workers -= 1
    if tile_size is None:
        enough = n_points if n_workers == 1 else max(GOOD_TILE, int(n_points / n_workers / EACH))
        tile_size = min(capacity(n_workers), enough, n_points)
    n_tiles = max(1, round(n_points / (FILL * tile_size))) if tile_size < n_points else 1
    n_workers = min(n_workers, n_tiles)
    used = PROCESS * (n_workers + (n_workers > 1)) + n_workers * tile_size * bytes_a_point
    if costs.whole and n_workers > 1:
        own += PROCESS * n_workers
    return Plan(
        n_workers=n_workers,
        n_threads=max(1, n_jobs // n_workers) if shares else 1,
        tile_size=tile_size,
        n_tiles=n_tiles,
        memory=max(own, used),
        disk=n_points * stored,
    )


def _least(n_points, work, bytes_a_point, n_neighbors, memory):
    """Bytes of the process that reads and writes, and with the smallest tile; raise if too many."""
    costs = costs_of(work)
    own, least = PROCESS + PART * PART_POINT, PROCESS + LEAST_TILE * bytes_a_point
    why = f" with $n_neighbors={n_neighbors}" if n_neighbors else ""
    if costs.whole:
        whole = PROCESS + costs.whole * n_points
        if work.startswith("regions"):
            whole += JOINED_POINT * min(n_points, JOINED_AT_ONCE)
        if whole > max(own, least):
            why = f", because one process {costs.does} all {n_points:,} points"
        own = max(own, whole)
    if memory < own or memory < least:
        given = f"{memory / 1e6:.0f}MB" if memory >= 1e6 else f"{memory:g} bytes"
        raise ParameterError(
            f"$memory={given} is too little: at least {max(own, least) / 1e6:.0f}MB is needed{why}."
        )
    return own, least
