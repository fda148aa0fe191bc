"""Clouds in files, results by tiles as they are before they are written, and tiles that fail."""

import pytest

from sklearn_mcmd.io import write_points
from sklearn_mcmd.tiling import _run, _tiled_normals, process_files
from tiled import in_memory, street


@pytest.fixture(scope="session")
def street_file(tmp_path_factory):
    """12,000 points, and the same with normals."""
    folder = tmp_path_factory.mktemp("street")
    write_points(folder / "street.laz", street(12_000))
    return folder / "street.laz", in_memory(folder / "street.laz", folder / "normals.laz")


@pytest.fixture
def small_file(tmp_path):
    """5,000 points."""
    write_points(tmp_path / "small.las", street(5_000))
    return tmp_path / "small.las"


@pytest.fixture
def by_tiles(monkeypatch, tmp_path):
    """A run by tiles; returns the results of all points, its verb, and the report."""
    found, write = [], _run.write_outputs

    def keep_results(run, verb):
        found.append((verb.results(run).take(0, run.catalog.n_points), verb))
        return write(run, verb)

    monkeypatch.setattr(_run, "write_outputs", keep_results)

    def run(source, estimator, **options):
        report = process_files(source, tmp_path / "out.las", estimator, **options)
        return *found.pop(), report

    return run


@pytest.fixture
def failing(monkeypatch):
    """Cells whose tiles fail."""
    cells = set()

    def work(cell, job, fit=_tiled_normals._fit_own):
        if cell in cells:
            raise MemoryError("too much\nof it")
        return fit(cell, job)

    monkeypatch.setattr(_tiled_normals, "_fit_own", work)
    return cells
