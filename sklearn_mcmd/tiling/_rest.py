"""The points that no surface explains, cell by cell: what is usual around them, groups, scores."""

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from sklearn_mcmd.outliers._cloud import joined_scores
from sklearn_mcmd.outliers._company import (
    HALF,
    LINKED,
    are_pieces,
    isolation_of,
    lengths_of_pieces,
    mean_distance_to_rest,
    separation_of_groups,
    steps_between,
    usual_of,
)
from sklearn_mcmd.planes._around import ratio
from sklearn_mcmd.planes._linking import connected
from sklearn_mcmd.planes._nearest import NearestPoints
from sklearn_mcmd.tiling._joining import parts_of_cell
from sklearn_mcmd.tiling._search import Found, visit_nearest, within_reach
from sklearn_mcmd.tiling._surfaces import COMPANY, LIMITS, all_places

__all__ = ["find_groups", "find_isolation", "find_pieces", "find_scores", "find_things"]

WIDTH = max(LINKED, COMPANY.n_near) + 1  # neighbors among the rest, itself the first
WIDER = 1.0 + 1e-9  # the quotient of two lengths may be rounded down


def find_isolation(cell, job):
    """Write what is usual around each of the rest, and how far it is from the others.

    Columns: usual, of all places, NaN of those that are explained; rest_reach, within which all
    neighbors among the rest lie; isolation, of the rest only.
    """
    cells, columns = job.open()
    points, rest = columns.read(cell, "points"), ~columns.read(cell, "explained")
    queries, usual = points[rest], np.full(len(points), np.nan)
    n_reference, load, share = job.n_explained, _some(columns, _is_explained), COMPANY.usual
    if not n_reference:
        n_reference, load, share = job.n_places, all_places(columns), HALF
    usual_there = np.empty(len(queries))

    def measure(rows, _, near, found):
        values = found.values(columns, "other_spacing")
        usual_there[rows] = usual_of(values[near], share)

    n_far = visit_nearest(cells, load, cell, queries, min(COMPANY.n_usual, n_reference), measure)
    usual[rest] = usual_there
    among_rest, reach = np.empty(len(queries)), np.empty(len(queries))
    least, most = cells.extent(slice(None))
    box = least.min(axis=0), most.max(axis=0)

    def measure_rest(rows, distances, near, found):
        counts = np.append(found.values(columns, "counts"), COMPANY.n_near)[near]
        counts[:, 0] -= 1  # itself
        among_rest[rows] = mean_distance_to_rest(
            queries[rows], distances, counts, box, COMPANY.n_near
        )
        reach[rows] = distances[:, -1]

    n_far += visit_nearest(cells, _some(columns, _is_rest), cell, queries, WIDTH, measure_rest)
    isolation = isolation_of(
        among_rest, columns.read(cell, "spacing")[rest], usual_there, COMPANY.rest_weight
    )
    columns.write(cell, usual=usual, rest_reach=reach, isolation=isolation)
    columns.finish(cell, "isolation", n_far=n_far)


def find_groups(cell, job):
    """Write the groups of the rest of a cell.

    Columns: group_labels, group_sizes and group_links, which are `Parts`.
    """
    cells, columns = job.open()
    points, counts = columns.read(cell, "points"), columns.read(cell, "counts")
    usual = columns.read(cell, "usual")
    rest = np.flatnonzero(~np.isnan(usual))
    queries, usual = points[rest], usual[rest]
    reach = np.minimum(columns.read(cell, "rest_reach"), WIDER * COMPANY.reach * usual)
    found = within_reach(cells, _some(columns, _is_rest), queries, reach, skip=cell)
    n, linked = len(rest), np.empty((len(rest), WIDTH - 1), np.int32)
    own = np.arange(n, dtype=np.int32)
    usual_there = np.append(found.after([usual], columns, "usual"), np.inf)

    def link(rows, distances, near):
        steps = steps_between(usual[rows], usual_there[near[:, 1:]], distances[:, 1:])
        linked[rows] = np.where(steps <= COMPANY.reach, near[:, 1:], own[rows][:, None])

    NearestPoints(np.vstack([queries, found.points])).visit(queries, WIDTH, link)
    rows, places = np.nonzero(linked >= n)
    others = linked[rows, places] - n
    linked = np.where(linked >= n, own[:, None], linked)
    labels = np.full(len(points), -1, np.int32)
    labels[rest] = connected(linked)[0]
    there, rows_there = found.places
    parts = parts_of_cell(labels, counts, rest[rows], there[others], rows_there[others])
    columns.write(cell, **{f"group_{name}": values for name, values in parts._asdict().items()})
    columns.finish(cell, "groups")


