"""Geodetic tests of planes: data snooping and fuzzy memberships (the second paper)."""

from sklearn_mcmd.adjustment._baarda import BaardaPlaneDetector
from sklearn_mcmd.adjustment._figure import plot_report
from sklearn_mcmd.adjustment._fuzzy import FuzzyPlaneDetector
from sklearn_mcmd.adjustment._report import text_report
from sklearn_mcmd.adjustment._tests import critical_value, local_level

__all__ = [
    "BaardaPlaneDetector",
    "FuzzyPlaneDetector",
    "critical_value",
    "local_level",
    "plot_report",
    "text_report",
]
