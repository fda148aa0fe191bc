"""Simulated scenes that only benchmarks and tests need; their arrays are those of the package's.

Each is a scene of `sklearn_mcmd.datasets`: surfaces, a sensor, and outliers whose labels are sure.
"""

from ._airborne import make_airborne_scan
from ._depth_frame import make_depth_frame
from ._furniture import make_bus_stop, make_traffic_furniture
from ._mobile import make_mobile_scan
from ._roofs import ROOFS, make_roof, roof_edges

__all__ = [
    "ROOFS",
    "make_airborne_scan",
    "make_bus_stop",
    "make_depth_frame",
    "make_mobile_scan",
    "make_roof",
    "make_traffic_furniture",
    "roof_edges",
]