def find_pieces(cell, job):
    """Write how long the group of each place is, if it may be a piece of a thing, else 0.

    Column: piece_length, of all places.
    """
    _, columns = job.open()
    labels = columns.read(cell, "group_labels")
    rows, points, groups, _ = _small_groups(cell, job, columns, "group")
    length = np.zeros(len(labels))
    if len(rows):
        length[rows] = lengths_of_pieces(points, groups, COMPANY)[groups[: len(rows)]]
    columns.write(cell, piece_length=length)
    columns.finish(cell, "pieces")


def find_things(cell, job):
    """Write the groups of the rest of a cell, where pieces of one thing are one group.

    Columns: thing_labels, thing_sizes and thing_links, which are `Parts`.
    """
    cells, columns = job.open()
    points, counts = columns.read(cell, "points"), columns.read(cell, "counts")
    labels, length = columns.read(cell, "group_labels"), columns.read(cell, "piece_length")
    rows = np.flatnonzero(length)
    here, there = [np.empty((2, 0), np.intp)], [np.empty((3, 0), np.intp)]

    def link(some, distances, near, found):
        own = rows[some]
        length_there = np.append(found.values(columns, "piece_length"), 0.0)[near]
        i, j = np.nonzero(are_pieces(length[own], length_there, distances, COMPANY.bridge))
        cells_there, rows_there = (part[near[i, j]] for part in found.places)
        own, outside = own[i], cells_there != cell
        pair = np.stack([labels[own[~outside]], labels[rows_there[~outside]]])
        here.append(np.unique(pair, axis=1))
        leaving = np.stack([own, cells_there, rows_there])[:, outside]
        there.append(leaving)

    visit_nearest(
        cells, _some(columns, _is_rest), cell, points[rows], int(np.ceil(job.least[1])), link
    )
    one, other = np.hstack(here)
    shape = (len(columns.read(cell, "group_sizes")),) * 2
    graph = coo_array((np.ones(len(one), np.int8), (one, other)), shape=shape)
    whole = connected_components(graph, directed=False)[1]
    # Parts of one group in several cells are linked by a row of each.
    numbers, first = np.unique(labels, return_index=True)
    row_of = first[numbers >= 0]
    links = columns.read(cell, "group_links")
    leaving = np.hstack([[row_of[links[:, 0]], links[:, 1], links[:, 2]], *there])
    labels = np.append(whole, -1)[labels]
    parts = parts_of_cell(labels, counts, *leaving)
    columns.write(cell, **{f"thing_{name}": values for name, values in parts._asdict().items()})
    columns.finish(cell, "things")


def find_scores(cell, job, target):
    """Write the scores of all points of a cell, in the order of the inputs.

    Parameters
    ----------
    cell : int
    job : Job
    target : callable
        Takes the cell, the rows of the inputs, and their scores.
    """
    cells, columns = job.open()
    scores = columns.read(cell, "distances" if job.paper else "off")
    if not job.paper:
        rest = np.flatnonzero(~columns.read(cell, "explained"))
        scores[rest] = _scores_of_rest(cell, job, cells, columns, rest, scores[rest])
    place_of, rows = columns.read(cell, "place_of"), cells.read(cell)["row"]
    target(cell, rows, scores[place_of] if len(place_of) else scores)


