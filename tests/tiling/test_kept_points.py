"""Cells of the points that a detector left have the boxes and numbers of all cells."""

import numpy as np
from numpy.testing import assert_array_equal

from sklearn_mcmd.planes._resolution import coordinate_step
from sklearn_mcmd.tiling._cell_columns import CellColumns
from sklearn_mcmd.tiling._cells import CellWriter
from sklearn_mcmd.tiling._edges import close_kept, find_kept, kept_constants
from sklearn_mcmd.tiling._result_files import SCORED, tile_file


def test_kept_points_lie_in_the_cells_of_all_and_have_constants_of_their_own(tmp_path):
    rng = np.random.default_rng(0)
    xyz = np.round(rng.uniform(0, 4, (3_000, 3)), 1)
    xyz[::7] += 1e-4  # off the lattice
    folders = [tmp_path / name for name in ("cells", "kept", "columns", "scores")]
    for folder in folders:
        folder.mkdir()
    folder, target, columns, scores = folders
    writer = CellWriter(folder, 500)
    writer.add(xyz, 0)
    cells, score = writer.close(), np.where(np.arange(3_000) % 7, 1.0, 9.0)
    score[cells.read(2)["row"]] = 9.0
    for cell in range(len(cells)):
        row = cells.read(cell)["row"]
        results = np.empty(len(row), SCORED)
        results["row"], results["values"][:, 0] = row, score[row]
        tile_file(scores, cell).write_bytes(results.tobytes())
        find_kept(cell, folder, target, columns, scores, cutoff=1.0)
    kept = close_kept(cells, target, CellColumns(columns))
    assert len(kept) == len(cells)
    assert kept.counts[2] == 0
    assert not len(kept.read(2))
    for cell in range(len(cells)):
        records = cells.read(cell)
        assert_array_equal(kept.read(cell), records[score[records["row"]] <= 1.0])
    assert_array_equal(kept.low, cells.low)
    assert_array_equal(kept.high, cells.high)
    found = kept_constants(kept, "float64")
    assert found == ("float64", coordinate_step(xyz[score <= 1.0]))
    assert found.step > 0 == coordinate_step(xyz)
    assert kept_constants(kept, "float32").dtype == "float32"
