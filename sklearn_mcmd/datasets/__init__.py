"""Made-up clouds whose truth is known: labels, normals, edges and noise of every point."""

from sklearn_mcmd.datasets._furniture import make_bus_stop, make_traffic_furniture
from sklearn_mcmd.datasets._plane import make_contaminated_plane
from sklearn_mcmd.datasets._shapes import make_box, make_crown_roof
from sklearn_mcmd.datasets._street import make_street

__all__ = [
    "make_box",
    "make_bus_stop",
    "make_contaminated_plane",
    "make_crown_roof",
    "make_street",
    "make_traffic_furniture",
]
