"""Compiled functions, imported on first use: so importing the package does not import Numba."""

import os
import stat
import tempfile
from importlib import import_module

from sklearn_mcmd.runtime._progress import watch_compilation

__all__ = ["compiled_function"]


def compiled_function(module, name):
    """A function that Numba compiles, from a module such as "planes._local_planes_numba"."""
    try:
        return _load(module, name)
    except RuntimeError:  # Numba found no folder to write compiled code to
        import numba

        numba.config.CACHE_DIR = _own_folder()
        return _load(module, name)


def _own_folder():
    """A temporary folder to which no other user can write: what lies there is run as code."""
    user = os.getuid() if hasattr(os, "getuid") else ""  # Windows has a folder for each user
    path = os.path.join(tempfile.gettempdir(), f"sklearn_mcmd-{user}")
    try:
        os.makedirs(path, mode=0o700, exist_ok=True)
        status = os.lstat(path)
        own = stat.S_ISDIR(status.st_mode) and user in ("", status.st_uid)
        if own and os.access(path, os.W_OK) and (user == "" or not status.st_mode & 0o022):
            return path
    except OSError:
        pass
    return tempfile.mkdtemp(prefix="sklearn_mcmd-")


def _load(module, name):
    function = getattr(import_module(f"sklearn_mcmd.{module}"), name)
    watch_compilation()
    return function
