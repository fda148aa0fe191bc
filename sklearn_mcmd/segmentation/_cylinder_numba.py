"""The least squares cylinder, compiled."""

from numba import njit

from sklearn_mcmd.segmentation._cylinder import _fit

__all__ = ["fit"]

fit = njit(cache=True, nogil=True, error_model="numpy")(_fit)
