"""Clouds in files, results by tiles as they are before they are written, and tiles that fail."""

import numpy as np
import pytest

from sklearn_mcmd.io import write_points
from sklearn_mcmd.tiling import TilingError, _run, _tasks, process_files
from sklearn_mcmd.tiling._halo import Part
from tiled import PCA, street


@pytest.fixture
def measured():
    """For tests in which the memory of a point is measured, as for users: one of each verb and
    option."""


@pytest.fixture(autouse=True)
def _memory_as_usual(request, monkeypatch):
    """It is measured by three fits, which are half of the work with a small file."""
    if "measured" not in request.fixturenames:
        monkeypatch.setattr(_run, "bytes_of_point", lambda fit, xyz, n_neighbors: 3_000.0)


@pytest.fixture
def small_file(tmp_path):
    """2,000 points."""
    write_points(tmp_path / "small.las", street(2_000))
    return tmp_path / "small.las"


@pytest.fixture
def by_tiles(monkeypatch, tmp_path):
    """A run by tiles in this process; returns the results of all points, which of them are proven
    to be those of memory, its verb, and the report."""
    found, proofs, write, prove = [], [], _run.write_outputs, Part.proven

    def keep_results(run, verb):
        found.append((verb.results(run).take(0, run.catalog.n_points), verb))
        return write(run, verb)

    def keep_proofs(part, *args):
        proven, away = prove(part, *args)
        proofs.append((part.rows[part.own], proven))
        return proven, away

    monkeypatch.setattr(_run, "write_outputs", keep_results)
    monkeypatch.setattr(Part, "proven", keep_proofs)

    def run(source, estimator, **options):
        proofs.clear()
        target = tmp_path / ("out" if isinstance(source, list) else "out.las")
        report = process_files(source, target, estimator, n_jobs=1, **options)
        proven = np.full(report.n_points, report.n_tiles == 1)
        for rows, are in proofs:
            proven[rows] = are
        values, verb = found.pop()
        return values, proven, verb, report

    return run


@pytest.fixture
def failing(monkeypatch):
    """Cells whose tiles fail."""
    cells = set()

    def part_of_cell(cells_of_run, cell, *args, find=_tasks.part_of_cell):
        if cell in cells:
            raise MemoryError("too much\nof it")
        return find(cells_of_run, cell, *args)

    monkeypatch.setattr(_tasks, "part_of_cell", part_of_cell)
    return cells


@pytest.fixture
def ended(small_file, tmp_path, failing):
    """The output of a run that ended, of whose four tiles three are done."""
    failing.add(1)
    with pytest.warns(match="tile 1 failed"), pytest.raises(TilingError):
        process_files(small_file, tmp_path / "out.las", PCA, tile_size=800)
    failing.clear()
    return tmp_path / "out.las"
