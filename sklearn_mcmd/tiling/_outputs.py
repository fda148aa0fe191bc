"""Outputs of a run: where they go, and results of all tiles in the order of the inputs."""

import dataclasses
import os
from pathlib import Path
from typing import NamedTuple

import numpy as np

from sklearn_mcmd.edges._painting import edge_columns
from sklearn_mcmd.io import PointFileError
from sklearn_mcmd.io._classes import LOW_NOISE, Choice, classes_of_noise
from sklearn_mcmd.io._files import one_clear_line, replacing, supported_extensions
from sklearn_mcmd.io._las_joined import joined_cloud, joined_header
from sklearn_mcmd.io._las_parts import read_parts, writing_parts
from sklearn_mcmd.io._point_cloud import has_colors, with_results, without_outliers
from sklearn_mcmd.outliers._detector import EXACT_PLANE_SCORE
from sklearn_mcmd.planes._orientation import count_upright
from sklearn_mcmd.runtime._progress import current_span
from sklearn_mcmd.tiling._catalog import EXTENSIONS, stamp_of
from sklearn_mcmd.tiling._cells import Cells
from sklearn_mcmd.tiling._memory import PART
from sklearn_mcmd.tiling._publish_outputs import places_of
from sklearn_mcmd.tiling._result_files import result_dtype, tile_file
from sklearn_mcmd.tiling._warnings import warn_caller

__all__ = [
    "LABELED",
    "SCORED",
    "VERDICTS",
    "Results",
    "Scored",
    "content_of",
    "has_scores",
    "scores_in_parts",
    "targets_of",
    "tell",
    "write_denoised_outputs",
    "write_edge_outputs",
    "write_outputs",
    "write_segmented_outputs",
]

# Results that wait in memory to be written: of a tile, and bytes of all of them.
WAITING, WAITING_BYTES = 2048, 50e6
# Of the file of a tile's scores.
SCORED = np.dtype([("row", np.int64), ("values", np.float64, (1,))])
# The same where heights have a say: scores of all points, or the depths of groups below the ground
# if these are more; and these depths, NaN of points that are used but not judged.
VERDICTS = np.dtype([("row", np.int64), ("values", np.float64, (2,))])
# Of the file of a tile's regions.
LABELED = np.dtype([("row", np.int64), ("values", np.int32, (1,))])


def targets_of(catalog, target, as_folder=None):
    """The output of each input, or one for all of several inputs.

    Parameters
    ----------
    catalog : Catalog
    target : Path
    as_folder : bool, default=None
        Whether the target is a folder. None: if there may be several inputs and its name is not
        that of a LAS or LAZ file.
    """
    named_as_file = target.suffix.lower() in EXTENSIONS and not target.is_dir()
    if as_folder is None:
        as_folder = catalog.is_many and not named_as_file
        if as_folder and target.suffix.lower() in supported_extensions() and not target.exists():
            raise PointFileError(
                f"{target}: several files become a folder, or one .las or .laz; {target.suffix} is "
                "no name for either"
            )
    if not as_folder:
        targets = [target]
        if len(catalog) > 1:
            if os.path.realpath(target) in map(os.path.realpath, catalog.paths):
                raise PointFileError(f"{target}: is one of the inputs; name another file")
            joined_header(catalog.paths)
    else:
        if target.exists() and not target.is_dir():
            raise PointFileError(
                f"{target}: several outputs need a folder; to join them in one file, name a .las "
                "or .laz"
            )
        names = [path.name.replace(".copc.", ".") for path in catalog.paths]
        for path, name in zip(catalog.paths, names, strict=True):
            if names.count(name) > 1:
                raise PointFileError(
                    f"{path}: several files have this name, and so would the outputs; to join them "
                    "in one file, name a .las or .laz"
                )
        targets = [target / name for name in names]
    for path in targets:
        if path.is_dir():
            raise PointFileError(f"{path}: is a folder; name a file in it")
        if path.suffix.lower() not in EXTENSIONS:
            raise PointFileError(f"{path}: clouds beyond memory are written as .las or .laz only")
        if path.name.lower().endswith(".copc.laz"):
            raise PointFileError(f"{path}: COPC can be read but not written; write plain .laz")
        if path.exists() and not os.access(path, os.W_OK):
            raise PointFileError(f"{path}: the file is write-protected")
        folder = target.parent if as_folder and not target.exists() else path.parent
        if not folder.is_dir():
            raise PointFileError(f"{path}: the folder {folder} does not exist")
        if not os.access(folder, os.W_OK):
            raise PointFileError(f"{path}: cannot be written; {folder} is write-protected")
    return targets


