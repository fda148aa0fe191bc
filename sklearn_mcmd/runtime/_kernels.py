"""The decorator of compiled functions, whose cache depends on all their files.

Numba keeps compiled code for a function and checks that function's file alone. The code also
holds functions and constants of other files. If these change, or an upgrade renames them, Numba
would still take the old code, or fail to load it.
"""

from functools import cache
from hashlib import sha256
from pathlib import Path

from numba import njit

__all__ = ["kernel"]

ROOT = Path(__file__).parents[1]

is_kept = True  # whether some folder can be written


def kernel(function=None, **options):
    """Compile a function by Numba, without the interpreter's lock; see `numba.njit`.

    Python calls functions with ``cache=True``. Only compiled functions call the others. Those get
    no wrappers for calls from Python, which take time to compile: Numba would unpack each record of
    arrays in each function. None is called from C. Division by zero is as in NumPy; if functions
    differed in this, Numba would compile its own, such as `max`, for each kind.

    With `fastmath` a function becomes part of each that calls it. Else the process that compiles
    calls one form of it, and those that load the code call others, whose sums round differently.
    """
    if function is None:
        return lambda function: kernel(function, **options)
    options |= {"no_cfunc_wrapper": True, "no_cpython_wrapper": not options.get("cache")}
    options |= {"forceinline": "fastmath" in options, "cache": is_kept and "cache" in options}
    compiled = njit(nogil=True, error_model="numpy", **options)(function)
    # None where nothing is kept.
    files = getattr(getattr(compiled, "_cache", None), "_cache_file", None)
    if files is not None:
        files._source_stamp = (files._source_stamp, _stamp())
        files._load_index = _unless_damaged(files._load_index, {})
        files._load_data = _unless_damaged(files._load_data, None)
    return compiled


def _unless_damaged(read, instead):
    """Answer `instead` for a file that was cut off; Numba then compiles and writes it anew."""

    def read_or_not(*arguments):
        try:
            return read(*arguments)
        except OSError:
            raise  # Numba knows these
        except Exception:  # unpickling wrong bytes may raise anything
            return instead

    return read_or_not


@cache
def _stamp():
    """A hash of the sources of all compiled functions, and of what says how to compile them."""
    sources = [*sorted(ROOT.rglob("*_numba.py")), Path(__file__)]
    return sha256(b"".join(path.read_bytes() for path in sources)).hexdigest()
