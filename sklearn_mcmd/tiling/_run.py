"""Normals of clouds larger than memory: points into cells, tiles in processes, outputs in order."""

import json
import os
import shutil
import time
import warnings
from collections.abc import Iterable, Sequence
from contextlib import contextmanager
from functools import partial
from numbers import Integral
from pathlib import Path
from typing import NamedTuple

import numpy as np
from sklearn.base import clone

from sklearn_mcmd.io import PointFileError
from sklearn_mcmd.io._files import one_clear_line
from sklearn_mcmd.io._las_parts import read_parts
from sklearn_mcmd.normals import RobustNormalEstimator
from sklearn_mcmd.planes._base import BaseLocalPlanes
from sklearn_mcmd.planes._progress import progress_part
from sklearn_mcmd.tiling._auto import find_auto_normals
from sklearn_mcmd.tiling._catalog import Catalog
from sklearn_mcmd.tiling._cells import Cells, CellWriter
from sklearn_mcmd.tiling._constants import WholeCloud
from sklearn_mcmd.tiling._folder import WorkFolder, key_of
from sklearn_mcmd.tiling._memory import PART, check_division, parse_memory, plan_run, usual_memory
from sklearn_mcmd.tiling._moves import Moves
from sklearn_mcmd.tiling._outputs import targets_of, tell, write_outputs
from sklearn_mcmd.tiling._tile import (
    NORMAL_COLUMNS,
    TileReport,
    normal_columns,
    normals_of_tile,
    tile_files,
)
from sklearn_mcmd.tiling._work import TilingError, compute_cells

__all__ = [
    "COMPUTED",
    "SCATTERED",
    "RunReport",
    "TilingError",
    "check_normals",
    "check_seed",
    "finish",
    "finished_before",
    "kept",
    "reports_of",
    "scattered",
    "write_normals",
]

# Shares of the time, for the display of progress.
SCATTERED, COMPUTED = 0.07, 0.93
WARM_UP = 1_500  # points that make this process load or compile the code once, for all others


class RunReport(NamedTuple):
    """What a run came to.

    Attributes
    ----------
    n_points, n_tiles, n_workers : int
    n_resumed : int
        Tiles that an earlier run had finished; of `write_denoised`, those whose planes it had.
    n_proved : int
        Points whose normals or planes the first halo proved. The others were computed again, from
        all points that they depend on.
    removed_fraction : float
        Mean share of a neighborhood that was removed; of `write_denoised`, the share of outliers.
    seconds : float
    n_outliers : int
        Of `write_denoised`, and of `write_edges` before it looks for edges.
    n_exact : int
        Of these, those that may be outliers only because most of their neighbors lie exactly in
        one plane.
    n_regions, n_inside : int
        Of `write_segments`, regions, and points in any of them.
    largest : list of int
        Points of the largest regions.
    n_edges : int
        Points of edges, of `write_edges`.
    n_judged : int
        Of `write_denoised`, points that were used: not withheld, and of the classes asked for.
    """

    n_points: int
    n_tiles: int
    n_workers: int
    n_resumed: int
    n_proved: int
    removed_fraction: float
    seconds: float
    n_outliers: int = 0
    n_exact: int = 0
    n_regions: int = 0
    n_inside: int = 0
    largest: Sequence[int] = ()
    n_edges: int = 0
    n_judged: int = 0