def _scores_of_rest(cell, job, cells, columns, rest, distances):
    points = columns.read(cell, "points")[rest]
    separation, beside = np.zeros(len(rest)), None
    if job.detector.strictness != "isolated":
        separation = _separation(cell, job, cells, columns)[rest]
    if job.detector.strictness == "surfaces" and job.n_explained:

        def beside(rows):
            values = np.empty(len(rows))

            def measure(some, gaps, near, found):
                scales = found.values(columns, "owner_scale")
                values[some] = ratio(gaps[:, 0], scales[near[:, 0]])

            load = _some(columns, _is_explained)
            visit_nearest(cells, load, cell, points[rows], 1, measure)
            return values

    return joined_scores(
        distances, columns.read(cell, "isolation"), separation, job.detector.strictness,
        LIMITS.explained, beside,
    )  # fmt: skip


def _separation(cell, job, cells, columns):
    """Gap of each place's group over the size of the group; 0 if that is large."""
    rows, points, groups, found = _small_groups(cell, job, columns, "thing")
    separation = np.zeros(len(columns.read(cell, "thing_labels")))
    if not len(rows):
        return separation
    usual = found.after([columns.read(cell, "usual")[rows]], columns, "usual")
    gaps = np.full(len(points), np.inf)

    def measure(rows, distances, *_):
        gaps[rows] = distances[:, 0]

    def is_real(columns, other):
        large = ~_is_small(columns, other, job, "thing")
        labels = columns.read(other, "thing_labels")
        return (labels < 0) | np.append(large, False)[labels]

    visit_nearest(cells, _some(columns, is_real), cell, points, 1, measure)
    separation[rows] = separation_of_groups(points, groups, usual, gaps)[groups[: len(rows)]]
    return separation


def _small_groups(cell, job, columns, name):
    """Small groups of the rest that have places in a cell.

    Parameters
    ----------
    cell : int
    job : Job
    columns : Columns
    name : {"group", "thing"}
        Of the columns of `Parts`.

    Returns
    -------
    rows : ndarray of int of shape (m,)
        The places in the cell.
    points : ndarray of shape (n, 3)
        Of these, then of the same groups in other cells.
    groups : ndarray of int of shape (n,)
        Group of each of the points, from 0 on.
    found : Found
        Those in other cells.
    """
    labels = columns.read(cell, f"{name}_labels")
    small = _is_small(columns, cell, job, name)
    rows = np.flatnonzero(np.append(small, False)[labels])
    others = columns.read(cell, f"{name}_others")
    others = others[small[others[:, 0]]]
    # Parts of one group have one number, those of this cell too.
    number = np.arange(len(small))
    number[others[:, 0]] = len(small) + others[:, 3]
    parts, groups = [], [number[labels[rows]]]
    for other in np.setdiff1d(others[:, 1], [cell]):
        some = others[others[:, 1] == other]
        number_there = dict(zip(some[:, 2], len(small) + some[:, 3], strict=True))
        labels_there = columns.read(other, f"{name}_labels")
        rows_there = np.flatnonzero(np.isin(labels_there, some[:, 2]))
        parts.append((other, columns.read(other, "points")[rows_there], rows_there))
        groups.append([number_there[label] for label in labels_there[rows_there]])
    found = Found(parts)
    points = np.vstack([columns.read(cell, "points")[rows], found.points])
    _, groups = np.unique(np.concatenate(groups).astype(np.int64), return_inverse=True)
    return rows, points, groups, found


def _is_small(columns, cell, job, name):
    """Which groups of a cell are too small for a thing."""
    sizes = columns.read(cell, f"{name}_whole")
    small = sizes < job.least[1]
    return small if job.n_explained else small & (sizes < job.largest)


def _some(columns, is_meant):
    """What loads the places of a cell that are meant, and their rows."""

    def load(cell):
        rows = np.flatnonzero(is_meant(columns, cell))
        return columns.read(cell, "points")[rows], rows

    return load


def _is_explained(columns, cell):
    return columns.read(cell, "explained")


def _is_rest(columns, cell):
    return ~columns.read(cell, "explained")
