"""Outputs of a run: where they go, their writing in the order of the inputs, and their moves.

Outputs are all written in the folder of the run, then moved, and a run may end between. They may
replace the inputs, which are one cloud: if one was replaced and another not, nobody could judge
them again. So a run that ended while outputs were moved has only to move the others.
"""

import os
import shutil
from pathlib import Path

from sklearn_mcmd._errors import warn_caller
from sklearn_mcmd.io import PointFileError
from sklearn_mcmd.io._files import check_writable, one_clear_line, replacing, sync_names
from sklearn_mcmd.io._formats import TILED, format_of, listed, supported_extensions
from sklearn_mcmd.io._las import writing_parts
from sklearn_mcmd.runtime._progress import report_share
from sklearn_mcmd.tiling._catalog import check_unchanged, parts_of, stamp_of
from sklearn_mcmd.tiling._folder import TilingError, key_of, read_json, write_json

LAS_OR_LAZ = listed(TILED, "or")


def targets_of(catalog, target, others=(), also=()):
    """The output of each input; raises if these, or other files, cannot be written, or are of
    catalogs that are read beside."""
    targets = _names_in(target, catalog) if catalog.is_many else [target]
    new = os.path.realpath(target) if catalog.is_many and not target.exists() else None
    kept = {os.path.realpath(path) for one in also for path in one.paths}
    for path in [*targets, *others]:
        if os.path.realpath(path) in kept:
            raise PointFileError(f"{path}: is of the second cloud, whose points the output lacks")
        folder = target.parent if os.path.realpath(path.parent) == new else path.parent
        check_writable(path, folder)
        if not os.access(folder, os.W_OK):
            raise PointFileError(f"{path}: cannot be written; {folder} is write-protected")
    for path in targets:
        if path.suffix.lower() not in TILED:
            raise PointFileError(f"{path}: clouds beyond memory are written as {LAS_OR_LAZ} only")
        with one_clear_line(path, "written"):
            format_of(path, written=True)
    return targets


def _names_in(folder, catalog):
    """The outputs in a folder, which have the names of the inputs."""
    if folder.suffix.lower() in supported_extensions() and not folder.exists():
        raise PointFileError(
            f"{folder}: several files become a folder, and {folder.suffix} is no name for it"
        )
    if folder.exists() and not folder.is_dir():
        raise PointFileError(f"{folder}: several outputs need a folder")
    names = [path.name.replace(".copc.", ".") for path in catalog.paths]
    for path, name in zip(catalog.paths, names, strict=True):
        if names.count(name) > 1:
            raise PointFileError(f"{path}: several files have this name, and so would the outputs")
    return [folder / name for name in names]


def write_outputs(run, verb):
    """Write each output in the order of its inputs; returns the sum of what the verb measures."""
    catalog, results, first, total = run.catalog, verb.results(run), 0, 0.0
    inputs = zip(catalog.paths, catalog.stamps, strict=True)
    for (path, stamp), (place, target) in zip(inputs, run.outputs, strict=True):
        n_written = 0
        check_unchanged(path, stamp)
        with replacing(place) as temporary, writing_parts(temporary) as write:
            for n, measured, made, marked in _made(verb, results, path, first):
                write(made, marked)
                first, total = first + n, total + measured
                n_written += len(made)
                report_share(first / catalog.n_points)
        if n_written == 0:
            warn_caller(f"{target}: all points are outliers, so the file has none")
    return total


def _made(verb, results, path, first):
    """Of each part of a file, from the row `first` on: points, what is measured, what to write."""
    for _, cloud, chosen in parts_of([path], verb.choice):
        values = results.take(first, len(cloud), len(cloud.xyz[chosen]))
        first += len(cloud)
        yield len(cloud), verb.measure(values), *verb.make(cloud, values, cloud.xyz)


def move_outputs(verb, run, folder, report):
    """Move all outputs; a report is kept for a run that has only to move them."""
    catalog = run.catalog
    moves = [
        [str(place), os.path.realpath(target), list(stamp_of(place))]
        for place, target in [*run.outputs, *run.others]
    ]
    # Files without points, which no run can read again, come last.
    moves.sort(key=lambda move: -move[2][0])
    stored = {
        "key": _key_of_moves(verb, catalog, [target for _, target in run.outputs]),
        "paths": list(map(os.path.realpath, catalog.paths)),
        "stamps": [list(stamp) for stamp in catalog.stamps],
        "moves": moves,
        "report": report,
    }
    write_json(folder.moves, stored)  # a run that ends after this has only to move them
    _move(moves)


def resume_moves(verb, catalog, targets, folder):
    """Move the outputs of an earlier run that ended amid that; returns its report, or None."""
    stored = read_json(folder.moves)
    if not stored:
        if folder.moves.exists():
            raise TilingError(
                f"{folder.moves}: is damaged, and some inputs may be replaced; begin anew with "
                "files as they are (restart)"
            )
        return None
    if stored["key"] == _key_of_moves(verb, catalog, targets) and _fits(stored):
        _move(stored["moves"])
        return stored["report"]
    replaced = (move for move in stored["moves"] if move[1] in stored["paths"])
    if any(_is_there(target, stamp) for _, target, stamp in replaced):
        raise TilingError(
            f"{folder.moves}: an earlier run ended when it had replaced some of its inputs; give "
            "its command again, or begin anew with files as they are (restart)"
        )
    folder.moves.unlink(missing_ok=True)
    return None


def _key_of_moves(verb, catalog, targets):
    """Inputs may be replaced, and what is read beside them is as it was."""
    return key_of(verb, [*catalog.paths, *targets], [one.stamps for one in verb.also])


def _fits(stored):
    """Whether inputs are as they were, or replaced, and all outputs are there."""
    moved = {target: stamp for _, target, stamp in stored["moves"]}
    paths = zip(stored["paths"], stored["stamps"], strict=True)
    return all(
        _is_there(path, stamp) or _is_there(path, moved.get(path)) for path, stamp in paths
    ) and all(
        _is_there(place, stamp) or _is_there(target, stamp)
        for place, target, stamp in stored["moves"]
    )


def _move(moves):
    for place, target, _ in moves:
        if not Path(place).exists():
            continue
        Path(target).parent.mkdir(exist_ok=True)
        if Path(target).exists():
            shutil.copymode(target, place)
        try:
            os.replace(place, target)
            sync_names(Path(target).parent)
        except OSError:  # a link leads to another disk
            with replacing(target) as temporary:
                shutil.copy2(place, temporary)  # with the times, which tell that it is this one
            os.unlink(place)


def _is_there(path, stamp):
    path = Path(path)
    return path.exists() and list(stamp_of(path)) == stamp