def write_normals(
    source: Catalog | str | os.PathLike[str] | Iterable[str | os.PathLike[str]],
    target: str | os.PathLike[str],
    estimator: RobustNormalEstimator | None = None,
    *,
    memory: str | float | None = None,
    n_jobs: int | None = None,
    tile_size: int | None = None,
    cut: float = 0.5,
    as_folder: bool | None = None,
    restart: bool = False,
) -> RunReport:
    """Normals of all points of large files, equal to those computed in memory.

    All points are read once and divided into tiles. The normals of a tile are computed with the
    points around it, its halo. Each is proved: if a neighborhood that it depends on reaches beyond
    the halo, it is computed again from all points that it depends on. So the output is that of
    ``estimator.fit`` on all points together, to the last bit, whatever the tiles are.

    Parameters
    ----------
    source : Catalog, or what it takes
        Files, a folder, or an index.
    target : str or os.PathLike
        A LAS or LAZ file for one file, or a folder for several or a folder. Outputs have the names
        of their inputs, all attributes, and the order of the points. They may replace the inputs.
        A name that ends in ``.las`` or ``.laz`` joins several inputs in one file: with the richest
        point format, the finest scales and the attributes of all, in the order of the inputs.
    estimator : RobustNormalEstimator, default=None
        With an int as `random_state`, a number of neighbors or "auto", and no
        ``orientation="mst"``, which depends on the whole cloud. "auto" adds an attribute
        ``n_neighbors``. None is ``RobustNormalEstimator(random_state=0)``.
    memory : str or float, default=None
        What the run may take, such as "2GB" or a number of bytes. None is half of the machine's.
    n_jobs : int, default=None
        Processes. None means 1 unless in a :obj:`joblib.parallel_config` context, and -1 means all
        processors; fewer, where the memory asks for it.
    tile_size : int, default=None
        Largest number of points in a tile; None is what the memory allows.
    cut : float in (0, 1), default=0.5
        Share of a tile that comes to the left when it is divided. Results do not depend on it.
    as_folder : bool, default=None
        Whether `target` is a folder. None means that it is, if `source` is a folder, an index or
        several files, and `target` is not named as a file.
    restart : bool, default=False
        Whether to forget what an earlier run has left. By default a run with the same inputs and
        parameters goes on where the earlier one ended.

    Returns
    -------
    RunReport

    Raises
    ------
    PointFileError
        If a file cannot be read or written.
    TilingError
        If some tiles failed, or the run ended in another way after all points were read. Temporary
        files are then kept, and the message names them.
    ValueError
        If the estimator's results depend on the whole cloud, or the memory is too little.

    See Also
    --------
    Catalog : What files hold.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from sklearn_mcmd.datasets import make_street
    >>> from sklearn_mcmd.io import read_points, write_points
    >>> from sklearn_mcmd.tiling import write_normals
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     a, b = Path(folder) / "a.las", Path(folder) / "b.las"
    ...     write_points(a, make_street(8_000, random_state=0).data)
    ...     report = write_normals(a, b, tile_size=3_000)
    ...     print(report.n_tiles, "tiles;", *list(read_points(b).attributes)[-8:-4])
    4 tiles; normal_x normal_y normal_z surface_variation
    """
    begin = time.perf_counter()
    if estimator is None:
        estimator = RobustNormalEstimator(random_state=0)
    check_normals(estimator)
    check_division(tile_size, cut)
    memory = usual_memory() if memory is None else parse_memory(memory)
    catalog = source if isinstance(source, Catalog) else Catalog(source)
    targets = targets_of(catalog, Path(target), as_folder)
    estimator = clone(estimator).set_params(n_jobs=1)
    if not restart and (report := finished_before(catalog, target, targets, estimator)):
        return report
    names = _warm_up(estimator)
    work = "auto" if estimator.n_neighbors == "auto" else "normals"
    n_features = len(names) - len(NORMAL_COLUMNS)
    plan = plan_run(catalog.n_points, memory, n_jobs, n_features, tile_size, work=work)
    folder = scattered(catalog, target, estimator, plan, cut, restart)
    with kept(folder):
        for path in targets:
            path.parent.mkdir(exist_ok=True)
        with progress_part(SCATTERED, COMPUTED, "normals"):
            cells = Cells(folder.cells)
            find = find_auto_normals if estimator.n_neighbors == "auto" else _find_normals
            n_resumed = find(folder, cells, estimator, folder.constants, plan, folder.is_done)
        with progress_part(COMPUTED, 1.0, "writing"):
            removed = write_outputs(catalog, targets, folder, names)
        reports = reports_of(folder.results, range(len(cells)))
        report = RunReport(
            catalog.n_points, len(reports), plan.n_workers, n_resumed,
            sum(report.n_proved for report in reports), removed, time.perf_counter() - begin,
        )  # fmt: skip
        finish(folder, catalog, targets, estimator, report)
    return report


def _find_normals(folder, cells, estimator, constants, plan, is_done):
    todo = [cell for cell in range(len(cells)) if not is_done(cell)]
    task = partial(
        normals_of_tile, folder.cells, estimator=estimator, constants=constants,
        target=folder.results, n_threads=plan.n_threads,
    )  # fmt: skip
    compute_cells(task, cells, todo, plan.n_workers)
    return len(cells) - len(todo)


def scattered(catalog, target, estimator, plan, cut, restart, choice=None):
    """The folder of a run, with all points in cells: of an earlier run, if that was the same.

    Of the points, a `Choice` takes some; with None, all.
    """
    key = key_of(catalog, estimator, plan.tile_size, cut, _version(), choice)
    folder = WorkFolder(target, key)
    try:
        if restart:
            folder.clear()
        if folder.constants is None:
            _check_disk(folder.path.parent, plan.disk)
            with progress_part(0.0, SCATTERED, "reading"):
                _scatter(catalog, folder, plan.tile_size, cut, choice)
    except BaseException:
        if folder.constants is None:
            folder.remove()
        folder.release()
        raise
    return folder


