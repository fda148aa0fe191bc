"""Optional libraries, which are not installed with the package, and how to install them."""

import importlib
import sys

NEWEST = 3, 14  # the Python up to which all extras have wheels, though none without the GIL


def import_extra(module, extra, purpose):
    """Import an optional library of an extra, or say in an ImportError how to install it.

    The error begins with the purpose: what needs the library.
    """
    try:
        return importlib.import_module(module)
    except ImportError as err:
        name = (err.name or module).partition(".")[0]  # maybe one that the module needs
        library = module.partition(".")[0]  # whose installation brings what it needs
        newest, running = (f"Python {v[0]}.{v[1]}" for v in (NEWEST, sys.version_info))
        running += "t" * ("t" in getattr(sys, "abiflags", ""))  # without the GIL
        is_newer = sys.version_info[:2] > NEWEST or running.endswith("t")
        raise ImportError(
            f"{purpose} needs {name}, which is not installed: pip install {library}, or this "
            f"package with its extra [{extra}]"
            + f"; it may have no wheel for {running} yet: take {newest}"
            * is_newer
        ) from err
