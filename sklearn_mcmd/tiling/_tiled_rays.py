"""Rays to points in cells: their beams, each direction once, are a second cloud in cells."""

import shutil
from bisect import bisect_left
from dataclasses import replace
from functools import partial

import numpy as np

from sklearn_mcmd._errors import ParameterError
from sklearn_mcmd._validation import check_sensor_origin, is_auto
from sklearn_mcmd.outliers._ray_evidence import ASKS, FOUND, RayEvidence
from sklearn_mcmd.planes._around import at_ranks
from sklearn_mcmd.runtime._chunks import each_slice, slices
from sklearn_mcmd.sensors._rays import (
    RayLimits,
    Rays,
    beams_of,
    mean_angles,
    one_far_position,
    polar,
)
from sklearn_mcmd.tiling._cells import CellWriter
from sklearn_mcmd.tiling._memory import PART
from sklearn_mcmd.tiling._sensor_origins import stored_origins
from sklearn_mcmd.tiling._stored_columns import ALL
from sklearn_mcmd.tiling._stored_index import (
    CHUNK,
    StoredCloud,
    StoredIndex,
    find_neighbors,
    find_places,
    join_points,
)
from sklearn_mcmd.tiling._stored_neighbors import StoredNeighbors

RAYS = "by_rays"  # the name of what rays say of a cloud
PLANE_STEPS = tuple(f"rays{n}" for n in range(2 + len(ASKS)))
PLACES, BEAMS, *LATER = PLANE_STEPS


def ask_planes(sweep, job):
    """Fill what is `FOUND` of all places, and ranges and beam_of."""
    job.whole().make(ranges=float, beam_of=np.int32, **FOUND)
    beams = beam_job(job)
    job.columns.once(PLACES, partial(_put_beams_in_cells, job, beams))
    sweep_beams = partial(sweep, cells=beams.cells, job=beams)
    sweep_beams(PLACES, _find_places)
    whole, k = beams.whole(), RayLimits().n_beams
    if len(whole) <= beams.cells.low.shape[1]:
        raise ParameterError(
            f"all points lie in {len(whole)} directions from $sensor_origin, which are too few"
        )
    join_points(sweep_beams, beams)
    whole.make(met=np.int32, angles=float)
    StoredNeighbors(whole).begin(min(k + 1, len(whole)))
    sweep_beams(BEAMS, _find_beams, ranges=job.whole().column("ranges"))
    job.columns.once(BEAMS, lambda: {"usual": _median(partial(_angles, beams))})
    for step, ask in zip(LATER, ASKS, strict=True):
        sweep(step, partial(_ask, is_first=step == LATER[0], ask=ask))
    job.whole().remove("left", "alone", "going_on", "grazed", "faces")


def stored_evidence(job):
    """The `RayEvidence` of all places, as far as it is known."""
    whole, beams = job.whole(), beam_job(job)
    known, stored = job.columns.report(ALL, PLACES), beams.whole()
    cloud = StoredCloud(stored, beams.cells, 1)
    rays = Rays(
        points=whole.open("points"),
        ranges=whole.open("ranges"),
        cloud=cloud,
        met=stored.open("met"),
        near=cloud.near,
        angles=stored.open("angles"),
        usual_angle=job.columns.report(ALL, BEAMS)["usual"],
        limits=RayLimits(),
        n_jobs=job.n_threads,
        beam_of=whole.open("beam_of"),
    )
    found = {name: whole.open(name) for name in ("scatter", "on_sheet") if whole.has(name)}
    return RayEvidence(rays, known["approximate"], job.n_threads, **found)


def origins_of(points, detector, stored=None, rows=None):
    """Where the sensor was for each of some points: `stored` of these rows, or one position."""
    if stored is None:
        is_known = not is_auto(detector.sensor_origin)
        return check_sensor_origin(detector.sensor_origin if is_known else "origin", points)
    return check_sensor_origin(stored[rows], points)


