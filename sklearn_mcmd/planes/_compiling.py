"""Compiled functions, imported on first use and only where Numba can be imported."""

import os
import tempfile
from importlib import import_module

from sklearn_mcmd.planes._progress import watch_compilation

__all__ = ["compiled_function"]


def compiled_function(module, name):
    """A function of this package that Numba compiles; None where Numba cannot be imported.

    Parameters
    ----------
    module : str
        Such as "planes._local_planes_numba".
    name : str
    """
    try:
        return _load(module, name)
    except ImportError:
        return None
    except RuntimeError:  # Numba found no folder to write compiled code to
        import numba

        numba.config.CACHE_DIR = os.path.join(tempfile.gettempdir(), "sklearn_mcmd")
        return _load(module, name)


def _load(module, name):
    function = getattr(import_module(f"sklearn_mcmd.{module}"), name)
    watch_compilation()
    return function
