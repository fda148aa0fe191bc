"""Reading and writing by the verbs. Errors of writing appear before the long work."""

import os
import warnings
from contextlib import contextmanager

import numpy as np

from sklearn_mcmd._errors import counted
from sklearn_mcmd.io import PointCloud, read_points, write_points
from sklearn_mcmd.io._formats import ALL, INDEX, TILED, format_of, supported_extensions
from sklearn_mcmd.io._no_returns import LEFT_OUT
from sklearn_mcmd.io._point_cloud import joined
from sklearn_mcmd.io._rehearsal import rehearse
from sklearn_mcmd.planes._resolution import coarse_warning, in_own_precision
from sklearn_mcmd.runtime._progress import progress_part

USUAL_NEIGHBORS = 50  # of estimators by default, where none have been given
# Begin and end of the work between reading and writing, as shares of a verb's progress.
WORKING = (0.04, 0.97)


def warn_if_coarse(cloud):
    """Warn as estimators with neighborhoods do, for a verb whose estimator has none."""
    if in_own_precision(cloud.xyz).dtype == np.float32:
        from sklearn_mcmd.planes._neighborhoods import NeighborIndex

        if coarse := coarse_warning(NeighborIndex(cloud.xyz, USUAL_NEIGHBORS)):
            warnings.warn(coarse, stacklevel=2)


def is_several(source):
    """Whether a source stands for several files."""
    return source.is_dir() or source.suffix.lower() == INDEX


def files_of(source):
    """The point files of a folder or an index, or the file itself."""
    if not is_several(source):
        return [source]
    from sklearn_mcmd.tiling._catalog import paths_of

    return paths_of(source, supported_extensions())


def read_all(source, columns=None):
    """One cloud of a file, or of all files of a folder or an index."""
    paths, clouds = files_of(source), []
    if len(paths) > 1 and all(path.suffix.lower() in TILED for path in paths):
        from sklearn_mcmd.tiling import Catalog

        Catalog(paths)  # refuses several coordinate systems
    for number, path in enumerate(paths):
        with progress_part(number / len(paths), (number + 1) / len(paths)):
            clouds.append(read(path, columns=columns))
    return joined(clouds) if len(clouds) > 1 else clouds[0]


def read(source, target=None, results=None, *, columns=None):
    """Read a cloud; first refuse a `target` that cannot be written or cannot hold `results`.

    `columns` is as of `read_points`.
    """
    if target is not None:
        rehearse(target, PointCloud(np.zeros((1, 3))))
        if results and (one := format_of(target)).results not in (ALL, results):
            raise ValueError(f"{target}: {one.name} has no place for {results}; use another format")
    with progress_part(0.0, WORKING[0], "reading"):
        cloud = read_points(source, columns=columns)
    if n_left := cloud.n_dropped - cloud.metadata.get(LEFT_OUT, 0):
        points, verb = counted(n_left, "point"), "is" if n_left == 1 else "are"
        warnings.warn(f"{source}: {points} without coordinates {verb} left out", stacklevel=2)
    return cloud


def refuse_existing(no_clobber, *targets, report=None, catalog=None):
    """Raise if an output is there that --no-clobber keeps.

    Of a `catalog`, those that an earlier run of the same target wrote before it ended may be there.
    """
    if not no_clobber:
        return
    known = set()
    if catalog is not None:
        from sklearn_mcmd.tiling._folder import WorkFolder
        from sklearn_mcmd.tiling._outputs import targets_of

        known = WorkFolder.written(targets[0])
        targets = (*targets_of(catalog, targets[0]), *targets[1:])
    if report is not None:
        from sklearn_mcmd.report._report_folder import PAGE, VIEW

        targets = (*targets, report.folder / PAGE, report.folder / VIEW)
    for path in targets:
        if os.path.lexists(path) and os.path.realpath(path) not in known:
            raise FileExistsError(f"{path}: is there already, and --no-clobber keeps it")


@contextmanager
def working(source, stage=None):
    """The work between reading and writing. Its errors name the file, if they do not yet."""
    with progress_part(*WORKING, stage):
        try:
            yield
        except Exception as err:
            if not str(err).startswith(str(source)):
                err.add_note(f"{source}: ")
            raise


def write(target, cloud, noise=None):
    with progress_part(WORKING[1], 1.0, "writing"):
        write_points(target, cloud, noise=noise)
