"""Regions divided at creases: all is found tile by tile, but how patches are joined to groups.

Tiles are what is a cell elsewhere: here cells are the small neighborhoods that divide regions.
Cells, blocks and patches are named by the place at which they begin, and belong to its tile.
"""

import shutil
from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from sklearn_mcmd.planes._record import Planes
from sklearn_mcmd.runtime._chunks import slices
from sklearn_mcmd.segmentation._estimator import rules_of
from sklearn_mcmd.segmentation._region_cells import Points, Sums, named, once, pairs_of, places
from sklearn_mcmd.segmentation._region_division import (
    Patches,
    Strips,
    VoteLimits,
    are_whole,
    divided,
)
from sklearn_mcmd.tiling._memory import check_cells_of_regions
from sklearn_mcmd.tiling._stored_columns import ALL, CellColumns, StoredColumns
from sklearn_mcmd.tiling._stored_index import StoredIndex
from sklearn_mcmd.tiling._sweeps import Job, Sweeps

STEPS = "noise", "gathered", "summed", "blocked", "joined", "bordered", "patched", "voted"
VOTES = 1024  # borders that are asked at once; it limits the memory


def divide_in_tiles(labels, index, planes, rules, n_jobs, parts, *, job, n_workers, memory):
    """As `divide_at_creases`, of the places of a job, whose columns all these are."""
    whole = job.whole()
    if whole.columns.is_done(ALL, "divided"):  # by a run that ended later on
        whole.copy(True, divided="region_of")
        return labels
    job = DivisionJob(job, n_threads=job.n_threads)
    columns, tiles = job.columns, np.flatnonzero(job.cells.counts)
    columns.folder.mkdir(exist_ok=True)
    stored = StoredColumns(columns)
    stored.starts = whole.starts
    stored.make(noise=float)
    sweeps = Sweeps(n_workers, STEPS)
    sweeps("noise", _find_noise, job.cells, job=job)
    reports = [columns.report(tile, "noise") for tile in tiles]
    least, most = (f(report[f.__name__] for report in reports) for f in (min, max))
    low, high = job.cells.extent(slice(None))
    ends = low.min(axis=0).tolist(), high.max(axis=0).tolist()
    columns.finish(ALL, "units", least=least, most=most, ends=ends)
    if any(report["n"] for report in reports) and job.points() is not None:
        job = _in_blocks(sweeps, job, stored)
        for name, work in (("joined", _join_blocks), ("bordered", _find_borders)):
            sweeps(name, work, job.cells, job=job)
        roots, borders = _patches(columns, tiles, memory)
        points = replace(job, n_threads=n_jobs).points(column=StoredColumns.column)
        last, patch, sums = points.joined(roots, _sums(columns.gather(tiles, "of_roots")), borders)
        if not are_whole(labels, last):
            borders = pairs_of(named(borders, lambda names: patch[places(roots, names)]))
            columns.write(ALL, patches=np.sort(roots.astype(np.int64) << 32 | patch))
            stored.make(patch=np.int32)
            sweeps("patched", _name_patches, job.cells, job=job)
            cells = (columns.gather(tiles, name) for name in ("begins", "patch_of"))
            known = *cells, stored.column("patch"), last, sums, borders
            divided(points, rules, *known, partial(_vote, sweeps, job, last), parts)
    whole.copy(region_of="divided")
    shutil.rmtree(columns.folder, ignore_errors=True)
    return labels


@dataclass(frozen=True)
class DivisionJob:
    """What the sweeps over the tiles know, as of a `Job`."""

    of: Job  # with `growing`, the `RegionGrowing`
    levels: tuple[str, ...] = ()  # columns: the cell of each place, the block of each cell, ...
    n_threads: int = 1

    @property
    def cells(self):
        return self.of.cells

    @property
    def columns(self):
        return CellColumns(self.of.found / "division")

    def stored(self):
        """The columns of all places that only the division has."""
        return StoredColumns(self.columns)

    def points(self, cell=None, column=StoredColumns.open):
        """The `Points` of all places, which are opened by `column`; None if their noise has no
        unit."""
        growing, whole, stored = self.of.growing, self.of.whole(), self.stored()
        names = "region_of", "normals", "scale", "reach"
        labels, normals, scale, reach = (column(whole, name) for name in names)
        planes = Planes.empty(0, 3)._replace(normals=normals, scale=scale, radius=reach)
        index = StoredIndex(whole, n_neighbors=growing.n_neighbors, column=column)
        if cell is None and self.levels:
            cell = column(stored, self.levels[0])
        known = labels, column(stored, "noise"), cell, self.n_threads
        points = Points(index, planes, rules_of(growing), *known)
        if not self.columns.is_done(ALL, "units"):
            return points
        units = self.columns.report(ALL, "units")
        has_units = points.scale(units["least"], units["most"], *np.array(units["ends"]))
        return points if has_units else None

    def names(self, tile):
        """The names of the cells, or of the blocks found last, that a tile has."""
        own = self.of.whole().rows(tile)
        rows = np.arange(own.start, own.stop, dtype=np.int32)
        return rows[self.stored().open(self.levels[-1])[own] == rows]

    def blocks_of(self, names):
        """The blocks of cells, of the last level."""
        for level in self.levels[1:]:
            names = self.stored().open(level)[names]
        return names

    def collected(self, name, tile):
        """Numbers, as of `keys`, whose first names are of a tile, of the columns of all tiles."""
        parts, starts = [], self.of.whole().starts
        ends = starts[tile : tile + 2] << 32
        for other in np.flatnonzero(np.diff(starts)):
            found = self.columns.mapped(other, name)
            parts.append(found[slice(*np.searchsorted(found, ends))])
        return once(parts)


