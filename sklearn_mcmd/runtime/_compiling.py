"""Compiled functions, imported on first use: so importing the package does not import Numba."""

import os
import stat
import tempfile
from contextlib import suppress
from importlib import import_module

from sklearn_mcmd._errors import warn_caller
from sklearn_mcmd.runtime import _progress


def compiled_function(module, name):
    """A function that Numba compiles, from a module such as "planes._local_planes_numba"."""
    try:
        return _load(module, name)
    except RuntimeError:  # Numba found no folder to write compiled code to
        import numba

        from sklearn_mcmd.runtime import _kernels

        numba.config.CACHE_DIR = _own_folder()
        how = f"kept in {numba.config.CACHE_DIR}, until temporary files are removed"
        if not numba.config.CACHE_DIR:
            _kernels.is_kept, how = False, "each time: no folder can keep it"
            warn_caller(
                "Compiled code cannot be kept, so each run compiles anew, for half a minute: no "
                "folder for it can be written. Set the environment variable NUMBA_CACHE_DIR to one."
            )
        _progress.COMPILING = f"compiling for this computer ({how})"
        return _load(module, name)


def _own_folder():
    """A temporary folder, or "", to which no other user can write: what lies there is run."""
    user = os.getuid() if hasattr(os, "getuid") else ""  # Windows has a folder for each user
    with suppress(OSError):
        path = os.path.join(tempfile.gettempdir(), f"sklearn_mcmd-{user}")
        os.makedirs(path, mode=0o700, exist_ok=True)
        status = os.lstat(path)
        is_ours = stat.S_ISDIR(status.st_mode) and user in ("", status.st_uid)
        if is_ours and os.access(path, os.W_OK) and (user == "" or not status.st_mode & 0o022):
            return path
    with suppress(OSError):
        return tempfile.mkdtemp(prefix="sklearn_mcmd-")
    return ""


def _load(module, name):
    function = getattr(import_module(f"sklearn_mcmd.{module}"), name)
    _progress.watch_compilation()
    return function
