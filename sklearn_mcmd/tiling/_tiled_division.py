"""Regions divided at creases: all is found tile by tile, but what is asked of whole patches.

Tiles are what is a cell elsewhere: here cells are the small neighborhoods that divide regions.
"""

import shutil

import numpy as np

from sklearn_mcmd._errors import ParameterError
from sklearn_mcmd.planes._record import Planes
from sklearn_mcmd.segmentation._estimator import rules_of
from sklearn_mcmd.segmentation._region_division import (
    Points,
    Sums,
    blocks,
    divided,
    joined,
    numbers,
    unique_pairs,
)
from sklearn_mcmd.tiling._memory import bytes_to_divide
from sklearn_mcmd.tiling._stored_columns import ALL, CellColumns, StoredColumns
from sklearn_mcmd.tiling._stored_index import StoredIndex
from sklearn_mcmd.tiling._sweeps import Sweeps

STEPS = "noise", "gathered", "summed", "joined"
ROW = np.int32, ()


def divide_in_tiles(labels, index, planes, rules, n_jobs, *, job, n_workers, memory):
    """As `divide_at_creases`, of the places of a job."""
    whole, columns, done = job.whole(), CellColumns(job.found / "division"), job.found / "divided"
    shutil.rmtree(done, ignore_errors=True)  # an earlier run may have ended while it was removed
    columns.folder.mkdir(exist_ok=True)
    stored, tiles = StoredColumns(columns, 0), np.flatnonzero(job.cells.counts)
    stored.starts = whole.starts
    stored.make(noise=(np.float64, ()), begin0=ROW)
    whole.flush()
    sweeps, known = Sweeps(n_workers, STEPS), {"columns": columns, "of": job}
    sweeps("noise", _find_noise, job.cells, **known)
    reports = [columns.report(tile, "noise") for tile in tiles]
    least, most = (f(report[f.__name__] for report in reports) for f in (min, max))
    columns.finish(ALL, "units", bounds=(least, most))
    opened = {"stored": stored, "opened": (index, planes, labels), "n_jobs": n_jobs}
    _, has_units = _points(**known, **opened)
    if has_units and any(report["n"] for report in reports):
        with sweeps.part("gathered"):
            step = _gather(sweeps, stored, tiles, **known)
        points, _ = _points(**known, step=step, **opened)
        sweeps("summed", _find_sums, job.cells, **known, step=step)
        begins, number, edges = _cells(points, columns, tiles, memory)
        if not columns.is_done(ALL, "blocks"):
            _write_blocks(whole, columns, begins, edges)
            columns.finish(ALL, "blocks")
        sweeps("joined", _join_blocks, job.cells, **known)
        members, first, roots, sums = (
            _read(columns, tiles, name) for name in ("members", "first", "roots", "of_roots")
        )
        order, patch = np.argsort(number[roots]), np.empty(len(begins), np.int32)
        roots = number[roots][order]
        patch[number[members]] = np.searchsorted(roots, number[first])
        patches = roots, patch, _sums(sums[order]), edges
        with stored.releasing():
            labels[:] = divided(points, rules, begins, number, *patches)
    shutil.rmtree(columns.folder.rename(done), ignore_errors=True)
    return labels


def _points(columns, of, step=0, stored=None, opened=None, n_jobs=None):
    """The `Points` of all places before a step of `_gather`, and whether their noise has a unit.

    This process has `stored` columns and `opened` index, planes and labels; others open them.
    """
    if opened is None:
        whole = of.whole()
        labels, scale = map(whole.open_copy, ("labels", "scale"))
        planes = Planes.empty(0, 3)._replace(scale=scale, radius=whole.open("reach"))
        opened = StoredIndex(whole, of.cells, of.growing.n_neighbors), planes, labels
        stored, n_jobs = StoredColumns(columns, 0), of.n_threads
    index, planes, labels = opened
    noise, begin = map(stored.open, ("noise", f"begin{step}"))
    points = Points(index, planes, rules_of(of.growing), labels, noise, begin, n_jobs)
    known = columns.is_done(ALL, "units") and columns.report(ALL, "units")["bounds"]
    low, high = of.cells.extent(slice(None))
    return points, bool(known) and points.scale(*known, low.min(axis=0), high.max(axis=0))


def _read(columns, tiles, name):
    return np.concatenate([columns.read(tile, name) for tile in tiles])


def _find_noise(tile, columns, of):
    """Fill the noise of a tile, and write which of its places have neighbors in other tiles.

    A link is a place of another tile, and one of this that has it among its neighbors.
    """
    own, (points, _) = of.whole().rows(tile), _points(columns, of)
    noise, labels, near = points.usual_noise(own), np.array(points.labels[own]), points.near(own)
    StoredColumns(columns, 0).put(tile, noise=noise, begin0=np.full(len(noise), -1, np.int32))
    beyond = (labels[:, None] >= 0) & ((near < own.start) | (near >= own.stop))
    rows, at = np.nonzero(beyond)
    links = np.column_stack([near[rows, at], own.start + rows]).astype(np.int32)
    links = links[points.labels[links[:, 0]] == labels[rows]]
    columns.write(tile, links=links[np.argsort(links[:, 0], kind="stable")])
    n = int(np.count_nonzero(labels >= 0))
    columns.finish(tile, "noise", n=n, min=noise.min(), max=noise.max())


