"""The growth of regions along links, compiled."""

from sklearn_mcmd.planes._kernels import kernel
from sklearn_mcmd.segmentation._graph import _grow

__all__ = ["grow"]

grow = kernel(_grow, cache=True)
