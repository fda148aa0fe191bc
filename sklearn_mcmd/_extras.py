"""Optional libraries, which are not installed with the package, and how to install them."""

import importlib


def import_extra(module, extra, purpose):
    """Import an optional library of an extra, or say in an ImportError how to install it.

    The error begins with the purpose: what needs the library.
    """
    try:
        return importlib.import_module(module)
    except ImportError as err:
        name = (err.name or module).partition(".")[0]  # maybe one that the module needs
        library = module.partition(".")[0]  # whose installation brings what it needs
        raise ImportError(
            f"{purpose} needs {name}, which is not installed: pip install {library}, or this "
            f"package with its extra [{extra}]"
        ) from err
