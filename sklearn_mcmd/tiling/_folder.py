"""The folder of a run: what is done, so that a run that was ended goes on; one run at a time."""

import hashlib
import json
import os
import re
import shutil
import sys
from contextlib import ExitStack, suppress
from errno import EACCES, EAGAIN
from pathlib import Path

from sklearn_mcmd._errors import warn_caller
from sklearn_mcmd.tiling._cells import Constants
from sklearn_mcmd.tiling._stored_columns import CellColumns, in_place_of
from sklearn_mcmd.tiling._sweeps import TILES, TilingError, lock_of_tiles

MANIFEST = "manifest.json"
MOVES = "moves.json"
LOCK = "lock"
OURS = re.compile(rf"cells|rays|results|outputs|({LOCK}|{MANIFEST}|{MOVES})(\..*)?")  # names in it


class WorkFolder:
    """Temporary files of a run, beside its output.

    A lock keeps other runs out until it is released, or the process ends. The manifest is written
    when all points are in their cells.
    """

    def __init__(self, target):
        self.path, self.key = self.path_of(target), None
        names = "cells", "results", "outputs", "rays"
        self._folders = [self.path / name for name in names]
        self.cells, self.results, self.outputs, _ = self._folders
        self._manifest, self.moves = self.path / MANIFEST, self.path / MOVES
        # What a run left that ended before its manifest, or while it was removed, is ours, too.
        if self.path.exists() and not (
            read_json(self._manifest) or all(OURS.fullmatch(e.name) for e in self.path.iterdir())
        ):
            raise FileExistsError(
                f"{self.path} is in the way: it is where temporary files would be; move it"
            )
        self.path.mkdir(exist_ok=True)
        self._lock = _locked(self.path / LOCK)

    def begin(self, key, anew=False):
        """Begin or go on; what lies there is removed if it was made with another key, or anew.

        A key tells of inputs and parameters.
        """
        self.key = key
        with lock_of_tiles(self.path, alone=True):
            pass
        if anew or read_json(self._manifest).get("key") != key:
            self._empty()
            for folder in self._folders:
                folder.mkdir()

    @staticmethod
    def path_of(target):
        return Path(f"{os.path.realpath(target)}.tiles")

    @property
    def constants(self):
        """The constants of the whole cloud, or None if not all points are in cells."""
        stored = read_json(self._manifest)
        return Constants(**stored["constants"]) if stored else None

    @property
    def columns(self):
        """The columns of all places."""
        return CellColumns(self.results)

    def finish_cells(self, constants):
        """Remember that all points are in cells."""
        write_json(self._manifest, {"key": self.key, "constants": constants._asdict()})

    def release(self):
        """Let other runs in."""
        self._lock.close()

    def remove(self):
        """Remove the folder; the list of moves last."""
        self._empty()
        if os.name == "nt":  # where open files cannot be removed
            self.release()
        with suppress(OSError):  # another run may have begun
            (self.path / TILES).unlink(missing_ok=True)
            (self.path / LOCK).unlink()
            self.path.rmdir()
        self.release()

    def _empty(self):
        self._manifest.unlink(missing_ok=True)  # first: it says that the cells are there
        for folder in self._folders:
            shutil.rmtree(folder, ignore_errors=True)
        for file in self.path.glob("*.part"):
            file.unlink(missing_ok=True)
        self.moves.unlink(missing_ok=True)


def _locked(path):
    """A file that is open and locked, until it is closed or the process ends."""
    with suppress(BlockingIOError, FileNotFoundError), ExitStack() as opened:
        file = opened.enter_context(open(path, "w"))
        try:
            if sys.platform == "win32":
                import msvcrt

                msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
            else:
                import fcntl

                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as err:
            if err.errno in (EACCES, EAGAIN):
                raise BlockingIOError from err
            warn_caller(f"{path}: this disk has no locks; begin no other run with this output")
        if os.path.samestat(os.fstat(file.fileno()), path.stat()):  # else it was just removed
            opened.pop_all()
            return file
    raise TilingError(f"{path}: another run works on this output; wait for it")


def read_json(path):
    """What `write_json` has written; nothing if the file is not as it was, or not there."""
    try:
        digest, _, content = path.read_text().partition("\n")
        return json.loads(content) if digest == _digest(content) else {}
    except (OSError, ValueError):
        return {}


def write_json(path, content):
    content = json.dumps(content)
    with in_place_of(path) as temporary:
        temporary.write_text(f"{_digest(content)}\n{content}")


def key_of(estimator, *known):
    """A hash of an estimator and all else that results depend on."""
    from sklearn_mcmd import __version__

    params = sorted(estimator.get_params().items())
    return _digest(repr((__version__, type(estimator).__name__, params, *known)))


def _digest(content):
    return hashlib.sha256(content.encode()).hexdigest()
