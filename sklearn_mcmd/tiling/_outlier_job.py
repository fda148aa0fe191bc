"""The places of a cloud, their neighbors and planes, cell by cell, as the detector takes them."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from sklearn.base import clone

from sklearn_mcmd._validation import is_auto
from sklearn_mcmd.outliers import MCMDOutlierDetector
from sklearn_mcmd.outliers._model import JudgedCloud
from sklearn_mcmd.planes._base import model_of
from sklearn_mcmd.runtime._chunks import slices
from sklearn_mcmd.tiling._cell_columns import CellColumns
from sklearn_mcmd.tiling._cells import Cells
from sklearn_mcmd.tiling._cloud_constants import Constants
from sklearn_mcmd.tiling._stored_columns import whole_of
from sklearn_mcmd.tiling._stored_index import CHUNK, StoredIndex

__all__ = ["Job", "find_planes"]


class Job(NamedTuple):
    """What all sweeps over the cells of a cloud know."""

    cells: Path  # folder of `Cells`
    columns: Path  # folder of `CellColumns`
    detector: MCMDOutlierDetector
    constants: Constants
    n_points: int = 0  # of the whole cloud
    n_threads: int = 1  # of each worker

    def open(self):
        """The cells, and the columns of their places."""
        return Cells(self.cells), CellColumns(self.columns)

    @property
    def paper(self):
        """Whether each point is judged by its own plane alone."""
        return self.detector.strictness is None

    @property
    def settings(self):
        """Those of `JudgedCloud`."""
        return {name: getattr(self.detector, name) for name in ("strictness", "noise_scale")}

    def judged(self, index, n_jobs=1, origins=None):
        """The places of an index, as the detector judges them; `origins` are of `JudgedCloud`."""
        constants, detector = self.constants, clone(self.detector)
        precision = np.finfo(constants.dtype).eps
        model = model_of(detector, index, index.points.shape, precision, constants.step)
        told = {"origins": origins, "doubted": is_auto(detector.sensor_origin)}
        return JudgedCloud(model, **self.settings, n_jobs=n_jobs, **told)

    def stored_columns(self):
        """What `find_planes` fills: names, dtypes and shapes of a row."""
        number = np.float64, ()
        columns = {"near": (np.int32, (self.detector.n_neighbors,))}
        if self.paper:
            return {**columns, "distances": number}
        planes = dict.fromkeys(("centroids", "normals"), (np.float64, (3,)))
        others = ("scale", "radius", "spacing", "other_spacing")
        return {**columns, **planes, **dict.fromkeys(others, number)}


def find_planes(cell, job):
    """Fill the columns of a cell that `Job.stored_columns` names."""
    columns, whole = job.open()[1], whole_of(job)
    own = whole.rows(cell)
    judged = job.judged(StoredIndex(whole), job.n_threads)
    if job.paper:
        distances = [_paper_scores(judged, rows) for rows in slices(own.stop, CHUNK, own.start)]
        whole.put(cell, distances=np.concatenate(distances))
    else:
        judged.counts = whole.open("counts")
        planes, spacing, other_spacing = judged.measure_planes(own)
        whole.put(
            cell, centroids=planes.centroids, normals=planes.normals, scale=planes.scale,
            radius=planes.radius, spacing=spacing, other_spacing=other_spacing,
        )  # fmt: skip
    columns.finish(cell, "planes")


def _paper_scores(judged, rows):
    index = judged.model.index
    around = index.query_own(rows)
    return judged.paper_scores(*judged.model.evaluate_neighborhoods(index.points[rows], around))
