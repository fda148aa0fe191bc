"""Scores of points in cells: surfaces and groups are joined across cells, all else is local.

Each sweep fills columns, of places or of those off the surfaces, which are places of their own.
"""

import shutil
from dataclasses import replace
from functools import partial

import numpy as np

from sklearn_mcmd._validation import is_auto
from sklearn_mcmd.outliers._model import isolated, telling_of, warn_of_doubt
from sklearn_mcmd.outliers._off_surface import Rest, least_thing
from sklearn_mcmd.outliers._ray_evidence import FOUND
from sklearn_mcmd.outliers._small_groups import Groups, SmallGroups
from sklearn_mcmd.outliers._surfaces import least_surface, surface_links
from sklearn_mcmd.planes._explaining import ExplainLimits, connected_planes, parts_within
from sklearn_mcmd.runtime._progress import listen_to_progress
from sklearn_mcmd.sensors._rays import Emptiness, RayLimits
from sklearn_mcmd.tiling._joined_parts import JoinedParts, write_parts
from sklearn_mcmd.tiling._memory import check_small_groups
from sklearn_mcmd.tiling._stored_columns import ALL, CellColumns, StoredColumns
from sklearn_mcmd.tiling._stored_index import StoredIndex, StoredNearest
from sklearn_mcmd.tiling._stored_neighbors import StoredNeighbors
from sklearn_mcmd.tiling._tiled_rays import PLANE_STEPS, RAYS, ask_planes, beam_job, stored_evidence

STEPS = "surfaces", "explained", "usual", "groups", "scores"
HEARD = f"rays{len(PLANE_STEPS)}"
N_SUMS = len(Emptiness._fields)
RAY_STEPS = *PLANE_STEPS, "surfaces", "surfaces0", *STEPS[1:-1], HEARD, "scores"
# Names of parts, and the columns of places that may be of them, and that are of large ones.
SURFACES = (("surface", "usable", "explaining"),)
WITH_SHEETS = ("surface", "free", "explaining"), ("sheet", "ends", "on_sheet")
OF_PLANES = (
    *("centroids", "normals", "scale", "radius", "noise", "usable", "farthest", "explaining"),
    *FOUND,
    "on_sheet",
)


def judge_in_cells(sweep, job, memory, n_jobs):
    """Write the scores of all points, once the planes of all places are known.

    ``sweep(name, work)`` visits all cells; one process joins what these find.
    """
    whole, cells = job.whole(), job.cells
    whole.make(surface_root=np.int32, explaining=bool, explained=bool)
    by_rays = job.by_rays
    if by_rays:
        whole.make(sheet_root=np.int32, on_sheet=bool, group=np.int32)
        ask_planes(sweep, job)
        _find_surfaces(sweep, job, "surfaces", WITH_SHEETS, memory)
        job = replace(job, by_rays=_are_used(job))
    if not job.by_rays:
        _find_surfaces(sweep, job, "surfaces0" if by_rays else "surfaces", SURFACES, memory)
    sweep("explained", _explain, job=job)
    whole.remove(*OF_PLANES)
    rest = off_surfaces(job)
    n_explained = sum(
        whole.columns.report(cell, "explained")["n"] for cell in np.flatnonzero(cells.counts)
    )
    job = replace(job, n_explained=n_explained)
    rest.make(points=(float, 3), counts=np.int32, group_root=np.int32)
    rest.make(usual=float, gaps=float, isolation=float, separation=float)
    sweep("usual", _find_usual, job=job)
    sweep("groups", _find_groups, job=job)
    whole.columns.once("small", partial(_judge_small, job, rest, memory, n_jobs))
    if job.by_rays:
        _ask_places(sweep, job, rest)
    sweep("scores", _find_scores, job=job)
    if by_rays:
        shutil.rmtree(beam_job(job).found)  # of which nobody asks any more


def off_surfaces(job):
    """The `StoredColumns` of the places off the surfaces, once these are found."""
    return StoredColumns(CellColumns(job.found / "rest"), len(job.cells))


def _of_rest(cell, job, name):
    """What a column has of the places of a cell that are off the surfaces."""
    whole = job.whole()
    return whole.rows_of(name, _rows_of_rest(cell, whole))


def _rows_of_rest(cell, whole):
    """The places of a cell that are off the surfaces."""
    own = whole.rows(cell)
    return own.start + np.flatnonzero(~whole.rows_of("explained", own))


