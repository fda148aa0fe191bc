"""Trial writing, so that its errors appear before long work."""

import os
import shutil
import warnings
from contextlib import contextmanager

from sklearn_mcmd.io._files import check_writable, naming, one_clear_line, write_points
from sklearn_mcmd.io._formats import TILED
from sklearn_mcmd.io._grid import scale_of


def rehearse(target, cloud, noise=None, *, whole=True):
    """Write one point beside `target`; `whole` says that all points will be written."""
    if whole and target.suffix.lower() in TILED and "las_header" not in cloud.metadata:
        with one_clear_line(target, "written"):
            scale_of(cloud.xyz)
    first = cloud.subset(slice(0, 1))
    with standing_in(target) as stand_in:
        write_points(stand_in, first, noise=None if noise is None else noise[:1])


@contextmanager
def standing_in(target):
    """A path beside `target` for trial writing; errors name `target` itself."""
    real = check_writable(target)
    with naming(target), trial_folder(real.parent) as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the real writing will give them
        stand_in = folder / target.name
        try:
            yield stand_in
        except ValueError as err:
            raise ValueError(str(err).replace(str(stand_in), str(target))) from err


@contextmanager
def trial_folder(above):
    """A folder that is removed, even if Ctrl-C comes while it is made or removed."""
    folder = above / f".mcmd-{os.urandom(8).hex()}"
    try:
        folder.mkdir(mode=0o700)
        yield folder
    finally:
        try:
            shutil.rmtree(folder, ignore_errors=True)
        except KeyboardInterrupt:
            shutil.rmtree(folder, ignore_errors=True)
            raise
