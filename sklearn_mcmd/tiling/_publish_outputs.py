"""Outputs that replace their inputs: all are written first, then moved, and a run may end between.

The inputs are one cloud. If one was replaced and another not, nobody could judge them again. So a
run that ended while outputs were moved has only to move the others.
"""

import hashlib
import os
import shutil
from pathlib import Path

from sklearn_mcmd.tiling._catalog import stamp_of

__all__ = ["Moves", "is_in_place", "places_of"]


def is_in_place(catalog, targets):
    """Whether an output replaces an input."""
    inputs = set(map(os.path.realpath, catalog.paths))
    return any(os.path.realpath(target) in inputs for target in targets)


def places_of(catalog, targets, folder):
    """Where outputs are written: to their targets, or beside them if they replace inputs."""
    if not is_in_place(catalog, targets):
        return targets
    return [folder.staged(i, target) for i, target in enumerate(targets)]


class Moves:
    """What is left to do when all outputs are written.

    Parameters
    ----------
    folder : WorkFolder
    catalog : Catalog
    targets : list of Path
    estimator : estimator
    content : str
        What tells apart outputs of one estimator.
    version : str
    """

    def __init__(self, folder, catalog, targets, estimator, content, version):
        self.folder, self.catalog, self.targets = folder, catalog, targets
        self.key = _key(catalog, targets, estimator, content, version)

    def finish(self, report):
        """Move all outputs; a report is kept for a run that has only to move them."""
        if not is_in_place(self.catalog, self.targets):
            return
        moves = []
        for i, target in enumerate(self.targets):
            place = self.folder.staged(i, target)
            moves.append([str(place), os.path.realpath(target), list(stamp_of(place))])
        # Files without points, which no run can read again, come last.
        moves.sort(key=lambda move: -move[2][0])
        inputs = [list(stamp) for stamp in self.catalog.stamps]
        self.folder.finish_outputs(key=self.key, inputs=inputs, moves=moves, report=report)
        _move(moves)

    def resume(self):
        """The report of an earlier run of which outputs were to be moved, now that they are.

        None if there is none. False if there is another, and some inputs were replaced.
        """
        stored = self.folder.moves()
        if not stored:
            return None
        if stored["key"] == self.key and self._fits(stored):
            _move(stored["moves"])
            return stored["report"]
        if any(_is_there(target, stamp) for _, target, stamp in stored["moves"]):
            return False
        self.folder.forget_moves()
        return None

    def _fits(self, stored):
        """Whether inputs are as they were, or replaced, and all outputs are there."""
        moved = {target: stamp for _, target, stamp in stored["moves"]}
        paths = zip(self.catalog.paths, stored["inputs"], strict=True)
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


def _key(catalog, targets, estimator, content, version):
    """A hash of what outputs depend on, besides the inputs' stamps."""
    paths = [os.path.realpath(path) for path in (*catalog.paths, *targets)]
    params = sorted(estimator.get_params().items())
    text = repr((version, type(estimator).__name__, params, paths, content))
    return hashlib.sha256(text.encode()).hexdigest()
