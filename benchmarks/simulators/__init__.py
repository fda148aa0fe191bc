"""Simulated scenes that only benchmarks and tests need; their arrays are those of the package's.

Each is as a scene of `sklearn_mcmd.datasets`: surfaces, a sensor, and outliers whose labels are
sure. They were compared with real scans of their kind (``bench_scenes.py`` at ``4c4657b``). Median
spacings are within a factor of two of the real ones, but for the mobile scan's: 3.0 cm, where the
real strip, scanned at a smaller step, has 0.8. Real houses, and above all real cars, are rougher
than polygons.
"""

from ._airborne import make_airborne_scan
from ._depth_frame import make_depth_frame
from ._furniture import make_bus_stop, make_traffic_furniture
from ._lidar_turn import make_lidar_turn
from ._mobile import make_mobile_scan
from ._roofs import ROOFS, make_roof, roof_edges

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
