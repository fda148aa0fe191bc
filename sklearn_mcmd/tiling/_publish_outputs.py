"""Outputs that replace their inputs: all are written first, then moved, and a run may end between.

The inputs are one cloud. If one was replaced and another not, nobody could judge them again. So a
run that ended while outputs were moved has only to move the others.
"""

import os
import shutil
from pathlib import Path

from sklearn_mcmd.tiling._catalog import stamp_of
from sklearn_mcmd.tiling._folder import key_of, read_json, write_json
from sklearn_mcmd.tiling._sweeps import TilingError

__all__ = ["move_outputs", "places_of", "resume_moves"]


def places_of(catalog, targets, folder):
    """Where outputs are written: to their targets, or beside them if they replace inputs."""
    inputs = set(map(os.path.realpath, catalog.paths))
    if not any(os.path.realpath(target) in inputs for target in targets):
        return targets
    return [folder.staged(i, target) for i, target in enumerate(targets)]


def move_outputs(verb, catalog, targets, folder, report):
    """Move all outputs that wait; a report is kept for a run that has only to move them."""
    places = places_of(catalog, targets, folder)
    if places is targets:
        return
    moves = [
        [str(place), os.path.realpath(target), list(stamp_of(place))]
        for place, target in zip(places, targets, strict=True)
    ]
    # Files without points, which no run can read again, come last.
    moves.sort(key=lambda move: -move[2][0])
    inputs, key = [list(stamp) for stamp in catalog.stamps], _key(verb, catalog, targets)
    told = {"key": key, "inputs": inputs, "moves": moves, "report": report}
    write_json(folder.moves, told)  # a run that ends now has only to move them
    _move(moves)


def resume_moves(verb, catalog, targets, folder):
    """The report of an earlier run of which outputs were to be moved, now that they are.

    None if there is none. False if there is another, and some inputs were replaced.
    """
    stored = read_json(folder.moves)
    if not stored:
        if folder.moves.exists():
            raise TilingError(
                f"{folder.moves}: is damaged, and some inputs may be replaced; begin anew with "
                "files as they are (restart)"
            )
        return None
    if stored["key"] == _key(verb, catalog, targets) and _fits(stored, catalog):
        _move(stored["moves"])
        return stored["report"]
    if any(_is_there(target, stamp) for _, target, stamp in stored["moves"]):
        return False
    folder.moves.unlink(missing_ok=True)
    return None


def _key(verb, catalog, targets):
    """A hash of what outputs depend on, besides the inputs' stamps."""
    paths = [os.path.realpath(path) for path in (*catalog.paths, *targets)]
    return key_of(verb.estimator, paths, verb.content, verb.sensor and verb.sensor.key)


def _fits(stored, catalog):
    """Whether inputs are as they were, or replaced, and all outputs are there."""
    moved = {target: stamp for _, target, stamp in stored["moves"]}
    paths = zip(catalog.paths, stored["inputs"], strict=True)
    return all(
        _is_there(path, stamp) or _is_there(path, moved.get(os.path.realpath(path)))
        for path, stamp in paths
    ) and all(
        _is_there(place, stamp) or _is_there(target, stamp)
        for place, target, stamp in stored["moves"]
    )


def _move(moves):
    for place, target, _ in moves:
        if Path(place).exists():
            if Path(target).exists():
                shutil.copymode(target, place)
            os.replace(place, target)


def _is_there(path, stamp):
    path = Path(path)
    return path.exists() and list(stamp_of(path)) == stamp