def write_outputs(catalog, targets, folder, names):
    """Write each output in the order of its inputs.

    Returns
    -------
    removed : float
        Mean share of a neighborhood that was removed.
    n_upright : int
        Normals of upright faces.
    """
    removed = names.index("removed_fraction")

    def with_normals(cloud, values, _):
        return with_results(cloud, dict(zip(names, values.T.copy(), strict=True))), None

    def totals(values):
        return np.array([values[:, removed].sum(dtype=np.float64), count_upright(values)])

    results = _results(folder, result_dtype(len(names)))
    whole, n_upright = _write(catalog, targets, folder, results, with_normals, totals, names)
    return float(whole) / catalog.n_points, int(n_upright)


class Scored(NamedTuple):
    """Files of the scores of all tiles.

    folder : Path
    n_cells : int
    dtype : dtype
        `SCORED`, or `VERDICTS`.
    """

    folder: Path
    n_cells: int
    dtype: np.dtype = SCORED

    def in_order(self):
        """The `Results`."""
        return Results(*self)

    def in_parts(self):
        """The scores of all points, tile by tile."""
        return scores_in_parts(*self)

    def flagged(self, cell, cutoff):
        """Which points of a tile are outliers, but for those of groups below the ground."""
        values = np.fromfile(tile_file(self.folder, cell), self.dtype)["values"]
        scores, depths = _judged(values)
        return (scores > cutoff) & ~(depths > cutoff)


def write_denoised_outputs(catalog, targets, folder, mode, cutoff, choice, content, scored, lowest):
    """Write each output without its outliers, or with marks.

    Parameters
    ----------
    catalog, targets, folder
        As of `write_outputs`.
    mode : {"drop", "mark"}
    cutoff : float
        Score beyond which a point is an outlier.
    choice : Choice
        The points that have scores.
    content : str
        What tells this from other outputs of the same scores.
    scored : Scored
    lowest : LowestPoints or None
        Of points that are no outliers; needed to mark.

    Returns
    -------
    n_outliers, n_exact : int
        Outliers, and those of them that have no scale, see `EXACT_PLANE_SCORE`.
    """

    def denoised(cloud, values, xyz):
        scores, depths = _judged(values)
        is_outlier = scores > cutoff
        if mode == "drop":
            return without_outliers(cloud, ~is_outlier), None
        classes = np.zeros(len(cloud), np.uint8)
        classes[is_outlier] = classes_of_noise(lowest, xyz[is_outlier])
        classes[depths > cutoff] = LOW_NOISE
        return with_results(cloud, {"outlier_score": scores.astype(np.float32)}), classes

    def counts(values):
        scores, _ = _judged(values)
        beyond = max(cutoff, EXACT_PLANE_SCORE)
        return np.array([np.count_nonzero(scores > limit) for limit in (cutoff, beyond)])

    results = scored.in_order()
    return map(int, _write(catalog, targets, folder, results, denoised, counts, content, choice))


def content_of(mode, choice, limits):
    """What tells outputs of one detector apart."""
    told = mode if choice == Choice() else f"{mode} {tuple(choice)}"
    return told if limits is None else f"{told} {tuple(limits)}"


def _judged(values):
    """Scores, NaN of points that are not judged, and the depths of groups below the ground."""
    scores = values[:, 0]
    if values.shape[1] == 1:
        return scores, np.zeros(len(scores))
    depths = values[:, 1]
    return np.where(np.isnan(depths), np.nan, scores), depths


def write_segmented_outputs(catalog, targets, folder, make, content):
    """Write each output with the regions of its points.

    Parameters
    ----------
    catalog, targets, folder
        As of `write_outputs`.
    make : callable
        Takes a cloud and its labels, and returns the cloud to write.
    content : str
        What tells this from other outputs of the same labels.
    """

    def segmented(cloud, labels, _):
        return make(cloud, labels[:, 0]), None

    _write(catalog, targets, folder, _results(folder, LABELED), segmented, len, content)


def _results(folder, dtype):
    return Results(folder.results, len(Cells(folder.cells)), dtype)