def _in_blocks(sweeps, job, stored):
    """The job, once all tiles know the cells of their places, and blocks of these."""
    tiles = np.flatnonzero(job.cells.counts)
    for level in range(1 + VoteLimits().rings):
        if level > 0:
            name, work = ("summed", _find_sums) if level == 1 else (f"named{level}", _name_blocks)
            sweeps(name, work, job.cells, job=job)
        step, n_open = 0, 1
        while n_open:  # as many steps as some wait for those of other tiles
            stored.make(**{_column(level, step + 1): np.int32})
            name, known = f"gathered{level}_{step}", {"level": level, "step": step}
            with sweeps.part("gathered") if (level, step) == (0, 0) else nullcontext():
                sweeps(name, _gather, job.cells, job=job, **known)
            n_open = sum(job.columns.report(tile, name)["n_open"] for tile in tiles)
            stored.remove(_column(level, step))
            step += 1
        for tile in tiles:
            job.columns.drop(tile, f"beside{level}")
        job = replace(job, levels=(*job.levels, _column(level, step)))
    sweeps("blocked", _find_members, job.cells, job=job)
    return job


def _column(level, step):
    """What is known before a step of the cells of places, or of the blocks of a level."""
    return f"blocks{level}_{step}"


def _find_noise(tile, job):
    """The noise of a tile, and which of its places have neighbors in other tiles.

    A link is a place of another tile, and one of this that has it among its neighbors.
    """
    own, points = job.of.whole().rows(tile), job.points()
    noise, labels, near = points.usual_noise(own), np.array(points.labels[own]), points.near(own)
    rows, at = np.nonzero((labels[:, None] >= 0) & ((near < own.start) | (near >= own.stop)))
    links = np.column_stack([near[rows, at], own.start + rows])
    links = links[points.labels[links[:, 0]] == labels[rows]].astype(np.int64)
    report = {"n": int(np.count_nonzero(labels >= 0)), "min": noise.min(), "max": noise.max()}
    return {"noise": noise, "beside0": np.sort(links[:, 0] << 32 | links[:, 1]), **report}


def _gather(tile, job, level, step):
    """The cells of the places of a tile, or the blocks of these, as far as those of others tell.

    It asks for what others knew before the step, so that it matters neither which tile comes
    first, nor whether two workers have the same.
    """
    own, stored, name = job.of.whole().rows(tile), job.stored(), _column(level, step)
    known = stored.open(name) if step else np.broadcast_to(np.int32(-1), len(job.of.whole()))
    points, group = job.points(cell=None if level else known), np.array(known[own])
    in_regions = own.start + np.flatnonzero(points.labels[own] >= 0)
    names, around = job.names(tile) if level else in_regions, f"around{level}"
    if step == 0:
        job.columns.write(tile, **{around: job.collected(f"beside{level}", tile)})
    if (group[names - own.start] < 0).any():
        beside = job.columns.read(tile, around)
        if level == 0:
            group = points.gather(own, beside)
        else:
            group[names - own.start] = points.gather_blocks(names, beside, known)
    n_open = int(np.count_nonzero(group[names - own.start] < 0))
    return {_column(level, step + 1): group, "n_open": n_open}


def _find_sums(tile, job):
    """The cells that begin in a tile, their sums, and which cells are neighbors in it."""
    points, begins = job.points(), job.names(tile)
    sums = np.column_stack(points.sums(begins)) if len(begins) else np.empty((0, 11))
    beside = points.beside(job.of.whole().rows(tile))
    return {"begins": begins, "sums": sums, "beside1": beside}


def _name_blocks(tile, job):
    """Which of the blocks found last are neighbors, as far as those before were of a tile."""
    level = len(job.levels)
    before = job.columns.read(tile, f"around{level - 1}")
    known = job.stored().open(job.levels[-1])
    return {f"beside{level}": named(before, known.__getitem__)}