def _gather(sweeps, stored, tiles, columns, of):
    """Gather cells, in as many steps as places wait for those of other tiles; how many these were.

    Each asks for what others knew before it, so that it matters neither which tile comes first, nor
    whether two workers have the same.
    """
    step, n_open = 0, 1
    while n_open:
        stored.make(**{f"begin{step + 1}": ROW})
        name = f"gathered{step}"
        sweeps(name, _gather_in, of.cells, columns=columns, of=of, step=step)
        n_open = sum(columns.report(tile, name)["n_open"] for tile in tiles)
        if step > 1:  # a run that goes on opens the first
            stored.remove(f"begin{step - 1}")
        step += 1
    return step


def _gather_in(tile, columns, of, step):
    """Fill the cells of the places of a tile, as far as those of others tell."""
    own, (points, _) = of.whole().rows(tile), _points(columns, of, step)
    cell = np.array(points.cell[own])
    is_open = (cell < 0) & (points.labels[own] >= 0)
    if is_open.any():
        parts = []
        for other in np.flatnonzero(of.cells.counts):
            links = columns.mapped(other, "links")
            parts.append(links[slice(*np.searchsorted(links[:, 0], [own.start, own.stop]))])
        cell = points.gather(own, np.concatenate(parts))
        is_open &= cell < 0
    StoredColumns(columns, 0).put(tile, **{f"begin{step + 1}": cell})
    columns.finish(tile, f"gathered{step}", n_open=int(np.count_nonzero(is_open)))


def _find_sums(tile, columns, of, step):
    """Write the cells that begin in a tile, their sums, and which cells are neighbors in it."""
    own, (points, _) = of.whole().rows(tile), _points(columns, of, step)
    rows = np.arange(own.start, own.stop, dtype=np.int32)
    begins = rows[points.cell[own] == rows]
    sums = np.column_stack(points.sums(begins)) if len(begins) else np.empty((0, 11))
    columns.write(tile, begins=begins, sums=sums, pairs=points.pairs(own))
    columns.finish(tile, "summed")


def _cells(points, columns, tiles, memory):
    """Where cells begin, in order, their numbers, and edges; raises if these take too much."""
    n, n_pairs = (
        sum(len(columns.mapped(tile, name)) for tile in tiles) for name in ("begins", "pairs")
    )
    if (needed := bytes_to_divide(n, n_pairs)) > memory:
        raise ParameterError(
            f"{n:,} small parts of regions have {n_pairs:,} borders, which take about "
            f"{needed / 1e6:.0f}MB, more than $memory={memory / 1e6:.0f}MB; give more memory"
        )
    begins = _read(columns, tiles, "begins")
    begins = begins[points.in_order(begins)]
    number = numbers(points.index, begins)
    return begins, number, unique_pairs(_read(columns, tiles, "pairs"), number)


def _write_blocks(whole, columns, begins, edges):
    """Write for each tile the cells of the blocks that begin in it, and the edges within these."""
    block = blocks(edges, len(begins))
    tile_of = np.searchsorted(whole.starts, begins[block], side="right") - 1
    inside = edges[np.equal(*block[edges].T)]
    for tile in np.flatnonzero(np.diff(whole.starts)):
        members = np.flatnonzero(tile_of == tile)
        own = np.searchsorted(members, inside[tile_of[inside[:, 0]] == tile])
        columns.write(tile, members=begins[members], inside=own)


def _join_blocks(tile, columns, of):
    """Join the cells of the blocks that begin in a tile, and write the patch of each."""
    begins, edges = (columns.read(tile, name) for name in ("members", "inside"))
    sums, tile_of = np.empty((len(begins), 11)), np.searchsorted(of.whole().starts, begins, "right")
    for other in np.unique(tile_of) - 1:
        some, known = np.flatnonzero(tile_of == other + 1), columns.mapped(other, "begins")
        sums[some] = columns.mapped(other, "sums")[np.searchsorted(known, begins[some])]
    roots, patch, sums = joined(_sums(sums), edges)
    roots = begins[roots]
    columns.write(tile, roots=roots, first=roots[patch], of_roots=np.column_stack(sums))
    columns.finish(tile, "joined")


def _sums(rows):
    """The `Sums` that lie in rows of numbers."""
    parts = rows[:, 0], rows[:, 1], rows[:, 2:5], rows[:, 5:]
    return Sums(*(np.ascontiguousarray(part) for part in parts))
