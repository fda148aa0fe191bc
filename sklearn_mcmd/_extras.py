"""Optional libraries, which are not installed with the package, and how to install them."""

import importlib
import re


def import_extra(module, extra, purpose):
    """Import an optional library of an extra, or say in an ImportError how to install it.

    The error begins with the purpose: what needs the library.
    """
    try:
        return importlib.import_module(module)
    except ImportError as err:
        library = (err.name or module).partition(".")[0]  # maybe one that the module needs
        raise ImportError(
            f"{purpose} needs {library}, which is not installed: {how_to_install(library, extra)}"
        ) from err


def how_to_install(library, extra):
    """The command that installs a library that an extra needs, directly or through another one.

    It names the libraries and not this package, which may come from a checkout, a wheel or an
    index. The library has the name under which it is imported.
    """
    asked = _requirements(extra)
    named = [asked_for for asked_for in asked if library in re.split(r"[^\w.-]+", asked_for)]
    wanted = named or asked or [library]  # rich comes with typer, which alone is asked for
    return "pip install " + " ".join(f'"{requirement}"' for requirement in wanted)


def _requirements(extra):
    """The libraries of an extra, from the metadata of the installed package."""
    from importlib import metadata

    try:
        lines = metadata.requires("sklearn-mcmd") or []
    except metadata.PackageNotFoundError:  # run from a folder without installation
        return []
    parts = [line.partition(";") for line in lines]
    return [
        requirement.strip()
        for requirement, _, marker in parts
        if re.search(rf"""extra\s*==\s*['"]{extra}['"]""", marker)
    ]
