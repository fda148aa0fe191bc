"""Clouds larger than memory: by tiles, with results equal to those in memory."""

from sklearn_mcmd.tiling._catalog import Catalog
from sklearn_mcmd.tiling._denoise import write_denoised
from sklearn_mcmd.tiling._edges import write_edges
from sklearn_mcmd.tiling._normals import write_normals
from sklearn_mcmd.tiling._run import RunReport
from sklearn_mcmd.tiling._segments import write_segments
from sklearn_mcmd.tiling._work import TilingError

__all__ = [
    "Catalog",
    "RunReport",
    "TilingError",
    "write_denoised",
    "write_edges",
    "write_normals",
    "write_segments",
]
