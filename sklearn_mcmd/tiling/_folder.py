"""The folder of a run: what is done, so that a run that was ended goes on; one run at a time."""

import hashlib
import json
import os
import re
import secrets
import shutil
import socket
from contextlib import suppress
from pathlib import Path

from sklearn_mcmd.tiling._catalog import stamp_of
from sklearn_mcmd.tiling._cells import Constants
from sklearn_mcmd.tiling._stored_columns import CellColumns, in_place_of
from sklearn_mcmd.tiling._sweeps import TilingError

MANIFEST = "manifest.json"
MOVES = "moves.json"
LOCK = "lock"
STAGED = re.compile(r"\.mcmd-[0-9a-f]{16}-\d+\.la[sz]")  # names of outputs that wait
WRITTEN = ".written"  # the end of the name of an output's mark


class WorkFolder:
    """Temporary files of a run, beside its output.

    The manifest is written when all points are in their cells. Its key tells whether what lies
    there was made of the same inputs, with the same parameters. What was not is removed.
    A lock keeps other runs out until it is released, or the folder is removed. With a key of None
    nothing is removed.
    """

    def __init__(self, target, key):
        self.path = self.path_of(target)
        self.cells, self.results = self.path / "cells", self.path / "results"
        self.key = key
        self._lock = Lock(self.path / LOCK)
        self._manifest, self.moves = self.path / MANIFEST, self.path / MOVES
        if self.path.exists() and not (read_json(self._manifest) or self._is_ours()):
            raise FileExistsError(
                f"{self.path} is in the way: it is where temporary files would be; move it"
            )
        self.path.mkdir(exist_ok=True)
        self._lock.acquire()
        try:
            if key is not None and read_json(self._manifest).get("key") != key:
                self.clear()
        except BaseException:
            self.release()
            raise

    @staticmethod
    def path_of(target):
        return Path(f"{os.path.realpath(target)}.tiles")

    @classmethod
    def written(cls, target):
        """Real paths of outputs that a run wrote before it ended, and nobody changed since."""
        marks = map(read_json, cls.path_of(target).glob(f"*{WRITTEN}"))
        return {m["path"] for m in marks if m and m == _mark(m["path"], m["content"])}

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

    def staged(self, i, target):
        """Where the i-th output waits if it may not replace its input before all are written."""
        target = Path(os.path.realpath(target))
        return target.with_name(f".mcmd-{self.key[:16]}-{i}{target.suffix.lower()}")

    def is_written(self, i, path, content):
        """Whether the i-th output was written before, with this content, and is there."""
        mark = read_json(self.path / f"{i}{WRITTEN}")
        return mark == _mark(path, content) and mark["stamp"] is not None

    def mark_written(self, i, path, content):
        write_json(self.path / f"{i}{WRITTEN}", _mark(path, content))

    def release(self):
        """Let other runs in."""
        self._lock.release()

    def remove(self):
        """Remove the folder, and outputs that wait; the list of moves last."""
        self._empty()
        self.release()
        with suppress(OSError):  # another run may have begun
            self.path.rmdir()

    def clear(self):
        """Begin anew."""
        self._empty()
        self.cells.mkdir(parents=True)
        self.results.mkdir()

    def _empty(self):
        self._manifest.unlink(missing_ok=True)  # first: it says that the cells are there
        for file in self.path.glob(f"*{WRITTEN}"):
            path = Path(read_json(file).get("path", ""))
            if STAGED.fullmatch(path.name):
                path.unlink(missing_ok=True)
        for folder in (self.cells, self.results):
            shutil.rmtree(folder, ignore_errors=True)
        for file in self.path.glob("*"):
            if file not in (self.moves, self._lock.path) and not file.is_dir():
                file.unlink(missing_ok=True)
        self.moves.unlink(missing_ok=True)

    def _is_ours(self):
        """Of a run that ended before its manifest, or while it was removed; or an empty folder."""
        ours = re.compile(rf"cells|results|({LOCK}|{MANIFEST}|{MOVES}|\d+{WRITTEN})(\..*)?")
        return all(ours.fullmatch(entry.name) for entry in self.path.iterdir())


class Lock:
    """A file that names the process that works in a folder."""

    def __init__(self, path):
        self.path = path
        self.is_held = False

    def acquire(self):
        """Take the lock, or raise TilingError with a message that names it."""
        owner, host = self._owner(), socket.gethostname()
        if owner and owner["host"] == host and not _lives(owner["pid"]):
            self.path.unlink(missing_ok=True)
        try:
            self._take(json.dumps({"host": host, "pid": os.getpid()}))
        except FileExistsError:
            owner = self._owner() or {"host": "an unknown machine", "pid": "?"}
            raise TilingError(
                f"{self.path}: another run works on this output (process {owner['pid']} on "
                f"{owner['host']}); wait for it, or remove this file if it is no more"
            ) from None
        self.is_held = True

    def release(self):
        if self.is_held:
            self.path.unlink(missing_ok=True)
            self.is_held = False

    def _take(self, content):
        """Make the file appear with its content: a kill leaves none that names nobody."""
        temporary = self.path.with_name(f"{self.path.name}.{secrets.token_hex(4)}.part")
        try:
            temporary.write_text(content)
            try:
                os.link(temporary, self.path)
            except FileExistsError:
                raise
            except OSError:  # a disk that has no links
                with open(self.path, "x") as file:
                    file.write(content)
        finally:
            temporary.unlink(missing_ok=True)

    def _owner(self):
        try:
            owner = json.loads(self.path.read_text())
            return {"host": owner["host"], "pid": int(owner["pid"])}
        except Exception:  # of a file that is not there, or damaged
            return {}


def _lives(pid):
    """Whether a process of this machine is at work, or cannot be asked."""
    if os.name == "nt":  # where the question would end it
        return True
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):
        return True
    return True


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


def _mark(path, content):
    """What is remembered of an output: where it is, what it holds, and its stamp."""
    path = Path(os.path.realpath(path))
    stamp = list(stamp_of(path)) if path.exists() else None
    return {"path": str(path), "content": content, "stamp": stamp}
