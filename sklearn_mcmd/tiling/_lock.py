"""One run at a time in a folder."""

import json
import os
import secrets
import socket

from sklearn_mcmd.tiling._sweeps import TilingError

__all__ = ["Lock"]


class Lock:
    """A file that tells which process works in a folder.

    What a process has left that is no more, on this machine, is taken over.
    """

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
        """Let the file appear with its content, so that no kill leaves one that tells of nobody."""
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
    """Whether a process of this machine is at work; it is said to be where one cannot ask."""
    if os.name == "nt":  # where the question would end it
        return True
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):
        return True
    return True
