"""The decorator of compiled functions, whose cache depends on all their files.

Numba keeps compiled code of a function, and checks the content of that function's file alone. The
code also holds functions and constants of other files. If these change, or an upgrade renames them,
Numba would still take the old code, or fail to load it.
"""

from functools import cache, partial
from hashlib import sha256
from pathlib import Path

from numba import njit
from numba.core.options import DefaultOptions

ROOT = Path(__file__).parents[1]
# Numba counts references to arrays whenever a function takes a record of them or a row, by
# instructions that lock memory: a third of the time of asking neighbors. What allocates nothing
# needs no counts.
UNCOUNTED = {"_nrt": False} if hasattr(DefaultOptions, "_nrt") else {}

is_kept = True  # whether some folder can be written


def kernel(function=None, *, allocates=False, **options):
    """Compile a function by Numba, without the interpreter's lock; see `numba.njit`.

    Python calls functions with ``cache=True``. Only compiled functions call the others. Those get
    no wrappers for calls from Python, which take time to compile: Numba would unpack each record of
    arrays in each function. None is called from C. Division by zero is as in NumPy; if functions
    differed in this, Numba would compile its own, such as `max`, for each kind.

    Python makes the arrays. What makes some itself, or lists, says that it `allocates`.

    With `fastmath` a function becomes part of each that calls it. Else the process that compiles
    calls one form of it, and those that load the code call others, whose sums round differently.
    """
    if function is None:
        return lambda function: kernel(function, allocates=allocates, **options)
    options |= {} if allocates else UNCOUNTED
    options |= {"no_cfunc_wrapper": True, "no_cpython_wrapper": not options.get("cache")}
    options |= {"forceinline": "fastmath" in options, "cache": is_kept and "cache" in options}
    compiled = njit(nogil=True, error_model="numpy", **options)(function)
    kept = getattr(compiled, "_cache", None)  # a plain function with NUMBA_DISABLE_JIT=1
    if kept is not None and hasattr(kept, "_cache_file"):  # not where nothing is kept
        kept._cache_file._source_stamp = (kept._cache_file._source_stamp, _stamp())
        kept.load_overload = partial(_load_unless_damaged, kept, kept.load_overload)
    return compiled


def _load_unless_damaged(kept, load, *arguments):
    """Load what is kept; where a file was cut off, forget all, so that Numba compiles anew."""
    try:
        return load(*arguments)
    except OSError:
        raise  # Numba knows these
    except Exception:  # unpickling wrong bytes may raise anything
        return kept.flush()


@cache
def _stamp():
    """A hash of the sources of all compiled functions, and of what says how to compile them."""
    sources = [*sorted(ROOT.rglob("*_numba.py")), Path(__file__)]
    return sha256(b"".join(path.read_bytes() for path in sources)).hexdigest()
