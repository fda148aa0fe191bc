"""Scores of points in cells: surfaces and groups are joined across cells, all else is local.

Each sweep fills columns, of places or of those off the surfaces, which are places of their own.
"""

from dataclasses import replace

import numpy as np

from sklearn_mcmd._errors import ParameterError
from sklearn_mcmd.outliers._model import isolated, telling_of
from sklearn_mcmd.outliers._off_surface import OffSurfaceLimits, Rest
from sklearn_mcmd.outliers._small_groups import Groups, SmallGroups
from sklearn_mcmd.outliers._surfaces import SurfaceLimits, surface_links
from sklearn_mcmd.planes._explaining import ExplainLimits, connected_planes, parts_within
from sklearn_mcmd.runtime._progress import listen_to_progress
from sklearn_mcmd.tiling._joined_parts import JoinedParts, write_parts
from sklearn_mcmd.tiling._memory import bytes_of_small
from sklearn_mcmd.tiling._result_files import write_results
from sklearn_mcmd.tiling._stored_columns import ALL, CellColumns, StoredColumns
from sklearn_mcmd.tiling._stored_index import StoredIndex, StoredNearest
from sklearn_mcmd.tiling._stored_neighbors import StoredNeighbors

STEPS = "surfaces", "explained", "usual", "groups", "scores"
OF_PLANES = "centroids", "normals", "scale", "radius", "noise", "usable", "farthest", "explaining"
NUMBER, ROW, ANSWER = (np.float64, ()), (np.int32, ()), (bool, ())


def judge_in_cells(sweep, job, memory, n_jobs):
    """Write the scores of all points, once the planes of all places are known.

    ``sweep(name, work)`` visits all cells; one process joins what these find.
    """
    whole, cells = job.whole(), job.cells
    whole.make(surface_root=ROW, explaining=ANSWER)
    sweep("surfaces", _find_surfaces)
    if not whole.columns.is_done(ALL, "surfaces"):
        _join_surfaces(whole, cells, memory)
        whole.columns.finish(ALL, "surfaces")
    sweep("explained", _explain)
    whole.remove(*OF_PLANES)
    rest = off_surfaces(job)
    n_explained = sum(
        whole.columns.report(cell, "explained")["n"] for cell in np.flatnonzero(cells.counts)
    )
    job = replace(job, n_explained=n_explained)
    rest.make(points=(np.float64, (3,)), counts=ROW, group_root=ROW)
    rest.make(usual=NUMBER, gaps=NUMBER, isolation=NUMBER)
    sweep("usual", _find_usual, job=job)
    sweep("groups", _find_groups, job=job)
    if not rest.columns.is_done(ALL, "small"):
        with listen_to_progress(None):
            _judge_small(job, rest, memory, n_jobs)
            telling = telling_of(_isolated_light(job, rest)) if whole.has("light") else 0.0
        whole.columns.finish(ALL, "light", telling=telling)
        rest.columns.finish(ALL, "small")
    sweep("scores", _find_scores, job=job)


def off_surfaces(job):
    """The `StoredColumns` of the places off the surfaces, once these are found."""
    return StoredColumns(CellColumns(job.found / "rest"), len(job.cells))


def _of_rest(cell, job, name):
    """What a column has of the places of a cell that are off the surfaces."""
    whole = job.whole()
    return whole.rows_of(name, whole.rows(cell))[~whole.columns.read(cell, "explained")]


class ExplainedNearest(StoredNearest):
    """The places that surfaces explain, `n` of all, which are known by their rows among all."""

    def __init__(self, whole, cells, n):
        super().__init__(whole, cells)
        self.n = n

    def _load(self, cell):
        points, numbers = super()._load(cell)
        explained = self._whole.columns.read(cell, "explained")
        return points[explained], numbers[explained]


