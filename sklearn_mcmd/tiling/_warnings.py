"""The warning of coordinates that single precision rounds too coarsely."""

from sklearn_mcmd._errors import warn_caller
from sklearn_mcmd.planes._resolution import coarse_warning

__all__ = ["warn_if_coarse"]


def warn_if_coarse(constants, index):
    """Warn if single precision is too coarse for the neighborhoods of an index."""
    if constants.dtype == "float32" and (coarse := coarse_warning(index)):
        warn_caller(coarse)
