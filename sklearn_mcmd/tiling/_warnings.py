"""Warnings of runs, at the line that gave the command."""

import sys
import warnings

from sklearn_mcmd.planes._resolution import coarse_warning

__all__ = ["warn_caller", "warn_if_coarse"]

OWN = ("sklearn_mcmd.tiling.", "contextlib")  # modules that lie between


def warn_caller(message):
    """Warn at the nearest line outside of this package, however deep the work is in it."""
    frame, level = sys._getframe(1), 2
    while frame is not None and frame.f_globals.get("__name__", "").startswith(OWN):
        frame, level = frame.f_back, level + 1
    warnings.warn(message, stacklevel=level)


def warn_if_coarse(constants, index):
    """Warn if single precision is too coarse for the neighborhoods of an index."""
    if constants.dtype == "float32" and (coarse := coarse_warning(index)):
        warn_caller(coarse)