def _rest_of(job, column=StoredColumns.open):
    """The `Rest` of a cloud in cells, whose values are opened by `column`."""
    whole, rest, cells, limits = job.whole(), off_surfaces(job), job.cells, OffSurfaceLimits()
    low, high = cells.extent(slice(None))
    reference = StoredNearest(whole, cells)
    if job.n_explained:
        reference = ExplainedNearest(whole, cells, job.n_explained)
    return Rest(
        empty=np.empty,
        limits=limits,
        box=(low.min(axis=0), high.max(axis=0)),
        reference=reference,
        reference_spacing=column(whole, "other_spacing"),
        quantile=limits.usual if job.n_explained else limits.half,
        has_surface=job.n_explained > 0,
        others=StoredNearest(rest, cells),
        rows=None,
        points=column(rest, "points"),
        counts=column(rest, "counts"),
        among_all=None,
    )


def _find_surfaces(cell, job):
    """Link the places of a cell whose planes explain each other."""
    whole, limits = job.whole(), SurfaceLimits()
    index, own, usable = StoredIndex(whole), whole.rows(cell), whole.open("usable")
    links = surface_links(index, whole.planes(), limits)
    labels, pairs = connected_planes(index, *links, usable, whole.open("farthest"), own)
    sizes = np.bincount(labels)
    write_parts(whole, cell, "surface", labels, pairs, known=sizes > 1, sizes=sizes)
    whole.columns.finish(cell, "surfaces")


def _join_surfaces(whole, cells, memory):
    """Fill which places are on a surface, whose planes then explain others."""
    limits = SurfaceLimits()
    least = min(StoredNeighbors(whole).k, limits.least_share * len(whole))
    joined = JoinedParts(whole, cells, "surface", memory)
    large = np.append(joined.total("sizes") >= least, False)
    for cell, labels in joined.each_cell():
        whole.put(cell, explaining=large[labels])


def _explain(cell, job):
    """Find which places of a cell are on no surface, and fill the distances from the nearest."""
    whole, columns = job.whole(), job.columns
    index, own, explaining = StoredIndex(whole), whole.rows(cell), whole.open("explaining")
    judged, points = job.judged(index, job.n_threads), whole.rows_of("points", own)
    judged.planes = whole.planes()
    if whole.has("noise"):
        judged.planes = judged.planes._replace(scale=whole.open("noise"))
    distances, rows = whole.rows_of("distances", own), np.flatnonzero(~explaining[own])
    owners = np.arange(own.start, own.stop)
    found, distances[rows] = judged.to_planes(
        points[rows], lambda some: index.query_own(own.start + rows[some]), explaining
    )
    owners[rows] = np.where(found < 0, owners[rows], found)
    explained = distances <= ExplainLimits().explained
    whole.put(cell, distances=distances)
    if judged.level.off_surfaces:
        whole.put(cell, owner_scale=judged.planes.scale[owners])
    columns.write(cell, explained=explained)
    rest = CellColumns(job.found / "rest")
    rest.folder.mkdir(exist_ok=True)
    rest.finish(cell, "places", n_places=int(np.count_nonzero(~explained)))
    columns.finish(cell, "explained", n=int(np.count_nonzero(explained)))


def _find_usual(cell, job):
    """Fill the usual spacing around the places of a cell that are off the surfaces."""
    rest = off_surfaces(job)
    points, counts = (_of_rest(cell, job, name) for name in ("points", "counts"))
    usual, gaps = _rest_of(job).usual_around(points, job.n_threads)
    rest.put(cell, points=points, counts=counts, usual=usual, gaps=gaps)
    job.columns.finish(cell, "usual")


def _find_groups(cell, job):
    """Link the places of a cell that are off the surfaces, and fill how isolated each is."""
    rest, known = off_surfaces(job), _rest_of(job)
    own, usual = rest.rows(cell), rest.open("usual")
    among_rest, linked = known.neighbors(usual, job.n_threads, own)
    among_all = _of_rest(cell, job, "spacing")
    rest.put(cell, isolation=known.isolated(among_rest, among_all, usual[own]))
    labels, pairs = parts_within(linked, own)
    sums = Groups.of(labels, known.counts[own], usual[own])._asdict()
    write_parts(rest, cell, "group", labels, pairs, **{n: sums[n] for n in Groups._fields[1:]})
    job.columns.finish(cell, "groups")


