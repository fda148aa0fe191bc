"""Clouds larger than memory: many small ones that overlap."""

from sklearn_mcmd.tiling._catalog import Catalog
from sklearn_mcmd.tiling._folder import TilingError
from sklearn_mcmd.tiling._process import process_files
from sklearn_mcmd.tiling._run import RunReport

__all__ = ["Catalog", "RunReport", "TilingError", "process_files"]