def finished_before(catalog, target, targets, estimator, content=""):
    """The report of an earlier run that had only to move its outputs, which is done; or None."""
    path = WorkFolder.path_of(target)
    if not path.exists():
        return None
    folder = WorkFolder(target, None)
    with kept(folder):
        report = Moves(folder, catalog, targets, estimator, content, _version()).resume()
        if report:
            folder.remove()
    if report is False:
        raise TilingError(
            f"{target}: an earlier run ended when it had replaced some of its inputs; give the "
            "same command again to replace the others, or begin anew with files as they are "
            "(restart)"
        )
    if report is None:
        return None
    report = RunReport(**report)
    return report._replace(n_resumed=report.n_tiles)


def finish(folder, catalog, targets, estimator, report, content=""):
    """Move outputs that replace inputs, and remove the folder."""
    moves = Moves(folder, catalog, targets, estimator, content, _version())
    moves.finish(report._asdict())
    folder.remove()


@contextmanager
def kept(folder):
    """Name the folder where a run ends early."""
    try:
        yield
    except (Exception, KeyboardInterrupt, SystemExit) as err:
        kept = f"what was done is kept in {folder.path}, and the same run goes on from there"
        if isinstance(err, Exception) and not isinstance(err, Warning):  # the user may raise these
            raise TilingError(f"{str(err) or type(err).__name__}; {kept}") from err
        warnings.warn(kept, stacklevel=4)
        raise
    finally:
        folder.release()


def check_seed(estimator):
    """Raise if trials would differ from tile to tile."""
    if not isinstance(estimator.random_state, Integral):
        raise ValueError(
            f"random_state={estimator.random_state!r} must be an int, so that all tiles make the "
            "same trials."
        )


def check_normals(estimator, *, inner=False):
    """Raise if normals depend on the whole cloud; `inner` ones are those of another estimator."""
    if not isinstance(estimator, BaseLocalPlanes) or estimator._locality()[0] is None:
        raise ValueError(
            f"{type(estimator).__name__} cannot work by tiles with these parameters: with "
            'n_neighbors=None or orientation="mst", results depend on the whole cloud.'
        )
    if np.ndim(getattr(estimator, "sensor_origin", None)) == 2:
        raise ValueError(
            "sensor_origin with a position for each point cannot work by tiles: give one position, "
            "or compute the normals in memory."
        )
    if inner and estimator.n_neighbors == "auto":
        raise ValueError('n_neighbors="auto" of normal_estimator cannot work by tiles.')
    check_seed(estimator)


def _warm_up(estimator):
    """The names of results; compiled code is then on disk for all processes."""
    points = np.random.default_rng(0).uniform(size=(WARM_UP, 3)) * [1, 1, 0.01]
    with warnings.catch_warnings(), progress_part(0.0, 0.0):
        warnings.simplefilter("ignore")
        names = normal_columns(clone(estimator).fit(points))[0]
    return [*names, "n_neighbors"] if estimator.n_neighbors == "auto" else names


def _check_disk(folder, wanted):
    free = shutil.disk_usage(folder).free
    if free < wanted:
        raise PointFileError(
            f"{folder}: temporary files need about {wanted / 1e9:.3g} GB, and {free / 1e9:.3g} GB "
            "are free"
        )


def _scatter(catalog, folder, capacity, cut, choice):
    """Read all points once: into cells, and for the constants of the whole cloud."""
    writer, whole, row = CellWriter(folder.cells, capacity, cut), WholeCloud(), 0
    for path in catalog.paths:
        for cloud in read_parts(path, PART):
            with one_clear_line(path, "read"):
                chosen = None if choice is None else choice.of(cloud)
            xyz = cloud.xyz if chosen is None else cloud.xyz[chosen]
            rows = np.arange(row, row + len(cloud))
            if len(xyz):
                writer.add(xyz, rows if chosen is None else rows[chosen])
                whole.add(xyz)
            row += len(cloud)
            tell(row / catalog.n_points)
    if not writer.n_points:
        raise PointFileError(
            f"{catalog.paths[0]}: no points are judged: all are withheld or of other classes"
        )
    writer.close()
    folder.finish_cells(whole.constants())


def reports_of(results, cells):
    """What the work on some tiles came to: list of `TileReport`."""
    files = (tile_files(results, cell)[1] for cell in cells)
    return [TileReport(**json.loads(file.read_text())) for file in files]


def _version():
    from sklearn_mcmd import __version__

    return __version__
