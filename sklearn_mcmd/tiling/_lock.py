"""One run at a time in a folder."""

import json
import os
import socket

from sklearn_mcmd.tiling._workers import TilingError

__all__ = ["Lock"]


class Lock:
    """A file that tells which process works in a folder.

    What a process has left that is no more, on this machine, is taken over.

    Parameters
    ----------
    path : Path
    """

    def __init__(self, path):
        self.path = path
        self.is_held = False

    def acquire(self):
        """Take the lock, or raise TilingError with a message that names it."""
        for _ in range(2):
            try:
                handle = os.open(self.path, os.O_CREAT | os.O_EXCL | os.O_WRONLY)
            except FileExistsError:
                owner = self._owner()
                if owner and owner["host"] == socket.gethostname() and not _lives(owner["pid"]):
                    self.path.unlink(missing_ok=True)
                    continue
                break
            with open(handle, "w") as file:
                json.dump({"host": socket.gethostname(), "pid": os.getpid()}, file)
            self.is_held = True
            return
        owner = self._owner() or {"host": "an unknown machine", "pid": "?"}
        raise TilingError(
            f"{self.path}: another run works on this output (process {owner['pid']} on "
            f"{owner['host']}); wait for it, or remove this file if it is no more"
        )

    def release(self):
        if self.is_held:
            self.path.unlink(missing_ok=True)
            self.is_held = False

    def _owner(self):
        try:
            return json.loads(self.path.read_text())
        except (OSError, ValueError):
            return {}


def _lives(pid):
    """Whether a process of this machine is at work; it is said to be where one cannot ask."""
    if os.name == "nt":  # where the question would end it
        return True
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except OSError:
        return True
    return True
