"""The decorator of compiled functions, whose cache knows of all of them.

Numba keeps compiled code beside the file of a function and looks at that file alone. A function or
a constant of another file that is compiled into it could change, or be renamed by an upgrade, and
the old code would still be taken, or fail to load.
"""

from functools import cache
from hashlib import sha256
from pathlib import Path

from numba import njit

__all__ = ["kernel"]

ROOT = Path(__file__).parents[1]


def kernel(function=None, **options):
    """Compile a function by Numba, without the interpreter's lock; see `numba.njit`."""
    if function is None:
        return lambda function: kernel(function, **options)
    compiled = njit(nogil=True, **options)(function)
    files = getattr(
        getattr(compiled, "_cache", None), "_cache_file", None
    )  # None where nothing is kept
    if files is not None:
        files._source_stamp = (files._source_stamp, _stamp())
    return compiled


@cache
def _stamp():
    """What tells one version of all compiled functions from another."""
    sources = sorted(ROOT.rglob("*_numba.py"))
    return sha256(b"".join(path.read_bytes() for path in sources)).hexdigest()