def _write(catalog, targets, folder, results, make, measure, content, choice=None):
    """Write each output; returns the sum of what `measure` tells of the `Results`.

    `make` takes a cloud in the form of its output, its results, and its coordinates in the input.
    It returns what to write, and which points to mark in it. `content` tells this from other
    outputs of the same results. With a `choice`, points that it does not take have no results: NaN.
    """
    first, total = 0, 0.0
    joined = len(targets) < len(catalog)
    header = joined_header(catalog.paths) if joined else None
    everything = range(len(catalog))
    for i, place in enumerate(places_of(catalog, targets, folder)):
        inputs = everything if joined else [i]
        if folder.is_written(i, place, content):
            n = sum(catalog.counts[j] for j in inputs)
            for start in range(first, first + n, PART):
                values = results.take(start, min(PART, first + n - start), choice is None)
                total += measure(values)
            first += n
            continue
        for j in inputs:
            with one_clear_line(catalog.paths[j], "read"):
                if stamp_of(catalog.paths[j]) != catalog.stamps[j]:
                    raise PointFileError("has changed since it was read")
        n_written = 0
        with replacing(place) as temporary, writing_parts(temporary) as write:
            for path in (catalog.paths[j] for j in inputs):
                for cloud in read_parts(path, PART):
                    xyz, chosen = cloud.xyz, None if choice is None else choice.of(cloud)
                    if joined:
                        with one_clear_line(path, "read"):
                            cloud = joined_cloud(cloud, header)
                    values = results.take(first, len(cloud), True if chosen is None else chosen)
                    total += measure(values)
                    made, marked = make(cloud, values, xyz)
                    write(made, marked)
                    n_written += len(made)
                    first += len(cloud)
                    tell(first / catalog.n_points)
        folder.mark_written(i, place, content)
        if n_written == 0:
            warn_caller(f"{targets[i]}: all points are outliers, so the file has none")
    return total


def write_edge_outputs(catalog, targets, folder, limit, by_distance, colors, content):
    """Write each output with its edges; returns the number of their points.

    Parameters
    ----------
    catalog, targets, folder
        As of `write_outputs`.
    limit : float
        Score below which a point belongs to an edge.
    by_distance : bool
        Whether scores are written as they are, or their opposites.
    colors : bool or None
        Whether edges are painted; None paints where there are no colors.
    content : str
        What tells this from other outputs of the same results.
    """

    def with_edges(cloud, scores, _):
        scores = scores[:, 0]
        paints = not has_colors(cloud) if colors is None else colors
        values = scores if by_distance else -scores
        columns = edge_columns(scores < limit, values, paints)
        return with_results(cloud, columns), None

    def count(scores):
        return np.count_nonzero(scores < limit)

    results = _results(folder, SCORED)
    return int(_write(catalog, targets, folder, results, with_edges, count, content))


def has_scores(results, cell):
    """Whether the scores of a tile are there."""
    return tile_file(results, cell).exists()


def scores_in_parts(results, n_cells, dtype=SCORED):
    """The scores of all points, tile by tile."""
    for cell in range(n_cells):
        yield np.fromfile(tile_file(results, cell), dtype)["values"][:, 0]


class Results:
    """The results of all tiles in the order of the points, of which each is asked for once."""

    def __init__(self, folder, n_tiles, dtype):
        self.paths = [tile_file(folder, cell) for cell in range(n_tiles)]
        self.dtype = dtype
        self.waiting = [np.empty(0, self.dtype)] * n_tiles
        self.read = [0] * n_tiles
        self.n_read = int(np.clip(WAITING_BYTES / n_tiles / self.dtype.itemsize, 16, WAITING))

    def take(self, first, n, expected=True):
        """Results (n, n_columns) of the points from the row `first` on.

        `expected` are the points that have results, a mask, True for all; False if that is unknown.
        Others have NaN.
        """
        of_row = self.dtype["values"]
        values, found = np.empty((n, of_row.shape[0]), of_row.base), 0
        if expected is not True:
            values[:] = np.nan
        for tile in range(len(self.paths)):
            for part in self._parts(tile, first + n):
                values[part["row"] - first] = part["values"]
                found += len(part)
        wanted = n if expected is True else np.count_nonzero(expected)
        if expected is not False and found != wanted:
            # a fault of ours
            raise RuntimeError(f"{wanted - found} of {wanted} points have no results")
        return values

    def _parts(self, tile, stop):
        while True:
            waiting = self.waiting[tile]
            n = int(np.searchsorted(waiting["row"], stop))
            yield waiting[:n]
            self.waiting[tile] = waiting[n:]
            if n < len(waiting):
                return
            offset = self.read[tile] * self.dtype.itemsize
            self.waiting[tile] = np.fromfile(
                self.paths[tile], self.dtype, self.n_read, offset=offset
            )
            self.read[tile] += len(self.waiting[tile])
            if not len(self.waiting[tile]):
                return


def tell(share, note=""):
    """Tell who listens what share of this part of the work is done, and what else to say of it."""
    span = current_span()
    if span is not None:
        dataclasses.replace(span, note=note).tell(share)
