"""Simulated scenes that only benchmarks and tests need: roadsides of the first paper, roofs, scans.

The roadside scenes have the arrays of `sklearn_mcmd.datasets.make_street`. Scans that have snow,
several echoes a beam and all kinds of sensors' outliers are in commit 97bb9769.
"""

from ._furniture import make_bus_stop, make_traffic_furniture
from ._roofs import ROOFS, make_roof, roof_edges
from ._scans import make_airborne_scan, make_depth_frame, make_lidar_turn, make_mobile_scan

__all__ = [
    "ROOFS",
    "make_airborne_scan",
    "make_bus_stop",
    "make_depth_frame",
    "make_lidar_turn",
    "make_mobile_scan",
    "make_roof",
    "make_traffic_furniture",
    "roof_edges",
]