def _median(parts):
    """What `numpy.median` returns of all values of the arrays of ``parts()``."""
    n = sum(map(len, parts()))
    return float(np.mean(at_ranks(parts, [(n - 1) // 2, n // 2])))


def beam_job(job):
    """The job on the beams."""
    folder = job.points.with_name("rays")
    return replace(job, points=folder, found=folder)


def _origins(cell, job):
    """Where the sensor was for each place of a cell, by the first point there."""
    stored, rows, own = stored_origins(job.points), job.cells.rows(cell), job.whole().rows(cell)
    first = np.empty(own.stop - own.start, rows.dtype)
    first[job.columns.read(cell, "place_of")[::-1]] = rows[::-1]
    return origins_of(np.full((len(first), 3), np.nan), job.estimator, stored, first)


def _put_beams_in_cells(job, beams):
    """Fill ranges, and put the directions into cells of their own, with rows of these places."""
    whole, cells, one, same = job.whole(), job.cells, None, True
    known = np.flatnonzero(cells.counts)

    def each_part():
        for cell in known:
            own, all_origins = whole.rows(cell), _origins(cell, job)
            for rows in slices(own.stop, PART, own.start):
                origins = all_origins[rows.start - own.start : rows.stop - own.start]
                yield rows, origins, *polar(whole.rows_of("points", rows), origins)

    def ranges():
        for cell in known:
            found = whole.rows_of("ranges", whole.rows(cell))
            yield found[found > 0]

    for rows, origins, found, _ in each_part():
        whole.write("ranges", rows.start, found)
        one = origins[0] if one is None else one
        same &= bool((origins == one).all())
    if not any(map(len, ranges())):  # which is an error
        check_sensor_origin(*np.zeros((2, 1, 3)))
    low, high = cells.extent(slice(None))
    ends = np.array([low.min(axis=0), high.max(axis=0)])
    approximate = same and one_far_position(ends, np.array([one, one]))
    unit = None if same else _median(ranges)
    shutil.rmtree(beams.points, ignore_errors=True)
    beams.points.mkdir()
    writer = CellWriter(beams.points, cells.counts.max(), 3 if same else 6, np.int32)
    for rows, origins, _, directions in each_part():
        writer.add(beams_of(directions, origins, unit), np.arange(rows.start, rows.stop))
    writer.close()
    return {"approximate": approximate}


def _find_places(cell, job):
    """Find places, and free the disk of the directions, which these have."""
    if not job.columns.is_done(cell, "places"):
        job.columns.keep(cell, "places", find_places(cell, job))
    job.cells.free(cell)


def _find_beams(cell, job, ranges):
    """Find what is next to the beams of a cell, and fill the place of the cloud that each met."""
    find_neighbors(cell, job)
    whole, rows = job.whole(), job.cells.rows(cell)
    own, place_of = whole.rows(cell), job.columns.read(cell, "place_of")
    order = np.lexsort((-ranges[rows], place_of))
    first = order[np.searchsorted(place_of[order], np.arange(own.stop - own.start))]
    whole.put(cell, met=rows[first])
    points, near = whole.open("points"), StoredNeighbors(whole)
    for some in slices(own.stop, CHUNK, own.start):
        whole.write("angles", some.start, mean_angles(points, some, near[some]))


def _angles(beams):
    """The angles of the beams to all places that are seen, cell by cell."""
    whole = beams.whole()
    for cell in np.flatnonzero(beams.cells.counts):
        own, place_of = whole.rows(cell), beams.columns.read(cell, "place_of")
        seen = whole.rows_of("points", own)[:, :3].any(axis=1)
        yield whole.rows_of("angles", own)[place_of[seen[place_of]]]


def _find_own_beams(cell, job):
    """Fill the beam of each place of a cell."""
    beams, own = beam_job(job), job.whole().rows(cell)
    beam_of, starts = np.empty(own.stop - own.start, np.int32), beams.whole().starts
    for other in np.flatnonzero(beams.cells.counts):
        rows = beams.cells.rows(other)  # ascending
        some = slice(bisect_left(rows, own.start), bisect_left(rows, own.stop))
        places = beams.columns.mapped(other, "place_of")[some]
        beam_of[rows[some].astype(np.int64) - own.start] = starts[other] + places
    job.whole().put(cell, beam_of=beam_of)


def _ask(cell, job, is_first, ask):
    """Fill what one of `ASKS` finds of the places of a cell."""
    if is_first:
        _find_own_beams(cell, job)
    whole, evidence, planes = job.whole(), stored_evidence(job), job.planes()
    own, index = whole.rows(cell), StoredIndex(whole)
    known = {name: whole.open(name) for name in (*FOUND, "usable")}

    def task(part):
        rows = slice(own.start + part.start, own.start + part.stop)
        for name, values in ask(evidence, rows, index, planes, known).items():
            whole.write(name, rows.start, values)

    each_slice(own.stop - own.start, CHUNK, task, job.n_threads)
