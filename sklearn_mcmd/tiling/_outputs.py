"""Outputs of a run: where they go, and their writing in the order of the inputs."""

import os

from sklearn_mcmd._errors import warn_caller
from sklearn_mcmd.io import PointFileError
from sklearn_mcmd.io._files import check_writable, one_clear_line, replacing
from sklearn_mcmd.io._formats import TILED, format_of, listed, supported_extensions
from sklearn_mcmd.io._las import writing_parts
from sklearn_mcmd.io._las_joined import joined_cloud, joined_header
from sklearn_mcmd.io._las_parts import read_parts
from sklearn_mcmd.runtime._progress import tell_share
from sklearn_mcmd.tiling._catalog import stamp_of
from sklearn_mcmd.tiling._memory import PART
from sklearn_mcmd.tiling._publish_outputs import places_of

__all__ = ["targets_of", "write_outputs"]

LAS_OR_LAZ = listed(TILED, "or")


def targets_of(catalog, target):
    """The output of each input, or one for all of several inputs.

    The target is a folder if there may be several inputs and its name is not that of a LAS or LAZ
    file.
    """
    named_as_file = target.suffix.lower() in TILED and not target.is_dir()
    as_folder = catalog.is_many and not named_as_file
    if as_folder and target.suffix.lower() in supported_extensions() and not target.exists():
        raise PointFileError(
            f"{target}: several files become a folder, or one {LAS_OR_LAZ}; {target.suffix} is no "
            "name for either"
        )
    if not as_folder:
        targets = [target]
        if len(catalog) > 1:
            if os.path.realpath(target) in map(os.path.realpath, catalog.paths):
                raise PointFileError(f"{target}: is one of the inputs; name another file")
            joined_header(catalog.paths)
    else:
        if target.exists() and not target.is_dir():
            raise PointFileError(
                f"{target}: several outputs need a folder; to join them in one file, name a "
                f"{LAS_OR_LAZ}"
            )
        names = [path.name.replace(".copc.", ".") for path in catalog.paths]
        for path, name in zip(catalog.paths, names, strict=True):
            if names.count(name) > 1:
                raise PointFileError(
                    f"{path}: several files have this name, and so would the outputs; to join them "
                    f"in one file, name a {LAS_OR_LAZ}"
                )
        targets = [target / name for name in names]
    for path in targets:
        folder = target.parent if as_folder and not target.exists() else path.parent
        check_writable(path, folder)
        if path.suffix.lower() not in TILED:
            raise PointFileError(f"{path}: clouds beyond memory are written as {LAS_OR_LAZ} only")
        with one_clear_line(path, "written"):
            format_of(path, written=True)
        if not os.access(folder, os.W_OK):
            raise PointFileError(f"{path}: cannot be written; {folder} is write-protected")
    return targets


def write_outputs(run, verb, results):
    """Write each output in the order of its inputs; returns the sum of what `Verb.measure` tells.

    Points that the verb's choice does not take have no `Results`: NaN.
    """
    catalog, targets, choice = run.catalog, run.targets, verb.choice
    first, total = 0, 0.0
    joined = len(targets) < len(catalog)
    header = joined_header(catalog.paths) if joined else None
    everything = range(len(catalog))
    for i, place in enumerate(places_of(catalog, targets, run.folder)):
        inputs = everything if joined else [i]
        if run.folder.is_written(i, place, verb.content):
            n = sum(catalog.counts[j] for j in inputs)
            for start in range(first, first + n, PART):
                values = results.take(start, min(PART, first + n - start), choice is None)
                total += verb.measure(values)
            first += n
            continue
        for j in inputs:
            with one_clear_line(catalog.paths[j], "read"):
                if stamp_of(catalog.paths[j]) != catalog.stamps[j]:
                    raise PointFileError("has changed since it was read")
        n_written = 0
        with replacing(place) as temporary, writing_parts(temporary) as write:
            for path in (catalog.paths[j] for j in inputs):
                for cloud in read_parts(path, PART):
                    xyz, chosen = cloud.xyz, None if choice is None else choice.of(cloud)
                    if joined:
                        with one_clear_line(path, "read"):
                            cloud = joined_cloud(cloud, header)
                    values = results.take(first, len(cloud), True if chosen is None else chosen)
                    total += verb.measure(values)
                    made, marked = verb.make(cloud, values, xyz)
                    write(made, marked)
                    n_written += len(made)
                    first += len(cloud)
                    tell_share(first / catalog.n_points)
        run.folder.mark_written(i, place, verb.content)
        if n_written == 0:
            warn_caller(f"{targets[i]}: all points are outliers, so the file has none")
    return total