class ExplainedNearest(StoredNearest):
    """The places that surfaces explain, `n` of all, which are known by their rows among all."""

    def __init__(self, whole, cells, n):
        super().__init__(whole, cells)
        self.n = n

    def _load(self, cell):
        points, numbers = super()._load(cell)
        explained = self._whole.rows_of("explained", self._whole.rows(cell))
        return points[explained], numbers[explained]


def _rest_of(job, column=StoredColumns.open):
    """The `Rest` of a cloud in cells, whose values are opened by `column`."""
    whole, rest, cells = job.whole(), off_surfaces(job), job.cells
    low, high = cells.extent(slice(None))
    reference = StoredNearest(whole, cells)
    if job.n_explained:
        reference = ExplainedNearest(whole, cells, job.n_explained)
    return Rest(
        box=(low.min(axis=0), high.max(axis=0)),
        reference=reference,
        reference_spacing=column(whole, "other_spacing"),
        has_surface=job.n_explained > 0,
        others=StoredNearest(rest, cells),
        rows=None,
        points=column(rest, "points"),
        counts=column(rest, "counts"),
        among_all=None,
    )


def _find_surfaces(sweep, job, step, kinds, memory):
    """Fill which places are on surfaces, of some kinds as `SURFACES` has them."""
    sweep(step, partial(_link_surfaces, kinds=kinds))
    job.columns.once(step, partial(_join_surfaces, job, kinds, memory))


def _join_surfaces(job, kinds, memory):
    whole = job.whole()
    least = least_surface(StoredNeighbors(whole).k, len(whole))
    for name, _, column in kinds:
        joined = JoinedParts(whole, job.cells, name, memory)
        enough = least * RayLimits().sheet if name == "sheet" else least
        large = np.append(joined.total("sizes") >= enough, False)
        for cell, labels in joined.each_cell():
            whole.put(cell, **{column: large[labels]})


def _link_surfaces(cell, job, kinds):
    """Link the places of a cell whose planes explain each other."""
    whole = job.whole()
    index, own, farthest = StoredIndex(whole), whole.rows(cell), whole.open("farthest")
    links = surface_links(index, whole.planes())
    for name, usable, _ in kinds:
        labels, pairs = connected_planes(index, *links, whole.open(usable), farthest, own)
        sizes = np.bincount(labels)
        write_parts(whole, cell, name, labels, pairs, known=sizes > 1, sizes=sizes)


def _are_used(job):
    """Whether rays tell: where the position of the sensor is doubted, only if it was given."""

    def ask():
        whole = job.whole()
        doubt = stored_evidence(job).doubt(whole.open("explaining"), whole.open("counts"))
        return {"used": not (doubt and is_auto(job.estimator.sensor_origin)), "doubt": doubt}

    report = job.columns.once(RAYS, ask)
    warn_of_doubt(report["doubt"], report["used"])
    return report["used"]


def _explain(cell, job):
    """Find which places of a cell are on no surface, and the distances from the nearest."""
    whole = job.whole()
    index, own = StoredIndex(whole), whole.rows(cell)
    judged, distances = job.judged(index, job.n_threads), whole.rows_of("distances", own)
    judged.planes, judged.explaining = job.planes(), whole.open("explaining")
    owners = judged.explain_others(own, distances)
    explained = distances <= ExplainLimits().explained
    n_explained = int(np.count_nonzero(explained))
    answer = {"distances": distances, "explained": explained, "n": n_explained}
    if judged.level.off_surfaces:
        answer["owner_scale"] = judged.planes.scale[owners]
    if job.by_rays:
        off = own.start + np.flatnonzero(~explained)
        asked = index.points[off], lambda some: index.query_own(off[some]), judged.to_planes
        answer["by_sheet"] = stored_evidence(job).on_sheets(*asked)
    rest = CellColumns(job.found / "rest")
    rest.folder.mkdir(exist_ok=True)
    rest.finish(cell, "places", n_places=len(explained) - n_explained)
    return answer


def _find_usual(cell, job):
    """Fill the usual spacing around the places of a cell that are off the surfaces."""
    rest = off_surfaces(job)
    points, counts = (_of_rest(cell, job, name) for name in ("points", "counts"))
    usual, gaps = _rest_of(job).usual_around(points, job.n_threads)
    rest.put(cell, points=points, counts=counts, usual=usual, gaps=gaps)


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


