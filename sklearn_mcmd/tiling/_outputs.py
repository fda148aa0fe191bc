"""Outputs of a run: where they go, and results of all tiles in the order of the inputs."""

import dataclasses
import os

import numpy as np

from sklearn_mcmd.io import PointFileError
from sklearn_mcmd.io._files import one_clear_line, replacing
from sklearn_mcmd.io._las_parts import read_parts, writing_parts
from sklearn_mcmd.io._point_cloud import with_results
from sklearn_mcmd.planes._progress import current_span
from sklearn_mcmd.tiling._catalog import EXTENSIONS, stamp_of
from sklearn_mcmd.tiling._cells import Cells
from sklearn_mcmd.tiling._memory import PART
from sklearn_mcmd.tiling._tile import result_dtype, tile_files

__all__ = [
    "SCORED",
    "scores_in_parts",
    "targets_of",
    "tell",
    "write_denoised_outputs",
    "write_outputs",
]

# Results that wait in memory to be written: of a tile, and bytes of all of them.
WAITING, WAITING_BYTES = 2048, 50e6
# Of the file of a tile's scores.
SCORED = np.dtype([("row", np.int64), ("values", np.float64, (1,))])


def targets_of(catalog, target, as_folder):
    """The output of each input."""
    if not as_folder:
        targets = [target]
    else:
        named_as_file = not target.exists() and target.suffix.lower() in EXTENSIONS
        if named_as_file or (target.exists() and not target.is_dir()):
            raise PointFileError(f"{target}: the outputs of a folder need a folder, not a file")
        targets = [target / path.name.replace(".copc.", ".") for path in catalog.paths]
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
    """Write each output in the order of its input; returns the mean share that was removed."""
    results = _Results(folder.results, len(Cells(folder.cells)), result_dtype(len(names)))
    first, total = 0, 0.0
    removed = names.index("removed_fraction")
    for i, (path, target, n) in enumerate(zip(catalog.paths, targets, catalog.counts, strict=True)):
        if folder.is_written(i):
            total += results.take(first, n)[:, removed].sum(dtype=np.float64)
            first += n
            continue
        with one_clear_line(path, "read"):
            if stamp_of(path) != catalog.stamps[i]:
                raise PointFileError("has changed since it was read")
        with replacing(target) as temporary, writing_parts(temporary) as write:
            for cloud in read_parts(path, PART):
                values = results.take(first, len(cloud))
                total += values[:, removed].sum(dtype=np.float64)
                write(with_results(cloud, dict(zip(names, values.T.copy(), strict=True))))
                first += len(cloud)
                tell(first / catalog.n_points)
        folder.mark_written(i)
    return float(total) / catalog.n_points


def write_denoised_outputs(catalog, targets, folder, mode, is_outlier):
    """Write each output without its outliers, or with marks.

    Parameters
    ----------
    catalog, targets, folder
        As of `write_outputs`.
    mode : {"drop", "mark"}
    is_outlier : callable
        Tells which scores are those of outliers.

    Returns
    -------
    n_outliers : int
    """
    results = _Results(folder.results, len(Cells(folder.cells)), SCORED)
    first, n_outliers = 0, 0
    for i, (path, target, n) in enumerate(zip(catalog.paths, targets, catalog.counts, strict=True)):
        if folder.is_written(f"{i}.{mode}"):
            n_outliers += int(is_outlier(results.take(first, n)).sum())
            first += n
            continue
        with one_clear_line(path, "read"):
            if stamp_of(path) != catalog.stamps[i]:
                raise PointFileError("has changed since it was read")
        with replacing(target) as temporary, writing_parts(temporary) as write:
            for cloud in read_parts(path, PART):
                scores = results.take(first, len(cloud))[:, 0]
                outlier = is_outlier(scores)
                n_outliers += int(outlier.sum())
                if mode == "drop":
                    write(cloud.subset(~outlier))
                else:
                    score = {"outlier_score": scores.astype(np.float32)}
                    write(with_results(cloud, score), outlier)
                first += len(cloud)
                tell(first / catalog.n_points)
        folder.mark_written(f"{i}.{mode}")
    return n_outliers


def scores_in_parts(folder):
    """The scores of all points, tile by tile."""
    for cell in range(len(Cells(folder.cells))):
        yield np.fromfile(tile_files(folder.results, cell)[0], SCORED)["values"][:, 0]


class _Results:
    """The results of all tiles in the order of the points, of which each is asked for once."""

    def __init__(self, folder, n_tiles, dtype):
        self.paths = [tile_files(folder, cell)[0] for cell in range(n_tiles)]
        self.dtype = dtype
        self.waiting = [np.empty(0, self.dtype)] * n_tiles
        self.read = [0] * n_tiles
        self.n_read = int(np.clip(WAITING_BYTES / n_tiles / self.dtype.itemsize, 16, WAITING))

    def take(self, first, n):
        """Results (n, n_columns) of the points from the row `first` on."""
        of_row = self.dtype["values"]
        values, found = np.empty((n, of_row.shape[0]), of_row.base), 0
        for tile in range(len(self.paths)):
            for part in self._parts(tile, first + n):
                values[part["row"] - first] = part["values"]
                found += len(part)
        if found != n:
            raise RuntimeError(f"{n - found} of {n} points have no results")  # a fault of ours
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


def tell(share, stage=None):
    """Tell who listens what share of this part of the work is done, and what it is."""
    span = current_span()
    if span is not None:
        (span if stage is None else dataclasses.replace(span, stage=stage)).tell(share)
