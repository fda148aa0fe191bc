"""Outliers of local planes (MCMD_Z, MCMD_MD)."""

from sklearn_mcmd.outliers._detector import MCMDOutlierDetector

__all__ = ["MCMDOutlierDetector"]