def _judge_small(job, rest, memory, n_jobs):
    """Write how isolated points of small groups are, and how far the groups stand off; returns how
    far intensity tells."""
    cells = job.cells
    joined = JoinedParts(rest, cells, "group", memory)
    groups = Groups(joined.one(), *(joined.total(name) for name in Groups._fields[1:]))
    least = least_thing(StoredNeighbors(job.whole()).k, int(cells.counts.sum()))
    check_small_groups(int(groups.sizes[groups.counts < least].sum()), memory)
    known = _rest_of(job, StoredColumns.column), rest.column("usual"), rest.column("gaps")
    small = SmallGroups(*known, groups, joined.rows, least, n_jobs)
    with listen_to_progress(None):
        small.judge()
    rows, isolation, separation, groups = small.verdict(rest.column("isolation"))
    whole, ends = job.whole(), np.searchsorted(rows, rest.starts)
    for cell in range(len(cells)):
        some, own = slice(ends[cell], ends[cell + 1]), rest.rows(cell)
        at, found = rows[some] - own.start, np.zeros((2, own.stop - own.start))
        found[0] = rest.rows_of("isolation", own)
        found[:, at] = isolation[some], separation[some]
        rest.put(cell, isolation=found[0], separation=found[1])
        if job.by_rays:
            group = whole.rows_of("group", whole.rows(cell))
            stand_off = np.where(separation[some] > 0, groups[some] + 1, 0)
            group[_rows_of_rest(cell, whole)[at] - whole.rows(cell).start] = stand_off
            whole.put(cell, group=group)
    light = list(_isolated_light(job, rest)) if whole.has("light") else []
    return {"telling": telling_of(light)}


def _isolated_light(job, rest):
    """The ranks of intensity of isolated places, cell by cell."""
    for cell in np.flatnonzero(job.cells.counts):
        yield isolated(_of_rest(cell, job, "light"), rest.rows_of("isolation", rest.rows(cell)))


def _ask_places(sweep, job, rest):
    """Find what rays say of the places off the surfaces, and of the groups that stand off."""
    columns, cells = job.columns, np.flatnonzero(job.cells.counts)
    rest.make(apart=float, heard=(float, N_SUMS))
    sweep(HEARD, _hear, job=job)

    def put_together():
        around = columns.gather(cells, "around")
        groups, points = around[:, N_SUMS].astype(np.intp), around[:, N_SUMS + 1 :]
        together = Emptiness(*around.T[:N_SUMS]).pooled(groups, points).together()
        columns.share(cells, "around", together=together)

    columns.once("together", put_together)


def _hear(cell, job):
    """Fill what the beams next to the places of a cell that are off the surfaces say; and find
    what those around the groups that stand off say, with the groups and points of these."""
    whole, rest, group = job.whole(), off_surfaces(job), job.whole().open("group")
    rows, isolation = _rows_of_rest(cell, whole), rest.rows_of("isolation", rest.rows(cell))
    known = isolation, whole.rows_of("spacing", rows), group, whole.open("explained")
    empty, apart, around = stored_evidence(job).hear(rows, *known)
    rest.put(cell, apart=apart, heard=np.stack(empty, axis=1))
    rows = rows[group[rows] > 0]
    return {"around": np.column_stack([*around, group[rows], whole.rows_of("points", rows)])}


def _find_scores(cell, job):
    """Find the scores of the points of a cell."""
    whole, rest, columns = job.whole(), off_surfaces(job), job.columns
    distances, rows = whole.rows_of("distances", whole.rows(cell)), _rows_of_rest(cell, whole)
    off, own = rows - whole.rows(cell).start, rest.rows(cell)
    names = "points", "counts", "isolation", "separation"
    points, counts, isolation, separation = (rest.rows_of(name, own) for name in names)
    known = {"intensity": _of_rest(cell, job, "light")} if whole.has("light") else {}
    judged, found = job.judged(StoredIndex(whole), job.n_threads, **known), {}
    judged.telling = columns.report(ALL, "small")["telling"]
    if job.n_explained and judged.level.off_surfaces:
        judged.reference = ExplainedNearest(whole, job.cells, job.n_explained)
        judged.explained_scale = whole.open("owner_scale")
    doubt = judged.darkness(slice(None))
    apart = isolation * doubt, separation
    if job.by_rays:
        heard = Emptiness(*rest.open("heard").T), rest.open("apart")
        heard = *heard, columns.read(cell, "together")
        given = rows, points, StoredNearest(rest, job.cells), (isolation, separation), heard, own
        by_beams, separation = stored_evidence(job).verdict(*given)
        by_sheet = columns.read(cell, "by_sheet")
        by_rays = np.maximum(doubt * by_beams, by_sheet), separation
        given = distances[off], apart, by_rays, by_sheet > 0, points, counts
        distances[off], found["raised"] = judged.by_rays(*given)
    else:
        distances[off] = judged.joined(distances[off], *apart, points)
    return {**found, "results": distances[columns.read(cell, "place_of"), None]}
