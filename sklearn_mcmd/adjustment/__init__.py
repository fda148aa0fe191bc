"""Geodetic tests of planes: data snooping and fuzzy memberships (the second paper)."""

from sklearn_mcmd.adjustment._baarda import BaardaPlaneDetector
from sklearn_mcmd.adjustment._comparison import Difference, PlaneComparison, compare_planes
from sklearn_mcmd.adjustment._fuzzy import FuzzyPlaneDetector
from sklearn_mcmd.adjustment._precision import PlanePrecision
from sklearn_mcmd.adjustment._reliability import PlaneReliability
from sklearn_mcmd.adjustment._report import text_report
from sklearn_mcmd.adjustment._scan_weights import (
    ScanWeights,
    VarianceComponent,
    scan_weights,
    variance_components,
)
from sklearn_mcmd.adjustment._tests import critical_value, local_level, noncentrality
from sklearn_mcmd.adjustment._tolerance import PlaneFlatness, flatness
from sklearn_mcmd.planes._form import PlaneForm

__all__ = [
    "BaardaPlaneDetector",
    "Difference",
    "FuzzyPlaneDetector",
    "PlaneComparison",
    "PlaneFlatness",
    "PlaneForm",
    "PlanePrecision",
    "PlaneReliability",
    "ScanWeights",
    "VarianceComponent",
    "compare_planes",
    "critical_value",
    "flatness",
    "local_level",
    "noncentrality",
    "scan_weights",
    "text_report",
    "variance_components",
]
