"""Made-up clouds whose truth is known: labels, normals, edges and noise of every point."""

from sklearn_mcmd.datasets._airborne import make_airborne_scan
from sklearn_mcmd.datasets._depth_frame import make_depth_frame
from sklearn_mcmd.datasets._mobile import make_mobile_scan
from sklearn_mcmd.datasets._plane import make_contaminated_plane
from sklearn_mcmd.datasets._shapes import make_box, make_crown_roof
from sklearn_mcmd.datasets._spinning import make_lidar_turn
from sklearn_mcmd.datasets._street import make_street

__all__ = [
    "make_airborne_scan",
    "make_box",
    "make_contaminated_plane",
    "make_crown_roof",
    "make_depth_frame",
    "make_lidar_turn",
    "make_mobile_scan",
    "make_street",
]
