"""Normals of clouds larger than memory."""

from functools import partial

import numpy as np
from sklearn.base import clone

from sklearn_mcmd._errors import ParameterError
from sklearn_mcmd.normals._features import needs_curvatures, settle_features
from sklearn_mcmd.planes._base import BaseLocalPlanes
from sklearn_mcmd.planes._progress import progress_part
from sklearn_mcmd.tiling._auto import find_auto_normals
from sklearn_mcmd.tiling._outputs import write_outputs
from sklearn_mcmd.tiling._run import Verb, check_seed, warm_up
from sklearn_mcmd.tiling._tile import (
    NORMAL_COLUMNS,
    normal_columns,
    normals_of_tile,
    total_proved,
)
from sklearn_mcmd.tiling._trees import find_agreeing_normals
from sklearn_mcmd.tiling._work import compute_cells

__all__ = ["Normals", "check_normals"]

WARM_UP = 1_500  # points that load or compile the code


def check_normals(estimator, *, inner=False):
    """Raise if normals depend on the whole cloud; `inner` ones are those of another estimator."""
    if not inner and _has_tree(estimator):
        if estimator.n_neighbors == "auto" or needs_curvatures(
            settle_features(estimator.features, 3)
        ):
            raise ParameterError(
                "$orientation='mst' cannot work by tiles with $n_neighbors='auto' or curvatures "
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


class Normals(Verb):
    """Normals, by tiles that need nothing of each other but points, or signs along a tree."""

    def __init__(self, estimator):
        check_normals(estimator)
        super().__init__(clone(estimator).set_params(n_jobs=1))

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
