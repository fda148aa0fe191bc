"""Normals of clouds larger than memory."""

import os
from collections.abc import Iterable
from functools import partial

import numpy as np
from sklearn.base import clone

from sklearn_mcmd.normals import RobustNormalEstimator
from sklearn_mcmd.normals._features import needs_curvatures, settle_features
from sklearn_mcmd.planes._base import BaseLocalPlanes
from sklearn_mcmd.planes._progress import progress_part
from sklearn_mcmd.tiling._auto import find_auto_normals
from sklearn_mcmd.tiling._catalog import Catalog
from sklearn_mcmd.tiling._outputs import write_outputs
from sklearn_mcmd.tiling._run import RunReport, Verb, check_seed, run_by_tiles, warm_up
from sklearn_mcmd.tiling._tile import (
    NORMAL_COLUMNS,
    normal_columns,
    normals_of_tile,
    total_proved,
)
from sklearn_mcmd.tiling._trees import find_agreeing_normals
from sklearn_mcmd.tiling._work import compute_cells

__all__ = ["check_normals", "write_normals"]

WARM_UP = 1_500  # points that load or compile the code


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
        With an int as `random_state`, and a number of neighbors or "auto", which adds an attribute
        ``n_neighbors``. ``orientation="mst"`` takes a number, and no curvatures, which have the
        sides of normals. None is ``RobustNormalEstimator(random_state=0)``.
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
    if estimator is None:
        estimator = RobustNormalEstimator(random_state=0)
    check_normals(estimator)
    return run_by_tiles(
        _Normals(clone(estimator).set_params(n_jobs=1)), source, target, memory=memory,
        n_jobs=n_jobs, tile_size=tile_size, cut=cut, as_folder=as_folder, restart=restart,
    )  # fmt: skip


def check_normals(estimator, *, inner=False):
    """Raise if normals depend on the whole cloud; `inner` ones are those of another estimator."""
    if not inner and _has_tree(estimator):
        if estimator.n_neighbors == "auto" or needs_curvatures(
            settle_features(estimator.features, 3)
        ):
            raise ValueError(
                "orientation='mst' cannot work by tiles with n_neighbors='auto' or curvatures "
                "among the features: leave these out, or give more memory."
            )
        estimator = clone(estimator).set_params(orientation=None)
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


def _has_tree(estimator):
    asked = getattr(estimator, "orientation", None)
    return isinstance(asked, str) and asked == "mst"


class _Normals(Verb):
    """Normals, by tiles that need nothing of each other but points, or signs along a tree."""

    def prepare(self):
        self.is_auto = self.estimator.n_neighbors == "auto"
        self.names = normal_columns(warm_up(self.estimator, WARM_UP))[0]
        if self.is_auto:
            self.names.append("n_neighbors")
        work = "auto" if self.is_auto else "tree" if _has_tree(self.estimator) else "normals"
        return work, len(self.names) - len(NORMAL_COLUMNS)

    def find(self, run):
        with progress_part(0.0, 1.0, "normals"):
            find = find_auto_normals if self.is_auto else _find_normals
            find = find_agreeing_normals if _has_tree(self.estimator) else find
            self.n_resumed = find(run, self.estimator)

    def write(self, run):
        removed, n_upright = write_outputs(run.catalog, run.targets, run.folder, self.names)
        return {
            "removed_fraction": removed,
            "n_upright": n_upright,
            "n_proved": total_proved(run.folder.results, range(len(run.cells))),
            "n_resumed": self.n_resumed,
        }


def _find_normals(run, estimator):
    """Write the results of all tiles; returns how many tiles an earlier run had done."""
    folder, n_cells = run.folder, len(run.cells)
    todo = [cell for cell in range(n_cells) if not folder.is_done(cell)]
    task = partial(
        normals_of_tile, folder.cells, estimator=estimator, constants=folder.constants,
        target=folder.results, n_threads=run.plan.n_threads,
    )  # fmt: skip
    compute_cells(task, run.cells, todo, run.plan.n_workers)
    return n_cells - len(todo)
