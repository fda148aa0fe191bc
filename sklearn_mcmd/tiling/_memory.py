"""How much memory a run may take, and how many points a cell then may have."""

import os
import re
import tracemalloc
from contextlib import suppress
from numbers import Integral
from pathlib import Path
from typing import NamedTuple

import numpy as np
from joblib import effective_n_jobs
from joblib.parallel import get_active_backend

from sklearn_mcmd._errors import ParameterError

SHARE = 0.5  # share of the machine's memory that a run may take if nothing is said
UNKNOWN = 4e9  # bytes of a machine that does not say how many it has
PROCESS = 330e6  # bytes of a process with its compiled code
PART = 250_000  # points read or written at once
PART_POINT = 400  # bytes of a point while it is read or written
IN_MEMORY = 1_100  # bytes of a point that is worked on without tiles, besides its record, at most
MEASURED = 15_000, 45_000  # points of two fits, which tell what a point more takes
UNSEEN = 1.1  # What NumPy takes is measured. Trees and work arrays of compiled code are more.
CELL_POINT = 200  # bytes of a point in a cell or its halo, besides the fit
HALO = 1.2  # points of a cell with its halo, as a multiple of its own
USUAL_CELL = 1_000_000  # points; the halo of larger ones takes hardly less time
SMALLEST_CELL = 15_000  # points; the halo of smaller ones is larger than they are
USUAL_NEIGHBORS = 50  # of which `MEASURED` fits take little time
WARM_UP = 100  # neighbors at most that load or compile the code


class Plan(NamedTuple):
    """How a cloud is to be divided."""

    n_workers: int  # cells that are worked on at once
    n_threads: int  # of each of these
    tile_size: int  # points of a cell, at most
    n_tiles: int  # about
    memory: float  # bytes, about


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


def gives_threads():
    """Whether tiles get threads; not of an engine with its own processes, maybe elsewhere."""
    return not hasattr(get_active_backend()[0], "client")


def bytes_in_memory(catalog):
    """What a whole catalog takes in memory, about."""
    sizes = zip(catalog.counts, catalog.record_sizes, strict=True)
    return PROCESS + sum(n * (size + IN_MEMORY) for n, size in sizes)


def bytes_of_point(fit, xyz, n_neighbors=USUAL_NEIGHBORS):
    """What a point takes while ``fit(points)`` works, in a cell: measured with some of the points
    near each other, where there are enough; with fewer, if neighborhoods are large."""
    order = np.argsort(np.linalg.norm(xyz - np.median(xyz, axis=0), axis=1), kind="stable")
    fewer = min(1.0, (2 * USUAL_NEIGHBORS / n_neighbors) ** 2)
    sizes = [min(max(int(fewer * n), n_neighbors * n // MEASURED[0]), len(xyz)) for n in MEASURED]
    peaks = []
    few = order[: max(sizes[0] // 4, n_neighbors)]
    fit(xyz[np.sort(few)])  # what is loaded at the first time is in no slope
    for n in sizes:
        points = xyz[np.sort(order[:n])]
        tracemalloc.start()
        try:
            fit(points)
            peaks.append(tracemalloc.get_traced_memory()[1])
        finally:
            tracemalloc.stop()
    more = sizes[1] - sizes[0]
    slope = (peaks[1] - peaks[0]) / more if more >= sizes[0] else peaks[1] / sizes[1]
    return CELL_POINT + UNSEEN * max(slope, 0.0)


def check_tile_size(tile_size):
    """Raise if a cloud cannot be divided like this."""
    is_int = isinstance(tile_size, Integral) and not isinstance(tile_size, bool)
    if tile_size is not None and not (is_int and tile_size >= 1):
        raise ValueError(f"tile_size={tile_size!r} must be an int of 1 or more, or None.")


def check_memory(n_points, memory, point, whole=0.0, does="", n_neighbors=0):
    """Raise if the memory is too little, as `plan_run`; returns what the first process takes."""
    first = PROCESS + PART * PART_POINT + whole * n_points  # reads, writes and joins
    cell = PROCESS + HALO * min(SMALLEST_CELL, n_points) * point
    if memory < max(first, cell):
        given = f"{memory / 1e6:.0f}MB" if memory >= 1e6 else f"{memory:g} bytes"
        why = f", because one process {does} all {n_points:,} points" if whole else ""
        if cell > first:
            why = f" with $n_neighbors={n_neighbors}" if n_neighbors > USUAL_NEIGHBORS else ""
        raise ParameterError(
            f"$memory={given} is too little: at least {max(first, cell) / 1e6:.0f}MB is needed"
            f"{why}."
        )
    return first


def least_bytes_of_point(n_neighbors):
    """What a point takes at least: its neighbors, as they are found and as they are kept."""
    return CELL_POINT + 8 * n_neighbors


def plan_run(n_points, memory, n_jobs, tile_size, point, whole=0.0, does="", n_neighbors=0):
    """Divide points so that all workers stay within the memory.

    A point of a cell takes `point` bytes. One process has `whole` bytes of each point of the cloud,
    because it `does` something with all. The size of cells does not depend on the number of
    workers, so that results do not, either.
    """
    asked, n_jobs = n_jobs, effective_n_jobs(n_jobs)
    if asked is not None and asked > 0:  # dask counts all of its workers
        n_jobs = min(n_jobs, asked)
    first = check_memory(n_points, memory, point, whole, does, n_neighbors)
    if tile_size is None:
        # Of dask each worker has memory of its own.
        tile_size, share = USUAL_CELL, memory if gives_threads() else memory / n_jobs
        while PROCESS + HALO * tile_size * point > share and tile_size > SMALLEST_CELL:
            tile_size = tile_size * 7 // 10
    cell = HALO * min(tile_size, n_points) * point
    # One process works by itself; of several, the first waits.
    others = PROCESS * (1 + (whole > 0)) + whole * n_points
    n_workers = max(1, min(n_jobs, int((memory - others) // (PROCESS + cell))))
    n_tiles = max(1, round(n_points / (0.7 * tile_size))) if tile_size < n_points else 1
    n_workers = min(n_workers, n_tiles)
    used = PROCESS + cell if n_workers == 1 else others + n_workers * (PROCESS + cell)
    return Plan(
        n_workers=n_workers,
        n_threads=max(1, n_jobs // n_workers) if gives_threads() else 1,
        tile_size=tile_size,
        n_tiles=n_tiles,
        memory=max(first, used),
    )
