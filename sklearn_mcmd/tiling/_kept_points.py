"""The points that a detector left, in cells of their own with the same boxes and numbers."""

import numpy as np

from sklearn_mcmd.io._files import one_clear_line
from sklearn_mcmd.tiling._cell_columns import CellColumns, in_place_of
from sklearn_mcmd.tiling._cells import Cells, _no_extent, _path, write_boxes
from sklearn_mcmd.tiling._cloud_constants import WholeCloud
from sklearn_mcmd.tiling._result_files import SCORED, tile_file

__all__ = ["close_kept", "find_kept", "kept_constants"]


def find_kept(cell, folder, target, columns, scores, cutoff):
    """Write the points of a cell whose scores are at most the cutoff.

    Column: kept, of all points of the cell in their order.

    Parameters
    ----------
    cell : int
    folder, target : Path
        Of the `Cells` of all points, and of those that are kept.
    columns : Path
    scores : Path
        Of the results of the detector.
    cutoff : float
    """
    cells, columns, path = Cells(folder), CellColumns(columns), _path(target, cell)
    kept = np.fromfile(tile_file(scores, cell), SCORED)["values"][:, 0] <= cutoff
    records = cells.read(cell)[kept]
    with one_clear_line(path, "written"), in_place_of(path) as temporary:
        temporary.write_bytes(records.data)
    extent = _no_extent()
    if len(records):
        extent = np.stack([records["xyz"].min(axis=0), records["xyz"].max(axis=0)])
    columns.write(cell, kept=kept, kept_extent=extent)
    columns.finish(cell, "kept", n_kept=len(records))


def close_kept(cells, target, columns):
    """Write what the cells of the kept points are; some may be empty. Returns these `Cells`."""
    counts = [columns.report(cell, "kept")["n_kept"] for cell in range(len(cells))]
    extents = np.array([columns.read(cell, "kept_extent") for cell in range(len(cells))])
    return write_boxes(
        target, names=np.arange(len(cells)), low=cells.low, high=cells.high,
        least=extents[:, 0], most=extents[:, 1], counts=counts,
    )  # fmt: skip


def kept_constants(kept, dtype):
    """The `Constants` of the kept points, in the precision of the whole cloud."""
    whole = WholeCloud()
    whole.single = False  # the precision is known
    for cell in np.flatnonzero(kept.counts):
        whole.add(kept.read(cell)["xyz"])
    return whole.constants(dtype)