def _judge_small(job, rest, memory, n_jobs):
    """Write how isolated points of small groups are, and how far the groups stand off."""
    cells = job.cells
    joined = JoinedParts(rest, cells, "group", memory)
    groups = Groups(joined.one(), *(joined.total(name) for name in Groups._fields[1:]))
    limits, n_neighbors = OffSurfaceLimits(), StoredNeighbors(job.whole()).k
    share = SurfaceLimits().least_share * int(cells.counts.sum())
    least = min(limits.thing * n_neighbors, share)
    few = groups.counts < least
    n_small = int(groups.sizes[few].sum())
    if (needed := bytes_of_small(n_small)) > memory:
        raise ParameterError(
            f"{n_small:,} points lie in small groups off all surfaces, which take about "
            f"{needed / 1e6:.0f}MB, more than $memory={memory / 1e6:.0f}MB; give more memory"
        )
    rows, of = joined.rows(few)
    large = np.flatnonzero(~few)

    def members(chosen):
        wanted = np.zeros(len(few), bool)
        wanted[large[chosen]] = True
        found, of = joined.rows(wanted)
        return found, np.searchsorted(large, of)

    small = SmallGroups(
        rest=_rest_of(job, StoredColumns.column),
        usual=rest.column("usual"),
        gaps=rest.column("gaps"),
        rows=rows,
        groups=of,
        least=least,
        large=groups.take(large),
        members=members,
        n_jobs=n_jobs,
    )
    small.judge()
    rows, isolation, separation = small.verdict(rest.column("isolation"))
    ends = np.searchsorted(rows, rest.starts)
    for cell in range(len(cells)):
        own = slice(ends[cell], ends[cell + 1])
        found = {"rows": rows[own] - rest.starts[cell], "separation": separation[own]}
        rest.columns.write(cell, small_isolation=isolation[own], **found)


def _isolation(cell, rest):
    """How isolated the places of a cell are that are off the surfaces."""
    isolation = rest.rows_of("isolation", rest.rows(cell))
    isolation[rest.columns.read(cell, "rows")] = rest.columns.read(cell, "small_isolation")
    return isolation


def _isolated_light(job, rest):
    """The ranks of intensity of isolated places, cell by cell."""
    cells = np.flatnonzero(job.cells.counts)
    return [isolated(_of_rest(cell, job, "light"), _isolation(cell, rest)) for cell in cells]


def _find_scores(cell, job):
    """Write the scores of the points of a cell."""
    whole, rest, columns = job.whole(), off_surfaces(job), job.columns
    distances = whole.rows_of("distances", whole.rows(cell))
    off, own = np.flatnonzero(~columns.read(cell, "explained")), rest.rows(cell)
    isolation, separation = _isolation(cell, rest), np.zeros(len(off))
    rows = rest.columns.read(cell, "rows")
    separation[rows] = rest.columns.read(cell, "separation")
    known = {"intensity": _of_rest(cell, job, "light")} if whole.has("light") else {}
    judged = job.judged(StoredIndex(whole), job.n_threads, **known)
    judged.telling = columns.report(ALL, "light")["telling"]
    isolation *= judged.darkness(slice(None))
    if job.n_explained and judged.level.off_surfaces:
        judged.reference = ExplainedNearest(whole, job.cells, job.n_explained)
        judged.explained_scale = whole.open("owner_scale")
    given = distances[off], isolation, separation, rest.rows_of("points", own)
    distances[off] = judged.joined(*given)
    place_of = columns.read(cell, "place_of")
    write_results(columns, cell, distances[place_of])
    columns.finish(cell, "scores")
