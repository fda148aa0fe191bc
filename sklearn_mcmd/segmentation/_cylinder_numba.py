"""The least squares cylinder, compiled."""

from sklearn_mcmd.planes._kernels import kernel
from sklearn_mcmd.segmentation._cylinder import _fit

__all__ = ["fit"]

fit = kernel(_fit, cache=True, error_model="numpy")
