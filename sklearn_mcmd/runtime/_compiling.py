"""Compiled functions, imported on first use: so importing the package does not import Numba."""

from importlib import import_module

from sklearn_mcmd._errors import warn_caller
from sklearn_mcmd.runtime import _progress


def compiled_function(module, name):
    """A function that Numba compiles, from a module such as "planes._local_planes_numba"."""
    try:
        return _load(module, name)
    except RuntimeError as err:
        if "cannot cache" not in str(err):  # where Numba finds no folder to write compiled code to
            raise
        from sklearn_mcmd.runtime import _kernels

        _kernels.is_kept = False
        _progress.COMPILING = "compiling for this computer (each time: no folder can keep it)"
        warn_caller(
            "Compiled code cannot be kept, so each run compiles anew, for half a minute: no "
            "folder for it can be written. Set the environment variable NUMBA_CACHE_DIR to one."
        )
        return _load(module, name)


def _load(module, name):
    function = getattr(import_module(f"sklearn_mcmd.{module}"), name)
    _progress.watch_compilation()
    return function