def _find_members(tile, job):
    """The cells of a tile, by their blocks."""
    begins = job.columns.read(tile, "begins")
    return {"members": np.sort(job.blocks_of(begins).astype(np.int64) << 32 | begins)}


def _join_blocks(tile, job):
    """The patches of the cells of the blocks that begin in a tile, and the `Sums` of patches."""
    members, columns = pairs_of(job.collected("members", tile)), job.columns
    members = members[np.argsort(members[:, 1])]
    blocks, begins = members.T
    sums, beside = np.empty((len(begins), 11)), []
    for other, some in _by_tile(job, begins):
        known = columns.mapped(other, "begins")
        sums[some] = columns.mapped(other, "sums")[np.searchsorted(known, begins[some])]
        found = columns.mapped(other, "around1")
        beside.append(found[np.isin(found >> 32, begins[some])])
    beside = once(beside)
    pairs = pairs_of(beside)
    at = np.searchsorted(begins, pairs)
    inside = np.append(begins, -1)[at[:, 1]] == pairs[:, 1]
    inside[inside] = np.equal(*blocks[at[inside]].T)
    roots, patch, sums = job.points().joined(begins, _sums(sums), beside[inside])
    roots_of = begins.astype(np.int64) << 32 | roots[patch]
    return {"roots": roots, "roots_of": roots_of, "of_roots": np.column_stack(sums)}


def _find_borders(tile, job):
    """Which patches are neighbors, as far as cells of a tile tell."""
    around = job.columns.read(tile, "around1")
    return {"borders": named(around, partial(_roots_of, job))}


def _roots_of(job, cells):
    """The cells at which the patches of cells begin, once these are joined in blocks."""
    names, of = np.unique(cells, return_inverse=True)
    roots = np.empty_like(names)
    for other, some in _by_tile(job, job.blocks_of(names)):
        known = job.columns.mapped(other, "roots_of")
        at = np.searchsorted(known, names[some].astype(np.int64) << 32)
        roots[some] = known[at].astype(np.int32)
    return roots[of].reshape(cells.shape)


def _name_patches(tile, job):
    """The patches of the places of a tile, and those of its cells."""
    begins, known = job.columns.read(tile, "begins"), pairs_of(job.columns.read(ALL, "patches"))
    cell = job.stored().open(job.levels[0])[job.of.whole().rows(tile)]
    names, of = np.unique(np.append(begins, cell), return_inverse=True)
    patch, inside = np.full(len(names), -1, np.int32), names >= 0
    roots = _roots_of(job, names[inside])
    patch[inside] = known[np.searchsorted(known[:, 0], roots), 1]
    patch = patch[of.ravel()]
    return {"patch": patch[len(begins) :], "patch_of": patch[: len(begins)]}


def _vote(sweeps, job, last, patches, borders):
    """The vote of each border of `Patches`, in the tile at which the first begins; see `vote`."""
    columns, starts = job.columns, job.of.whole().starts
    tiles, first = np.flatnonzero(np.diff(starts)), last[borders[:, 0]]
    columns.write(ALL, **{f"all_{name}": of for name, of in patches._asdict().items()})
    for tile in tiles:
        own = slice(*np.searchsorted(first, starts[tile : tile + 2]))
        columns.write(tile, between=borders[own])
    sweeps("voted", _find_votes, job.cells, job=job)
    return columns.gather(tiles, "votes")


def _find_votes(tile, job):
    """The votes of borders that belong to a tile."""
    patches = Patches(*(job.columns.mapped(ALL, f"all_{name}") for name in Patches._fields))
    between, votes = job.columns.read(tile, "between"), [np.empty(0)]
    for some in slices(len(between), VOTES):  # all is opened anew, and what was read is freed
        points = job.points(column=StoredColumns.open_column)
        strips = Strips(points, patches, rules_of(job.of.growing).min_cosine)
        votes.append(strips.votes(between[some], job.n_threads))
    return {"votes": np.concatenate(votes)}


def _by_tile(job, names):
    """Each tile that has some of the names, and which these are."""
    tile_of = np.searchsorted(job.of.whole().starts, names, side="right") - 1
    for tile in np.unique(tile_of):
        yield tile, np.flatnonzero(tile_of == tile)


def _patches(columns, tiles, memory):
    """Where patches begin, and `keys` of neighbors; raises if these take too much."""
    roots, borders = (columns.gather(tiles, name) for name in ("roots", "borders"))
    borders = once([borders])
    check_cells_of_regions(len(roots), len(borders) // 2, memory)
    return roots, borders


def _sums(rows):
    """The `Sums` that lie in rows of numbers."""
    parts = rows[:, 0], rows[:, 1], rows[:, 2:5], rows[:, 5:]
    return Sums(*(np.ascontiguousarray(part) for part in parts))
